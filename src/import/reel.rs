//! The videos of one request and the frames of them that are used.

use anyhow::{Context, Result, bail, ensure};
use image::RgbImage;

use super::contact_sheet::{SheetCell, SheetRow};
use super::crop::{CropChoice, Rectangle, Square};
use super::motion::{self, Moving, spread};
use super::request::Request;
use super::sources::Video;
use super::time_base::Kept;
use super::{MOST_KEPT, Progress};
use crate::tasks::video;

/// Most frames and bytes of the film: where there were more, it holds only the frames that clips are cut from.
const MOST_FILM: usize = 20_000;
const MOST_FILM_BYTES: usize = 1 << 28;
/// Most bytes of all frames as a model sees them.
const MOST_BYTES: usize = 1 << 29;
/// Part by which the time between two frames may differ from video to video.
const SAME_INTERVAL: f64 = 0.01;
/// Frames of each video on the contact sheet, their longest side in pixels, and most videos on it.
const SHEET_FRAMES: usize = 6;
const SHEET_SIDE: u32 = 480;
const SHEET_VIDEOS: usize = 8;

/// Videos of one size and one time between frames.
#[derive(Debug)]
pub(super) struct Reel {
    pub videos: Vec<Video>,
    /// Of each video, what clips are cut from.
    pub kept: Vec<Kept>,
    /// The same at every frame, or at every `film_step`-th.
    film: Vec<Kept>,
    pub film_step: usize,
}

impl Reel {
    /// Reads what the videos say of themselves, and chooses frames.
    pub(super) fn open(request: &Request) -> Result<Self> {
        for (place, path) in request.videos.iter().enumerate() {
            let again = request.videos[..place].contains(path);
            ensure!(!again, "video {} is given twice; what one holds out, the other would train on", path.display());
        }
        let videos = request.videos.iter().map(|path| Video::open(path)).collect::<Result<Vec<_>>>()?;
        let choose = |video: &Video| {
            let kept = Kept::choose(video.frames, video.times.as_deref(), request.fps, request.part, request.step);
            kept.with_context(|| format!("video {}", video.path.display()))
        };
        let kept = videos.iter().map(choose).collect::<Result<Vec<_>>>()?;
        let every = |step: usize| {
            let choose =
                |video: &Video| Kept::choose(video.frames, video.times.as_deref(), request.fps, request.part, step);
            videos.iter().map(choose).collect::<Result<Vec<_>>>()
        };
        let all = every(1)?;
        let frames: usize = all.iter().map(|kept| kept.frames.len()).sum();
        let fits = frames <= MOST_FILM.min(MOST_FILM_BYTES / request.frame_bytes().max(1));
        let (film, film_step) = if fits { (all, 1) } else { (kept.clone(), request.step) };
        let reel = Reel { videos, kept, film, film_step };
        reel.check_alike()?;
        let frames: usize = reel.kept.iter().map(|kept| kept.frames.len()).sum();
        let most = MOST_KEPT.min(MOST_BYTES / request.frame_bytes().max(1));
        ensure!(
            frames <= most,
            "{frames} frames of {0} x {0} pixels would be kept; at most {most} are: take a part of the video (--frames, \
             --seconds), every n-th frame (--step), or smaller frames (--side)",
            request.side
        );
        Ok(reel)
    }

    /// Parameters in pixels and frames mean the same in all videos only if these are alike.
    fn check_alike(&self) -> Result<()> {
        let (first, interval) = (&self.videos[0], self.kept[0].interval);
        for (video, kept) in self.videos.iter().zip(&self.kept).skip(1) {
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
        let mean = self.kept.iter().map(|kept| kept.interval).sum::<f64>() / self.kept.len() as f64;
        (1e9 * mean).round() / 1e9
    }

    /// The same in the unit of the task's `dt`.
    pub(super) fn dt(&self, request: &Request) -> Result<f64> {
        Ok(match request.time_unit.as_str() {
            "s" => self.interval(),
            "ms" => 1000.0 * self.interval(),
            "frames" => request.step as f64,
            other => bail!("--dt-unit {other}: one of s, ms, frames"),
        })
    }

    /// The square to cut out, the same of all videos.
    pub(super) fn square(&self, request: &Request, progress: Progress) -> Result<Square> {
        let (width, height) = (self.videos[0].width, self.videos[0].height);
        let rectangle = match request.crop {
            CropChoice::Full => Rectangle { x: 0, y: 0, width, height },
            CropChoice::Rectangle(rectangle) => rectangle,
            CropChoice::Auto => self.around_what_moves(progress)?,
        };
        rectangle.squared(width, height)
    }

    fn around_what_moves(&self, progress: Progress) -> Result<Rectangle> {
        let (width, height) = (self.videos[0].width, self.videos[0].height);
        let mut around: Option<Rectangle> = None;
        for (video, kept) in self.videos.iter().zip(&self.kept) {
            let looked_at = motion::looked_at(kept.frames.len());
            let mut small = Vec::new();
            let mut frames = video.decode()?;
            for (done, &place) in looked_at.iter().enumerate() {
                let decoded =
                    frames.frame(kept.frames[place]).with_context(|| format!("video {}", video.path.display()));
                small.push(motion::small(&decoded?));
                progress(done + 1, looked_at.len());
            }
            let found = Moving::measure(&small).rectangle(width, height);
            around = around.into_iter().chain(found).reduce(Rectangle::joined);
        }
        around.context("nothing moves; look at another part of the video with --frames, or give the crop with --crop")
    }

    /// Of the frames of the film each how many-th is cut into clips.
    pub(super) fn film_ratio(&self, request: &Request) -> usize {
        request.step / self.film_step
    }

    /// Decodes, cuts out and scales the frames of the film of each video.
    pub(super) fn decode(
        &self,
        request: &Request,
        square: Square,
        progress: Progress,
    ) -> Result<(Vec<Vec<RgbImage>>, Vec<SheetRow>)> {
        let total = self.film.iter().map(|film| film.frames.len()).sum();
        let (mut all, mut rows, mut done) = (Vec::new(), Vec::new(), 0);
        let ratio = self.film_ratio(request);
        for ((video, kept), film) in self.videos.iter().zip(&self.kept).zip(&self.film) {
            let on_sheet = spread(kept.frames.len(), if rows.len() < SHEET_VIDEOS { SHEET_FRAMES } else { 0 });
            let (mut seen, mut cells) = (Vec::new(), Vec::new());
            let mut frames = video.decode()?;
            for (tick, &number) in film.frames.iter().enumerate() {
                let frame = frames.frame(number).with_context(|| format!("video {}", video.path.display()))?;
                let small = square.cut(&frame, request.side as u32);
                let small = if request.grey { greyed(&small) } else { small };
                let place = tick / ratio;
                if tick.is_multiple_of(ratio) && on_sheet.contains(&place) {
                    cells.push(cell(&frame, &small, number, kept, place, square));
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
    pub(super) fn record(&self, request: &Request, square: Square) -> video::Video {
        let source = |(video, kept): (&Video, &Kept)| {
            let held_out = super::hold_out::Parts::of(kept.frames.len()).valid.start;
            video::Source {
                file: video.path.to_string_lossy().into_owned(),
                frames: [kept.frames[0], kept.frames[kept.frames.len() - 1] + 1],
                first_seconds: kept.first_seconds,
                held_out_from: kept.frames[held_out.min(kept.frames.len() - 1)],
            }
        };
        video::Video {
            size: [self.videos[0].width, self.videos[0].height],
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
            sources: self.videos.iter().zip(&self.kept).map(source).collect(),
        }
    }
}

/// All three channels the same: the luma.
fn greyed(picture: &RgbImage) -> RgbImage {
    image::DynamicImage::from(image::imageops::grayscale(picture)).into_rgb8()
}

fn title(video: &Video, square: Square, side: usize) -> String {
    let Square { x, y, side: cut } = square;
    format!(
        "{}: {} x {} pixels, {cut} x {cut} from ({x}, {y}) on are seen as {side} x {side}",
        video.name(),
        video.width,
        video.height
    )
}

fn cell(frame: &RgbImage, seen: &RgbImage, number: usize, kept: &Kept, place: usize, square: Square) -> SheetCell {
    let (width, height) = frame.dimensions();
    let scale = (f64::from(SHEET_SIDE) / f64::from(width.max(height))).min(1.0);
    let side = |side: u32| ((f64::from(side) * scale) as u32).max(1);
    let filmed = image::imageops::thumbnail(frame, side(width), side(height));
    let parts = super::hold_out::Parts::of(kept.frames.len());
    let part = match place {
        place if parts.train.contains(&place) => "training",
        place if parts.valid.contains(&place) => "validation",
        _ => "test",
    };
    let seconds = kept.first_seconds + kept.interval * place as f64;
    let of_width = |length: f64| length / f64::from(width);
    SheetCell {
        caption: format!("frame {number}, {seconds:.2} s, {part}"),
        filmed,
        square: [of_width(square.x as f64), of_width(square.y as f64), of_width(f64::from(square.side))],
        seen: seen.clone(),
    }
}
