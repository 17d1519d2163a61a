//! Some frames of a recording to draw on: as they were filmed where the file is still at hand, else as the model sees them.

use std::path::Path;
use std::rc::Rc;

use anyhow::Result;
use image::{RgbImage, imageops};
use ndarray::{Array4, s};
use paig_track::TimeBase;

use super::recording::Recording;
use super::scale::Scale;
use crate::import::motion::spread;
use crate::import::sources;
use crate::import::time_base::{Kept, VideoPart};
use paig::datasets::film::FilmFile;
use paig::support::significant::significant;
use paig::tasks::video;

/// Frames whose pictures are kept, and their longest side.
const PICTURES: usize = 90;
const LONGEST_SIDE: u32 = 720;
/// Part by which the time between two frames may differ from the video's.
const SAME_TIMES: f64 = 0.01;

/// Some frames of one recording.
#[derive(Debug, Default)]
pub struct Pictures {
    /// By their place in the recording.
    pub pictures: Vec<(usize, RgbImage)>,
    /// Pixels of a picture to a pixel of a frame, and where a frame's corner lies in it.
    pub pixels: f64,
    pub corner: [f64; 2],
}

/// Where the pictures of a recording come from.
#[derive(Clone)]
pub enum PictureSource {
    /// The video, by the numbers of the recording's frames.
    Filmed(Rc<sources::SourceVideo>),
    /// The frames as the model sees them, `[frames, height, width, channels]`.
    Seen(Array4<u8>),
}

impl PictureSource {
    /// # Errors
    /// Damage.
    pub fn pictures(&self, recording: &Recording, scale: &Scale) -> Result<Pictures> {
        match self {
            PictureSource::Filmed(video) => {
                let numbers: Vec<usize> = recording.numbers.iter().map(|number| *number as usize).collect();
                Pictures::filmed(video, &numbers, scale)
            }
            PictureSource::Seen(frames) => Ok(Pictures::seen(frames)),
        }
    }
}

/// The video that a recording was cut from, with the numbers of its frames; none where it is no longer there, or another one by
/// now.
pub fn filmed(record: &video::Video, film: &FilmFile, video: usize) -> Option<(sources::SourceVideo, Vec<usize>)> {
    let source = &record.sources[video];
    let filmed = sources::SourceVideo::open(Path::new(&source.file)).ok()?;
    let said: Vec<_> = film.numbers[video].iter().map(|number| *number as usize).collect();
    let count = film.videos[video].dim().0;
    let numbers = if said.is_empty() { chosen_again(record, source, &filmed, count) } else { said };
    let known = source.checksum.is_empty() || filmed.checksum().is_ok_and(|checksum| checksum == source.checksum);
    let same = known && (filmed.width, filmed.height) == (record.size[0], record.size[1]);
    (same && numbers.iter().all(|number| *number < filmed.frames)).then_some((filmed, numbers))
}

/// A note where a task has another time between the frames of its film than the video shows, as after `--fps` or an edit of the
/// task file.
pub fn other_times(record: &video::Video, filmed: &sources::SourceVideo, numbers: &[usize]) -> Option<String> {
    let times = TimeBase::new(&filmed.clock, None).times?;
    let (first, last) = (*times.get(*numbers.first()?)?, *times.get(*numbers.last()?)?);
    let shown = (last - first) / (numbers.len() - 1).max(1) as f64;
    let stated = record.frame_seconds * record.film_step.unwrap_or(record.step) as f64 / record.step as f64;
    let same = (stated / shown - 1.0).abs() <= SAME_TIMES;
    (!same && shown > 0.0).then(|| {
        format!(
            "{}: {} s between two frames by the task, {} s by the video: right only where --fps or an edit of the task file \
             corrects the video",
            filmed.name(),
            significant(stated, 4),
            significant(shown, 4)
        )
    })
}

impl Pictures {
    /// Of these frames of a video.
    ///
    /// # Errors
    /// Damage.
    fn filmed(video: &sources::SourceVideo, numbers: &[usize], scale: &Scale) -> Result<Self> {
        let shrunk = (f64::from(LONGEST_SIDE) / f64::from(video.width.max(video.height))).min(1.0);
        let side = |side: u32| ((f64::from(side) * shrunk).round() as u32).max(1);
        let mut frames = video.decode()?;
        let mut pictures = Vec::new();
        for place in spread(numbers.len(), PICTURES) {
            let frame = frames.frame(numbers[place])?;
            let small = shrunk < 1.0;
            let picture =
                if small { imageops::thumbnail(&frame, side(frame.width()), side(frame.height())) } else { frame };
            pictures.push((place, picture));
        }
        let corner = scale.in_video([0.0; 2]).map(|part| part * shrunk);
        Ok(Pictures { pictures, pixels: scale.video_pixels * shrunk, corner })
    }

    /// Of the frames as a model sees them.
    fn seen(frames: &Array4<u8>) -> Self {
        let picture = |place: usize| {
            let frame = frames.slice(s![place, .., .., ..]);
            let (height, width, channels) = frame.dim();
            let level = |x: u32, y: u32, part: usize| frame[(y as usize, x as usize, part.min(channels - 1))];
            let colour = |x, y| image::Rgb([0, 1, 2].map(|part| level(x, y, part)));
            (place, RgbImage::from_fn(width as u32, height as u32, colour))
        };
        let pictures = spread(frames.dim().0, PICTURES).into_iter().map(picture).collect();
        Pictures { pictures, pixels: 1.0, corner: [0.0; 2] }
    }
}

/// The frames of a film of `count` that does not say their numbers: chosen once more from where they begin, to the last one that
/// was used or to the end of the video, or every so many-th.
fn chosen_again(
    record: &video::Video,
    source: &video::Source,
    filmed: &sources::SourceVideo,
    count: usize,
) -> Vec<usize> {
    let ([first, end], step) = (source.frames, record.film_step.unwrap_or(record.step));
    let chosen = [Some(end), None].into_iter().filter_map(|end| {
        Kept::choose(filmed.frames, filmed.times.as_deref(), None, VideoPart::Frames(first, end), step).ok()
    });
    let same = chosen.map(|kept| kept.frames).find(|numbers| numbers.len() == count);
    same.unwrap_or_else(|| (first..).step_by(step).take(count).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::gif::GifEncoder;
    use image::{Delay, DynamicImage, Frame, Rgb};
    use ndarray::Array1;
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
        let filmed = sources::SourceVideo::open(&path).unwrap();
        let part = VideoPart::Frames(10, Some(40));
        let numbers = Kept::choose(60, filmed.times.as_deref(), None, part, 1).unwrap().frames;
        assert!(numbers.windows(2).any(|pair| pair[0] == pair[1]) && numbers.len() > 30, "{numbers:?}");
        let source = video::Source {
            file: path.to_str().unwrap().into(),
            frames: [10, 38],
            first_seconds: 1.0,
            held_out_from: 30,
            checksum: String::new(),
        };
        let record = video::Video {
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
        let (video, found) = super::filmed(&record, &film, 0).unwrap();
        assert_eq!(found, numbers);
        let with = |checksum: String| {
            let source = video::Source { checksum, ..record.sources[0].clone() };
            super::filmed(&video::Video { sources: vec![source], ..record.clone() }, &film, 0)
        };
        assert!(with(video.checksum().unwrap()).is_some());
        assert!(with("0000000000000000".into()).is_none(), "another video was taken");
        assert_eq!(super::other_times(&record, &video, &numbers), None);
        let doubled = video::Video { frame_seconds: 0.8, ..record.clone() };
        let note = super::other_times(&doubled, &video, &numbers).unwrap();
        assert!(note.contains("0.2000 s between two frames by the task, 0.1000 s by the video"), "{note}");
        let system = paig::tasks::builtin("falling").unwrap().system;
        let shown = Pictures::filmed(&video, &numbers, &Scale::new(&record, &system)).unwrap().pictures;
        let seen: Vec<usize> = shown.iter().map(|(_, picture)| usize::from(picture[(3, 3)].0[0]) / 4).collect();
        assert_eq!(seen, numbers);
    }
}
