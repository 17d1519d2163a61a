//! The frames of a task's videos once more: as they were filmed where the files are still at hand, else as the model sees
//! them.

use std::path::Path;

use anyhow::Result;
use image::{RgbImage, imageops};
use ndarray::s;

use super::scale::Scale;
use super::tracker::ColourTracker;
use crate::import::motion::spread;
use crate::import::sources;
use crate::import::time_base::{Kept, Part};
use paig::datasets::film::FilmFile;
use paig::tasks::video::{Source, Video};

/// Most frames and bytes from which the tracker learns.
const LEARNED_FROM: usize = 60;
const MOST_BYTES: usize = 400 << 20;
/// Frames whose pictures are kept, and their longest side.
const PICTURES: usize = 90;
const LONGEST_SIDE: u32 = 960;

/// The frames of one video.
pub struct Frames<'a> {
    film: &'a FilmFile,
    video: usize,
    filmed: Option<(sources::Video, Vec<usize>)>,
    crop: [i64; 3],
}

/// What one pass over a video gives.
#[derive(Debug, Default)]
pub struct Passed {
    /// Where the tracker saw the object in each frame, pixels of a frame; not numbers where it did not.
    pub tracked: Vec<[f64; 2]>,
    /// Some frames, by their place.
    pub pictures: Vec<(usize, RgbImage)>,
    /// Pixels of a picture to a pixel of a frame, and where a frame's corner lies in it.
    pub pixels: f64,
    pub corner: [f64; 2],
    /// Whether the frames were those that were filmed.
    pub as_filmed: bool,
}

impl<'a> Frames<'a> {
    /// A video that cannot be read any more, or is another one by now, is left aside.
    pub fn open(record: &Video, film: &'a FilmFile, video: usize) -> Self {
        let source = &record.sources[video];
        let count = film.videos[video].dim().0;
        let open = || {
            let filmed = sources::Video::open(Path::new(&source.file)).ok()?;
            let said: Vec<_> = film.numbers[video].iter().map(|number| *number as usize).collect();
            let numbers = if said.is_empty() { chosen_again(record, source, &filmed, count) } else { said };
            let same = (filmed.width, filmed.height) == (record.size[0], record.size[1]);
            (same && numbers.iter().all(|number| *number < filmed.frames)).then_some((filmed, numbers))
        };
        Frames { film, video, filmed: open(), crop: record.crop }
    }

    /// Whether the frames are those that were filmed.
    pub fn as_filmed(&self) -> bool {
        self.filmed.is_some()
    }

    /// Frames in all.
    fn count(&self) -> usize {
        self.film.videos[self.video].dim().0
    }

    /// Goes over the frames at these places.
    fn each(&self, places: &[usize], mut see: impl FnMut(usize, RgbImage)) -> Result<()> {
        if let Some((filmed, numbers)) = &self.filmed {
            let mut frames = filmed.decode()?;
            for &place in places {
                see(place, frames.frame(numbers[place])?);
            }
            return Ok(());
        }
        for &place in places {
            let frame = self.film.videos[self.video].slice(s![place, .., .., ..]);
            let (height, width, channels) = frame.dim();
            let level = |x: u32, y: u32, part: usize| frame[(y as usize, x as usize, part.min(channels - 1))];
            see(
                place,
                RgbImage::from_fn(width as u32, height as u32, |x, y| {
                    image::Rgb([0, 1, 2].map(|part| level(x, y, part)))
                }),
            );
        }
        Ok(())
    }

    /// The part of a picture that the model sees, and its corner.
    fn seen(&self, frame: &RgbImage) -> (RgbImage, [f64; 2]) {
        if self.filmed.is_none() {
            return (frame.clone(), [0.0; 2]);
        }
        let [left, top, side] = self.crop;
        let within = |start: i64, all: u32| (start.clamp(0, i64::from(all)), (start + side).clamp(0, i64::from(all)));
        let ((x, right), (y, bottom)) = (within(left, frame.width()), within(top, frame.height()));
        let part = imageops::crop_imm(frame, x as u32, y as u32, (right - x) as u32, (bottom - y) as u32);
        (part.to_image(), [x as f64, y as f64])
    }

    /// Follows the object by its colour and keeps some pictures.
    ///
    /// # Errors
    /// Damage.
    pub fn pass(&self, scale: &Scale, trained: usize) -> Result<Passed> {
        let mut learned_from = Vec::new();
        let area = match &self.filmed {
            Some((filmed, _)) => (filmed.width * filmed.height) as usize,
            None => self.film.videos[self.video].dim().1.pow(2),
        };
        let most = LEARNED_FROM.min(MOST_BYTES / (3 * area)).max(3);
        self.each(&spread(trained, most), |_, frame| learned_from.push(self.seen(&frame).0))?;
        let tracker = ColourTracker::learn(&learned_from);
        drop(learned_from);
        let kept = spread(self.count(), PICTURES);
        let mut passed = Passed {
            tracked: vec![[f64::NAN; 2]; self.count()],
            pixels: 1.0,
            as_filmed: self.as_filmed(),
            ..Passed::default()
        };
        let all: Vec<usize> = (0..self.count()).collect();
        self.each(&all, |place, frame| {
            let (seen, [left, top]) = self.seen(&frame);
            if let Some([x, y]) = tracker.as_ref().and_then(|tracker| tracker.find(&seen)) {
                let at = [x + left, y + top];
                passed.tracked[place] = if self.as_filmed() { scale.in_frame(at) } else { at };
            }
            if kept.contains(&place) {
                let shrunk = (f64::from(LONGEST_SIDE) / f64::from(frame.width().max(frame.height()))).min(1.0);
                if self.as_filmed() {
                    passed.pixels = scale.video_pixels * shrunk;
                    passed.corner = scale.in_video([0.0; 2]).map(|part| part * shrunk);
                }
                let side = |side: u32| ((f64::from(side) * shrunk).round() as u32).max(1);
                let picture = if shrunk < 1.0 {
                    imageops::thumbnail(&frame, side(frame.width()), side(frame.height()))
                } else {
                    frame
                };
                passed.pictures.push((place, picture));
            }
        })?;
        Ok(passed)
    }
}

/// The frames of a film of `count` that does not say their numbers: chosen once more from where they begin, to the last one that
/// was used or to the end of the video, or every so many-th.
fn chosen_again(record: &Video, source: &Source, filmed: &sources::Video, count: usize) -> Vec<usize> {
    let ([first, end], step) = (source.frames, record.film_step.unwrap_or(record.step));
    let chosen = [Some(end), None].into_iter().filter_map(|end| {
        Kept::choose(filmed.frames, filmed.times.as_deref(), None, Part::Frames(first, end), step).ok()
    });
    let same = chosen.map(|kept| kept.frames).find(|numbers| numbers.len() == count);
    same.unwrap_or_else(|| (first..).step_by(step).take(count).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::gif::GifEncoder;
    use image::{Delay, DynamicImage, Frame, Rgb};
    use ndarray::{Array1, Array4};
    use std::time::Duration;

    /// A part of a gif whose frames 20 to 24 last twice as long as the others: on a regular clock those stand in the film twice.
    #[test]
    fn frames_of_an_uneven_part_are_found_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("uneven.gif");
        let mut encoder = GifEncoder::new(std::fs::File::create(&path).unwrap());
        for number in 0..60_u8 {
            let picture = DynamicImage::from(RgbImage::from_pixel(8, 8, Rgb([4 * number; 3]))).into_rgba8();
            let time = if (20..25).contains(&number) { 200 } else { 100 };
            let delay = Delay::from_saturating_duration(Duration::from_millis(time));
            encoder.encode_frame(Frame::from_parts(picture, 0, 0, delay)).unwrap();
        }
        drop(encoder);
        let filmed = sources::Video::open(&path).unwrap();
        let part = Part::Frames(10, Some(40));
        let numbers = Kept::choose(60, filmed.times.as_deref(), None, part, 1).unwrap().frames;
        assert!(numbers.windows(2).any(|pair| pair[0] == pair[1]) && numbers.len() > 30, "{numbers:?}");
        let source =
            Source { file: path.to_str().unwrap().into(), frames: [10, 38], first_seconds: 1.0, held_out_from: 30 };
        let record = Video {
            size: [8, 8],
            crop: [0, 0, 8],
            step: 4,
            film_step: Some(1),
            time_unit: "s".into(),
            frame_seconds: 0.4,
            pixels_per_metre: None,
            scale_percent: 0.0,
            time_percent: 0.0,
            origin: None,
            angle: 0.0,
            y_up: false,
            sources: vec![source],
        };
        let film = FilmFile {
            videos: vec![Array4::zeros((numbers.len(), 8, 8, 3))],
            numbers: vec![Array1::from_iter(numbers.iter().map(|number| *number as u64))],
        };
        let mut seen = Vec::new();
        let places: Vec<usize> = (0..numbers.len()).collect();
        let frames = Frames::open(&record, &film, 0);
        frames.each(&places, |_, picture| seen.push(usize::from(picture[(3, 3)].0[0]) / 4)).unwrap();
        assert_eq!((frames.as_filmed(), seen), (true, numbers));
    }
}
