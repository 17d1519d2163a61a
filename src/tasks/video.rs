//! Where a task's clips were filmed: what `import` writes down, so that results can be given in the units of the scene.
//!
//! Nothing that learns reads it.

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use crate::support::toml_values::{exact, exact_if_given};

/// Part by which `dt` may differ from what the video's frames say of it: both are written with all their digits, but a
/// hand may round them.
const SAME_TIME: f64 = 1e-6;

/// Largest side of a picture, pixels, and most frames of a video.
pub const LARGEST_SIDE: u32 = 8192;
pub const MOST_FRAMES: usize = 2_000_000;

/// The videos of a task and what turns a frame's pixels into metres. Places in a video are `(x, y)` in pixels of its
/// upright frames, x to the right and y down, `(0, 0)` in the top left corner of the top left pixel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Video {
    /// Width and height of the videos, pixels.
    #[serde(deserialize_with = "exact")]
    pub size: [u32; 2],
    /// Top left corner and side of the square that was cut out. Where it sticks out of the video, frames are black.
    #[serde(deserialize_with = "exact")]
    pub crop: [i64; 3],
    /// Every how many-th frame was kept.
    pub step: usize,
    /// Every how many-th frame of the video stands in `film.npz`, from the first to the last; none where there is no such
    /// file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub film_step: Option<usize>,
    /// Unit of `system.dt`: `s`, `ms` or `frames`.
    pub time_unit: String,
    /// Seconds between two frames of a clip.
    pub frame_seconds: f64,
    /// Video pixels to a metre, if known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pixels_per_metre: Option<f64>,
    /// Standard deviations of what is said of scale and time, per cent: of `pixels_per_metre` and of `frame_seconds`. They
    /// widen the intervals of what is measured.
    #[serde(default)]
    pub scale_percent: f64,
    #[serde(default)]
    pub time_percent: f64,
    /// Origin of the scene's axes; the top left corner of the video if not given.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "exact_if_given")]
    pub origin: Option<[f64; 2]>,
    /// Angle of the x axis, degrees, counter-clockwise from the right.
    #[serde(default)]
    pub angle: f64,
    /// Whether the scene's y axis points up.
    #[serde(default)]
    pub y_up: bool,
    pub sources: Vec<Source>,
}

/// Units of `system.dt`, for messages.
pub const TIME_UNITS: &str = "s, ms, frames";

/// What `system.dt` is in a unit of time, where the frames of a clip are so many seconds apart and `step` frames of the video;
/// none of a unit that there is not.
pub fn dt_of(unit: &str, frame_seconds: f64, step: usize) -> Option<f64> {
    match unit {
        "s" => Some(frame_seconds),
        "ms" => Some(1000.0 * frame_seconds),
        "frames" => Some(step as f64),
        _ => None,
    }
}

/// One video, or one part of a video that shows a motion from its beginning to its end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// Its whole path; in files of before as it was given.
    pub file: String,
    /// First frame that was used, and the one after the last, counted from 0.
    #[serde(deserialize_with = "exact")]
    pub frames: [usize; 2],
    /// When the first frame is shown, seconds from the beginning of the video.
    pub first_seconds: f64,
    /// The first frame that no training clip holds: the first of all where it was held out whole, the one after the last
    /// where it was not held out at all.
    pub held_out_from: usize,
    /// Checksum of the file, or of a folder's pictures; empty in files of earlier versions.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub checksum: String,
}

impl Source {
    /// # Errors
    /// Frames that cannot be.
    fn check(&self) -> Result<()> {
        let [first, end] = self.frames;
        ensure!(
            first < end && end <= MOST_FRAMES,
            "video.sources.frames = {:?}: expected the first frame and the one after the last, at most {MOST_FRAMES}",
            self.frames
        );
        ensure!(
            (first..=end).contains(&self.held_out_from),
            "video.sources.held_out_from = {}: expected a frame of {first} to {end} (video.sources.frames)",
            self.held_out_from
        );
        ensure!(
            self.first_seconds.is_finite(),
            "video.sources.first_seconds = {}: must be a finite number",
            self.first_seconds
        );
        Ok(())
    }

    /// Whether no training clip holds any of it.
    pub fn is_held_out(&self) -> bool {
        self.held_out_from <= self.frames[0]
    }

    /// Whether training clips hold all of it.
    pub fn is_learned_from(&self) -> bool {
        self.held_out_from >= self.frames[1]
    }

    fn file_name(&self) -> &str {
        let file = self.file.trim_end_matches('/');
        file.rsplit('/').next().unwrap_or(file)
    }
}

impl Video {
    /// Of each source its file's name (with its folder, where another file has the same name), and its frames where others are
    /// of the same file.
    pub fn source_names(&self) -> Vec<String> {
        let name = |source: &Source| {
            let alone = self.sources.iter().filter(|other| other.file == source.file).count() == 1;
            let [first, end] = source.frames;
            let frames = if alone { String::new() } else { format!(" {first}..{end}") };
            let same_name = |other: &Source| other.file != source.file && other.file_name() == source.file_name();
            let name = if self.sources.iter().any(same_name) { &source.file } else { source.file_name() };
            name.to_string() + &frames
        };
        self.sources.iter().map(name).collect()
    }

    /// Whether all is the same but which files they are.
    pub fn says_the_same(&self, other: &Video) -> bool {
        let without_files = |video: &Video| {
            let sources = video
                .sources
                .iter()
                .map(|source| Source { file: String::new(), checksum: String::new(), ..source.clone() })
                .collect();
            Video { sources, ..video.clone() }
        };
        without_files(self) == without_files(other)
    }

    /// Metres to a pixel of a frame of that side, if the scale is known.
    pub fn metres_per_pixel(&self, side: usize) -> Option<f64> {
        self.pixels_per_metre.map(|scale| self.crop[2] as f64 / side as f64 / scale)
    }

    /// # Errors
    /// Numbers that cannot be, or that do not go with the `dt` of the system.
    pub(super) fn check(&self, dt: f64) -> Result<()> {
        ensure!(!self.sources.is_empty(), "video.sources is empty: there must be at least one");
        let largest = u64::from(self.size[0].max(self.size[1]));
        ensure!(
            self.size.iter().all(|side| (1..=LARGEST_SIDE).contains(side)),
            "video.size = {:?}: expected 1 to {LARGEST_SIDE} pixels a side",
            self.size
        );
        let [x, y, side] = self.crop;
        ensure!(side > 0, "video.crop = {:?}: the third number, its side, must be positive", self.crop);
        ensure!(
            side.unsigned_abs() <= largest && [x, y].iter().all(|corner| corner.unsigned_abs() <= largest),
            "video.crop = {:?}: expected a square in or about the picture of {} x {} pixels",
            self.crop,
            self.size[0],
            self.size[1]
        );
        ensure!(self.step > 0, "video.step = 0: every frame is 1");
        ensure!(self.step <= MOST_FRAMES, "video.step = {}: at most {MOST_FRAMES}", self.step);
        self.sources.iter().try_for_each(Source::check)?;
        if let Some(film_step) = self.film_step {
            ensure!(
                film_step > 0 && self.step.is_multiple_of(film_step),
                "video.film_step = {film_step}: must divide video.step = {}",
                self.step
            );
        }
        for (key, percent) in [("scale_percent", self.scale_percent), ("time_percent", self.time_percent)] {
            ensure!((0.0..100.0).contains(&percent), "video.{key} = {percent}: must be 0 to 100 per cent");
        }
        for (key, value) in [("frame_seconds", Some(self.frame_seconds)), ("pixels_per_metre", self.pixels_per_metre)] {
            let Some(value) = value else { continue };
            ensure!(value.is_finite() && value > 0.0, "video.{key} = {value}: must be a positive number");
        }
        let expected = dt_of(&self.time_unit, self.frame_seconds, self.step)
            .with_context(|| format!("video.time_unit = {:?}: one of {TIME_UNITS}", self.time_unit))?;
        ensure!(
            (dt / expected - 1.0).abs() <= SAME_TIME,
            "system.dt = {dt}: the video's frames are {} s apart (video.frame_seconds), so dt is {expected} (its unit is {:?}); \
             to change the time between frames, import the video again with --fps",
            self.frame_seconds,
            self.time_unit
        );
        let finite = self.origin.into_iter().flatten().chain([self.angle]).all(f64::is_finite);
        ensure!(finite, "video.origin = {:?}, video.angle = {}: must be finite", self.origin, self.angle);
        ensure!(self.angle.abs() <= 360.0, "video.angle = {:e}: expected -360 to 360 degrees", self.angle);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dt_goes_with_the_time_between_frames_and_sources_have_names() {
        let video = |unit: &str| Video {
            size: [64, 48],
            crop: [0, 0, 48],
            step: 3,
            film_step: None,
            time_unit: unit.into(),
            frame_seconds: 0.1,
            pixels_per_metre: None,
            scale_percent: 0.0,
            time_percent: 0.0,
            origin: None,
            angle: 0.0,
            y_up: false,
            sources: vec![Source {
                file: "a.mp4".into(),
                frames: [0, 60],
                first_seconds: 0.0,
                held_out_from: 45,
                checksum: String::new(),
            }],
        };
        for (unit, dt) in [("s", 0.1), ("ms", 100.0), ("frames", 3.0)] {
            video(unit).check(dt).unwrap();
            let said = video(unit).check(1.01 * dt).unwrap_err().to_string();
            assert!(said.contains("import the video again with --fps"), "{said}");
        }
        let with = |files: &[&str]| {
            let source = |file: &&str| Source { file: (*file).into(), ..video("s").sources[0].clone() };
            Video { sources: files.iter().map(source).collect(), ..video("s") }.source_names()
        };
        // A folder of pictures may end in a slash; files of one name are told apart by their folders.
        assert_eq!(with(&["films/throw1/", "b.mp4"]), ["throw1", "b.mp4"]);
        assert_eq!(with(&["one/clip.mp4", "two/clip.mp4", "b.mp4"]), ["one/clip.mp4", "two/clip.mp4", "b.mp4"]);
        let moved =
            Video { sources: vec![Source { file: "b.mp4".into(), ..video("s").sources[0].clone() }], ..video("s") };
        assert!(moved.says_the_same(&video("s")) && !moved.says_the_same(&Video { y_up: true, ..video("s") }));
        assert_eq!(with(&["one/clip.mp4", "one/clip.mp4"]), ["clip.mp4 0..60"; 2]);
        assert!(video("hours").check(0.1).unwrap_err().to_string().contains("s, ms, frames"));
    }
}
