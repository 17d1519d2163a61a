//! Statements of the user about videos, held against the videos themselves.

use anyhow::{Result, ensure};
use paig_track::{FASTEST, Finding};

use super::sources::SourceVideo;
use super::tracker::TrackerFile;

/// Widths of a picture that can be, metres: from a few atoms to the inner solar system.
const WIDTHS: [f64; 2] = [1e-9, 1e12];
/// Widths that are usual, metres: from one through a microscope to one from a satellite.
const USUAL_WIDTHS: [f64; 2] = [1e-6, 1e5];
/// Frames a second that can be: one in a month, and a streak camera.
const RATES: [f64; 2] = [1e-7, 1e12];
/// Picture sides by which the origin of the axes may lie outside.
const FAR: f64 = 1000.0;
/// Degrees of a full turn.
const FULL_TURN: f64 = 360.0;
/// Part by which the frame rate of a Tracker file may differ from the video's.
const SAME_RATE: f64 = 0.02;

/// Holds the width that a statement gives the picture, metres, against what is filmed. Returns a warning about an unusual one.
///
/// # Errors
/// A width that cannot be.
pub(super) fn check_width(stated: &str, width: f64) -> Result<Option<String>> {
    let within = |[least, most]: [f64; 2]| (least..=most).contains(&width);
    let [least, most] = WIDTHS;
    ensure!(within(WIDTHS), "{stated} the picture {width:e} m wide; expected {least:e} to {most:e} m");
    let [least, most] = USUAL_WIDTHS;
    let advice = || {
        format!(
            "{stated} the picture {width:.3e} m wide; usual are {least:e} to {most:e} m: check the lengths, in metres"
        )
    };
    Ok((!within(USUAL_WIDTHS)).then(advice))
}

/// Scale, axes and time of videos as the user states them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Stated {
    /// See [`Video`](paig::tasks::video::Video).
    pub pixels_per_metre: Option<f64>,
    pub scale_percent: f64,
    pub time_percent: f64,
    pub origin: Option<[f64; 2]>,
    pub angle: f64,
    /// Frames a second.
    pub fps: Option<f64>,
    /// Points in the video between which the scale was measured.
    pub scale_points: Option<[[f64; 2]; 2]>,
    pub tracker: Option<TrackerFile>,
}

impl Stated {
    /// Checks the statements against a video. Returns warnings.
    ///
    /// # Errors
    /// Values that cannot be of this video.
    pub fn check(&self, video: &SourceVideo) -> Result<Vec<String>> {
        let (width, height) = (f64::from(video.width), f64::from(video.height));
        if let Some(fps) = self.fps {
            ensure!((RATES[0]..=RATES[1]).contains(&fps), "--fps {fps:e}: expected {:e} to {:e}", RATES[0], RATES[1]);
        }
        ensure!(self.angle.abs() <= FULL_TURN, "--angle {:e}: expected -360 to 360 degrees", self.angle);
        for (option, percent) in [("scale", self.scale_percent), ("time", self.time_percent)] {
            ensure!((0.0..=100.0).contains(&percent), "--{option}-percent {percent:e}: expected 0 to 100 per cent");
        }
        ensure!(
            self.scale_percent == 0.0 || self.pixels_per_metre.is_some(),
            "--scale-percent {}: no scale is given; add --scale or --pixels-per-metre",
            self.scale_percent
        );
        for [x, y] in self.scale_points.into_iter().flatten() {
            ensure!(
                (0.0..=width).contains(&x) && (0.0..=height).contains(&y),
                "--scale: the point {x},{y} is outside the picture of {width} x {height} pixels"
            );
        }
        let of_width = |pixels: f64| check_width(&format!("{pixels:e} pixels to a metre make"), width / pixels);
        let doubt = self.pixels_per_metre.map(of_width).transpose()?.flatten();
        if let Some([x, y]) = self.origin {
            let far = FAR * width.max(height);
            ensure!(
                x.abs() <= far && y.abs() <= far,
                "--origin {x:e},{y:e}: more than {FAR} picture sides away from the picture of {width} x {height} pixels"
            );
        }
        let other_time = self.tracker.iter().filter_map(|tracker| self.time_of(tracker, video));
        let too_fast = self.fps.filter(|fps| *fps > FASTEST).map(|rate| Finding::TooFast { rate }.line());
        Ok(doubt.into_iter().chain(too_fast).chain(other_time).collect())
    }

    /// A warning where the time base of a Tracker file is not the video's, and no frame rate is given besides.
    fn time_of(&self, tracker: &TrackerFile, video: &SourceVideo) -> Option<String> {
        let own = video.file_rate?;
        let said = tracker.fps.filter(|fps| self.fps == Some(*fps) && (fps / own - 1.0).abs() > SAME_RATE)?;
        Some(format!(
            "{}: the Tracker file has {said:.2} frames a second, the video {own:.2}; if the video is not slow motion, the file \
             may be of another video: set --fps",
            video.name()
        ))
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;

    /// A gif of 40 x 20 pixels with 10 frames a second.
    fn video() -> (tempfile::TempDir, SourceVideo) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gif");
        let mut encoder = image::codecs::gif::GifEncoder::new(std::fs::File::create(&path).unwrap());
        for level in 0..12 {
            let frame = image::DynamicImage::from(RgbImage::from_pixel(40, 20, Rgb([20 * level; 3]))).into_rgba8();
            let delay = image::Delay::from_numer_denom_ms(100, 1);
            encoder.encode_frame(image::Frame::from_parts(frame, 0, 0, delay)).unwrap();
        }
        drop(encoder);
        let video = SourceVideo::open(&path).unwrap();
        (folder, video)
    }

    #[test]
    fn impossible_statements_are_refused() {
        let (_folder, video) = video();
        let stated = Stated::default();
        let points = |x, y| Some([[1.0, 1.0], [x, y]]);
        for (wrong, reason) in [
            (Stated { scale_points: points(41.0, 1.0), ..stated.clone() }, "outside the picture of 40 x 20"),
            (Stated { scale_points: points(1.0, -3.0), ..stated.clone() }, "the point 1,-3"),
            (Stated { pixels_per_metre: Some(1e-300), ..stated.clone() }, "m wide"),
            (Stated { pixels_per_metre: Some(1e308), ..stated.clone() }, "m wide"),
            (Stated { origin: Some([1e300, 0.0]), ..stated.clone() }, "--origin"),
            (Stated { scale_percent: 1.0, ..stated.clone() }, "no scale is given"),
            (Stated { angle: f64::NAN, ..stated.clone() }, "--angle"),
            (Stated { angle: 1e300, ..stated.clone() }, "--angle 1e300"),
            (Stated { time_percent: 1e9, ..stated.clone() }, "--time-percent 1e9"),
            (Stated { time_percent: -1.0, ..stated.clone() }, "--time-percent"),
            (Stated { scale_percent: f64::NAN, pixels_per_metre: Some(1.0), ..stated.clone() }, "--scale-percent"),
            (Stated { fps: Some(1e300), ..stated.clone() }, "--fps"),
        ] {
            let error = wrong.check(&video).unwrap_err().to_string();
            assert!(error.contains(reason) && error.len() < 160, "{error}");
        }
        let right = Stated {
            scale_points: points(40.0, 20.0),
            pixels_per_metre: Some(100.0),
            scale_percent: 1.0,
            // A pivot above the picture.
            origin: Some([20.0, -300.0]),
            fps: Some(240.0),
            ..stated
        };
        assert_eq!(right.check(&video).unwrap(), [""; 0]);
    }

    /// Microscopes and satellites are usual; what is 1000 times beyond them is rather a mistake in the unit.
    #[test]
    fn unusual_widths_are_warned_about() {
        let (_folder, video) = video();
        for (width, doubtful) in [(2e-6, false), (3.0, false), (9e4, false), (4e-9, true), (1e9, true)] {
            let stated = Stated { pixels_per_metre: Some(40.0 / width), ..Stated::default() };
            let warnings = stated.check(&video).unwrap();
            assert_eq!(warnings.len(), usize::from(doubtful), "{width}: {warnings:?}");
            assert!(warnings.iter().all(|it| it.contains(&format!("{width:.3e} m wide"))), "{warnings:?}");
        }
    }

    #[test]
    fn the_time_base_of_another_video_is_warned_about() {
        let of = |rate: f64, fps: f64| {
            let (_folder, video) = video();
            let tracker = TrackerFile { pixels_per_metre: 9.0, origin: [0.0; 2], angle: 0.0, fps: Some(rate) };
            let stated = Stated { tracker: Some(tracker), fps: Some(fps), ..Stated::default() };
            stated.check(&video.at_rate(fps)).unwrap()
        };
        assert!(of(4.0, 4.0)[0].contains("4.00 frames a second, the video 10.00"));
        assert_eq!([of(10.0, 10.0), of(4.0, 10.0)], [[""; 0]; 2]);
    }
}
