//! The takes of one request: videos, or parts of them, and the frames that are used.

use std::path::{self, PathBuf};
use std::rc::Rc;

use anyhow::{Context, Result, ensure};
use image::RgbImage;
use ndarray::Array1;

use super::contact_sheet::{SheetCell, SheetRow};
use super::crop::{CropChoice, CropRectangle, Square};
use super::hold_out::HoldOut;
use super::motion::{self, MovingArea, spread};
use super::request::ImportRequest;
use super::sources::{Passes, SourceVideo, check_slow_motion, ensure_each_once};
use super::time_base::{Kept, VideoPart};
use super::{ImportProgress, MOST_KEPT};
use paig::tasks::video;

/// Most frames and bytes of the film: where there were more, it holds only the frames that clips are cut from.
const MOST_FILM: usize = 20_000;
const MOST_FILM_BYTES: usize = 1 << 28;
/// Most bytes of all frames as a model sees them.
const MOST_BYTES: usize = 1 << 29;
/// Part by which the time between two frames may differ from video to video.
const SAME_INTERVAL: f64 = 0.01;
/// Frames of each take on the contact sheet, their longest side in pixels, and most takes on it.
const SHEET_FRAMES: usize = 6;
const SHEET_SIDE: u32 = 480;
const SHEET_TAKES: usize = 8;

/// A part of a video that shows one motion from its beginning to its end.
#[derive(Debug)]
pub(super) struct VideoTake {
    pub video: Rc<SourceVideo>,
    /// What clips are cut from.
    pub kept: Kept,
    pub parts: HoldOut,
    /// The same as is kept at every frame, or at every `film_step`-th.
    film: Kept,
    /// Of the video, see [`SourceVideo::checksum`].
    checksum: String,
}

/// Takes of one size and one time between frames.
#[derive(Debug)]
pub(super) struct Reel {
    pub takes: Vec<VideoTake>,
    pub film_step: usize,
    /// Which parts were left out and why, for people.
    pub left_out: Vec<String>,
}

impl Reel {
    /// Reads what the videos say of themselves, and chooses frames. A clip has at least `needed`.
    pub(super) fn open(request: &ImportRequest, needed: usize) -> Result<Self> {
        request.slow_motion.map_or(Ok(()), check_slow_motion)?;
        let open = |path: &PathBuf| {
            let video = SourceVideo::open(path)?;
            Ok(Rc::new(if request.fps.is_some() { video } else { video.timed(request.slow_motion) }))
        };
        let videos = request.videos.iter().map(open).collect::<Result<Vec<_>>>()?;
        for path in &request.videos {
            ensure!(
                path::absolute(path).is_ok_and(|path| path.to_str().is_some()),
                "video {}: its path is not UTF-8, so the task file cannot hold it; rename it",
                path.display()
            );
        }
        ensure_each_once(&request.videos)?;
        let parts = || videos.iter().flat_map(|video| request.parts.iter().map(move |part| (video, *part)));
        let every = |step: usize| {
            let choose = |(video, part): (&Rc<SourceVideo>, VideoPart)| {
                let kept = Kept::choose(video.frames, video.times.as_deref(), request.fps, part, step);
                kept.with_context(|| format!("video {}", video.path.display()))
            };
            parts().map(choose).collect::<Result<Vec<_>>>()
        };
        let (kept, all) = (every(request.step)?, every(1)?);
        let count = |of: &[Kept]| of.iter().map(|kept| kept.frames.len()).sum::<usize>();
        let fits = count(&all) <= MOST_FILM.min(MOST_FILM_BYTES / request.frame_bytes().max(1));
        let (film, film_step) = if fits { (all, 1) } else { (kept.clone(), request.step) };
        let most = MOST_KEPT.min(MOST_BYTES / request.frame_bytes().max(1));
        let frames = count(&kept);
        let checksums = videos.iter().map(|video| video.checksum()).collect::<Result<Vec<_>>>()?;
        let checksums = checksums.iter().flat_map(|sum| request.parts.iter().map(move |_| sum.clone()));
        let takes = parts().zip(kept).zip(film).zip(checksums).map(|((((video, _), kept), film), checksum)| {
            // Decided by `hold_out`, once it is known which takes are left.
            let parts = HoldOut::of(kept.frames.len());
            VideoTake { video: video.clone(), kept, parts, film, checksum }
        });
        let mut reel = Reel { takes: takes.collect(), film_step, left_out: Vec::new() };
        reel.check_apart()?;
        // What is left out is not among those of which the last are held out, and its clock does not count.
        reel.leave_out_short(needed);
        reel.hold_out(needed);
        reel.check_alike()?;
        ensure!(
            frames <= most,
            "{frames} frames of {0} x {0} pixels would be kept; at most {most} are: take a part of the video (--frames, \
             --seconds), every n-th frame (--step), or smaller frames (--side)",
            request.side
        );
        Ok(reel)
    }

    /// Leaves out takes whose film has less than the frames of a clip: neither are clips cut from them, nor can a model look
    /// at them.
    pub(super) fn leave_out_short(&mut self, clip: usize) {
        let is_short = |take: &VideoTake| take.film.frames.len() < clip;
        // Where none is long enough, the choice of clips says how long one must be.
        if self.takes.iter().all(is_short) {
            return;
        }
        let short = self.takes.extract_if(.., |take| is_short(take));
        self.left_out.extend(short.map(|take| {
            let ([first, end], frames) = (take.ends(), take.film.frames.len());
            let name = take.video.name();
            format!("{name}: frames {first}..{end} are left out; they give {frames}, and a clip has at least {clip}")
        }));
    }

    /// Decides what is held out, where a clip has at least `needed` frames.
    fn hold_out(&mut self, needed: usize) {
        let lengths: Vec<_> = self.takes.iter().map(|take| take.kept.frames.len()).collect();
        for (take, parts) in self.takes.iter_mut().zip(HoldOut::of_all(&lengths, needed)) {
            take.parts = parts.apart(&take.kept.frames);
        }
    }

    /// What one take holds out, no other may train on.
    fn check_apart(&self) -> Result<()> {
        for pair in self.takes.windows(2).filter(|pair| Rc::ptr_eq(&pair[0].video, &pair[1].video)) {
            let ([first, last], [next, _]) = (pair[0].ends(), pair[1].ends());
            ensure!(
                last <= next,
                "video {}: the parts {first}..{last} and {next}.. of its frames must follow each other",
                pair[0].video.path.display()
            );
        }
        Ok(())
    }

    /// Parameters in pixels and frames mean the same in all videos only if these are alike.
    fn check_alike(&self) -> Result<()> {
        let (first, interval) = (&self.takes[0].video, self.takes[0].kept.interval);
        for VideoTake { video, kept, .. } in &self.takes[1..] {
            let path = video.path.display();
            ensure!(
                (video.width, video.height) == (first.width, first.height),
                "video {path} has {} x {} pixels, the first one {} x {}; import them apart, or convert them to one size",
                video.width,
                video.height,
                first.width,
                first.height
            );
            ensure!(
                (kept.interval / interval - 1.0).abs() <= SAME_INTERVAL,
                "video {path} keeps a frame every {:.5} s, the first one every {interval:.5} s; import them apart, or say \
                 with --fps how many frames they have a second",
                kept.interval
            );
        }
        Ok(())
    }

    /// Mean time between two frames of a clip, seconds, to the nanosecond: no camera's clock is better.
    pub(super) fn interval(&self) -> f64 {
        let mean = self.takes.iter().map(|take| take.kept.interval).sum::<f64>() / self.takes.len() as f64;
        (1e9 * mean).round() / 1e9
    }

    /// The same in the unit of the task's `dt`.
    pub(super) fn dt(&self, request: &ImportRequest) -> Result<f64> {
        let unit = &request.time_unit;
        let dt = video::dt_of(unit, self.interval(), request.step);
        dt.with_context(|| format!("--dt-unit {unit}: one of {}", video::TIME_UNITS))
    }

    /// Each video once.
    pub(super) fn videos(&self) -> impl Iterator<Item = &SourceVideo> {
        let begins =
            |place: &usize| *place == 0 || !Rc::ptr_eq(&self.takes[*place].video, &self.takes[place - 1].video);
        (0..self.takes.len()).filter(begins).map(|place| &*self.takes[place].video)
    }

    fn size(&self) -> [u32; 2] {
        let video = &self.takes[0].video;
        [video.width, video.height]
    }

    /// The square to cut out, the same of all takes.
    pub(super) fn square(&self, request: &ImportRequest, progress: ImportProgress) -> Result<Square> {
        let [width, height] = self.size();
        let rectangle = match request.crop {
            CropChoice::Full => CropRectangle { x: 0, y: 0, width, height },
            CropChoice::Rectangle(rectangle) => rectangle,
            CropChoice::Auto => self.around_what_moves(progress)?,
        };
        rectangle.squared(width, height)
    }

    fn around_what_moves(&self, progress: ImportProgress) -> Result<CropRectangle> {
        let [width, height] = self.size();
        let (mut around, mut passes): (Option<CropRectangle>, _) = (None, Passes::default());
        for VideoTake { video, kept, .. } in &self.takes {
            let looked_at = motion::looked_at(kept.frames.len());
            let mut small = Vec::new();
            let frames = passes.of(video)?;
            for (done, &place) in looked_at.iter().enumerate() {
                let decoded =
                    frames.frame(kept.frames[place]).with_context(|| format!("video {}", video.path.display()));
                small.push(motion::small(&decoded?));
                progress(done + 1, looked_at.len());
            }
            let found = MovingArea::measure(&small).rectangle(width, height);
            around = around.into_iter().chain(found).reduce(CropRectangle::joined);
        }
        around.context("nothing moves; look at another part of the video with --frames, or give the crop with --crop")
    }

    /// Of the frames of the film each how many-th is cut into clips.
    pub(super) fn film_ratio(&self, request: &ImportRequest) -> usize {
        request.step / self.film_step
    }

    /// Of each take the numbers of the film's frames in their video.
    pub(super) fn film_numbers(&self) -> Vec<Array1<u64>> {
        self.takes.iter().map(|take| take.film.frames.iter().map(|number| *number as u64).collect()).collect()
    }

    /// Decodes, cuts out and scales the frames of the film of each take.
    pub(super) fn decode(
        &self,
        request: &ImportRequest,
        square: Square,
        progress: ImportProgress,
    ) -> Result<(Vec<Vec<RgbImage>>, Vec<SheetRow>)> {
        let total = self.takes.iter().map(|take| take.film.frames.len()).sum();
        let (mut all, mut rows, mut done) = (Vec::new(), Vec::new(), 0);
        let (ratio, mut passes) = (self.film_ratio(request), Passes::default());
        for take in &self.takes {
            let VideoTake { video, kept, film, .. } = take;
            let on_sheet = spread(kept.frames.len(), if rows.len() < SHEET_TAKES { SHEET_FRAMES } else { 0 });
            let (mut seen, mut cells) = (Vec::new(), Vec::new());
            let frames = passes.of(video)?;
            for (tick, &number) in film.frames.iter().enumerate() {
                let frame = frames.frame(number).with_context(|| format!("video {}", video.path.display()))?;
                let small = square.cut(&frame, request.side as u32);
                let small = if request.grey { greyed(&small) } else { small };
                let place = tick / ratio;
                if tick.is_multiple_of(ratio) && on_sheet.contains(&place) {
                    cells.push(take.cell(&frame, &small, number, place, square));
                }
                seen.push(small);
                done += 1;
                progress(done, total);
            }
            if !cells.is_empty() {
                rows.push(SheetRow { title: title(video, square, request.side), cells });
            }
            all.push(seen);
        }
        Ok((all, rows))
    }

    /// What the task file says of the videos.
    pub(super) fn record(&self, request: &ImportRequest, square: Square) -> video::Video {
        video::Video {
            size: self.size(),
            crop: [square.x, square.y, i64::from(square.side)],
            step: request.step,
            film_step: Some(self.film_step),
            time_unit: request.time_unit.clone(),
            frame_seconds: self.interval(),
            pixels_per_metre: request.pixels_per_metre,
            scale_percent: request.scale_percent,
            time_percent: request.time_percent,
            origin: request.origin,
            angle: request.angle,
            y_up: request.y_up,
            sources: self.takes.iter().map(VideoTake::source).collect(),
        }
    }
}

impl VideoTake {
    /// Its first frame, and the one after its last.
    fn ends(&self) -> [usize; 2] {
        let frames = &self.kept.frames;
        [frames[0], frames[frames.len() - 1] + 1]
    }

    fn source(&self) -> video::Source {
        let frames = self.ends();
        video::Source {
            // Read again from other folders than this.
            file: path::absolute(&self.video.path).unwrap_or(self.video.path.clone()).to_string_lossy().into_owned(),
            frames,
            first_seconds: self.kept.first_seconds,
            held_out_from: self.kept.frames.get(self.parts.train.end).copied().unwrap_or(frames[1]),
            checksum: self.checksum.clone(),
        }
    }

    fn cell(&self, frame: &RgbImage, seen: &RgbImage, number: usize, place: usize, square: Square) -> SheetCell {
        let (width, height) = frame.dimensions();
        let scale = (f64::from(SHEET_SIDE) / f64::from(width.max(height))).min(1.0);
        let side = |side: u32| ((f64::from(side) * scale) as u32).max(1);
        let filmed = image::imageops::thumbnail(frame, side(width), side(height));
        let part = match place {
            place if self.parts.train.contains(&place) => "training",
            place if self.parts.valid.contains(&place) => "validation",
            _ => "test",
        };
        let seconds = self.kept.first_seconds + self.kept.interval * place as f64;
        let of_width = |length: f64| length / f64::from(width);
        SheetCell {
            caption: format!("frame {number}, {seconds:.2} s, {part}"),
            filmed,
            square: [of_width(square.x as f64), of_width(square.y as f64), of_width(f64::from(square.side))],
            seen: seen.clone(),
        }
    }
}

/// All three channels the same: the luma.
fn greyed(picture: &RgbImage) -> RgbImage {
    image::DynamicImage::from(image::imageops::grayscale(picture)).into_rgb8()
}

fn title(video: &SourceVideo, square: Square, side: usize) -> String {
    let Square { x, y, side: cut } = square;
    format!(
        "{}: {} x {} pixels, {cut} x {cut} from ({x}, {y}) on are seen as {side} x {side}",
        video.name(),
        video.width,
        video.height
    )
}
