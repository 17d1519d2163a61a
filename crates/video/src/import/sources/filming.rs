//! How a video was filmed, where the file does not say.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use paig_track::calibration::Lens;

use super::SourceVideo;
use crate::calibration::Calibration;
use crate::import::stated::check_width;

/// Facts of the filming that a person knows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Filming {
    /// Frames a second, in place of the video's own times.
    pub fps: Option<f64>,
    /// How many times as slow as it was filmed the video plays; by its tags where absent.
    pub slow_motion: Option<f64>,
    /// Whether frames are split into their two fields.
    pub fields: bool,
    /// Time from the first to the last row of a frame, seconds.
    pub readout: Option<f64>,
    pub plane: Option<ReferenceRectangle>,
}

/// Rectangle of known size in the plane of the motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceRectangle {
    /// Bottom left, bottom right, top right and top left, pixels of the video from its top left corner.
    pub corners: [[f64; 2]; 4],
    /// Width and height, metres.
    pub sides: [f64; 2],
    /// Radial distortion of the lens, see [`Lens`].
    pub distortion: Option<f64>,
}

/// Foreshortening of the plane beyond which its far parts show little: 75 degrees from the front.
const OBLIQUE: f64 = 4.0;
/// Factors of slow motion that can be: a frame in a month played in a second, and a streak camera.
const FACTORS: [f64; 2] = [1e-8, 1e12];
/// Longest time in which a frame is read out where the time between frames is not known, seconds.
const LONGEST_READOUT: f64 = 1.0;

/// # Errors
/// A factor of slow motion that cannot be.
pub fn check_slow_motion(factor: f64) -> Result<()> {
    ensure!(
        (FACTORS[0]..=FACTORS[1]).contains(&factor),
        "--slow-motion {factor:e}: expected {:e} to {:e}",
        FACTORS[0],
        FACTORS[1]
    );
    Ok(())
}

impl Filming {
    /// Opens a video: with the frames and times that it was filmed with, not yet rectified.
    ///
    /// # Errors
    /// As [`SourceVideo::open`]; fields of an array.
    pub fn open(&self, path: &Path) -> Result<SourceVideo> {
        let video = SourceVideo::open(path)?;
        let video = if self.fields { video.in_fields()? } else { video };
        let video = match self.fps {
            Some(fps) => video.at_rate(fps),
            None => video,
        };
        let doubts = self.check(&video).with_context(|| format!("video {}", path.display()))?;
        let remarks = [&video.remarks[..], &doubts].concat();
        Ok(SourceVideo { remarks, ..video })
    }

    /// Holds the statements against the video. Returns warnings.
    fn check(&self, video: &SourceVideo) -> Result<Vec<String>> {
        let mut doubts = Vec::new();
        if let Some(factor) = self.slow_motion {
            check_slow_motion(factor)?;
        }
        if let Some(readout) = self.readout {
            let interval =
                video.times.as_deref().and_then(|times| Some((times.last()? - times[0]) / (times.len() - 1) as f64));
            let most = interval.filter(|interval| *interval > 0.0).unwrap_or(LONGEST_READOUT);
            ensure!(
                readout.abs() <= most,
                "--readout {:e}: a frame is read out within the {:.4} ms until the next one",
                1e3 * readout,
                1e3 * most
            );
        }
        if let Some(ReferenceRectangle { corners, sides: [across, up], .. }) = self.plane {
            let (width, height) = (f64::from(video.width), f64::from(video.height));
            for [x, y] in corners {
                ensure!(
                    (0.0..=width).contains(&x) && (0.0..=height).contains(&y),
                    "--plane: the corner {x},{y} is outside the picture of {width} x {height} pixels"
                );
            }
            if let Some(calibration) = self.calibration(video).context("--plane")? {
                let stated = format!("--plane: a rectangle of {across:?} x {up:?} m makes");
                doubts.extend(check_width(&stated, width / calibration.pixels_per_metre)?);
                if calibration.foreshortening > OBLIQUE {
                    doubts.push(format!(
                        "--plane: a rectangle of {across:?} x {up:?} m is seen at {:.0} degrees from its front: check its width and height, \
                         in this order",
                        (1.0 / calibration.foreshortening).acos().to_degrees()
                    ));
                }
            }
        }
        Ok(doubts)
    }

    /// The plane of the motion in a video, if one was given.
    ///
    /// # Errors
    /// Corners that are not those of the rectangle, a lens that folds the picture over.
    pub fn calibration(&self, video: &SourceVideo) -> Result<Option<Calibration>> {
        let of = |ReferenceRectangle { corners, sides, distortion }: ReferenceRectangle| {
            let lens = distortion.map(|k| Lens::new(k, video.width as usize, video.height as usize)).transpose();
            Calibration::new(corners, sides, lens.context("--distortion")?)
        };
        self.plane.map(of).transpose()
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use image::codecs::gif::GifEncoder;
    use image::{Delay, Frame, RgbaImage};

    use super::*;

    /// Statements about a gif of 200 x 100 pixels and 10 frames a second, and what is said of them: an error or a warning.
    #[test]
    fn statements_are_held_against_the_picture() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.gif");
        let mut gif = GifEncoder::new(File::create(&path).unwrap());
        for _ in 0..12 {
            let delay = Delay::from_numer_denom_ms(100, 1);
            gif.encode_frame(Frame::from_parts(RgbaImage::new(200, 100), 0, 0, delay)).unwrap();
        }
        drop(gif);
        let corners = [[50.0, 80.0], [150.0, 80.0], [150.0, 30.0], [50.0, 30.0]];
        let plane = |sides, distortion| Filming {
            plane: Some(ReferenceRectangle { corners, sides, distortion }),
            ..Filming::default()
        };
        let slow = |factor| Filming { slow_motion: Some(factor), ..Filming::default() };
        for (filming, said) in [
            (plane([1.0, 0.5], None), Ok("")),
            (plane([1.0, 0.5], Some(-0.3)), Ok("")),
            (plane([1.0, 2.5], None), Ok("is seen at 78 degrees from its front")),
            (plane([1e-7, 5e-8], None), Ok("m wide; usual are 1e-6 to 1e5 m")),
            (plane([1e9, 1e-9], None), Err("--plane: expected a rectangle of 1000000000.0 x 1e-9 m")),
            (plane([1e20, 5e19], None), Err("m wide; expected 1e-9 to 1e12 m")),
            (plane([0.5, 1.0], Some(100.0)), Err("--distortion: expected a coefficient")),
            (slow(1000.0), Ok("")),
            (slow(1e15), Err("--slow-motion 1e15: expected")),
        ] {
            match (filming.open(&path), said) {
                (Ok(video), Ok(said)) => {
                    let remarks = video.remarks.join("; ");
                    assert!(remarks.contains(said) && remarks.is_empty() == said.is_empty(), "{filming:?}: {remarks}");
                }
                (Err(error), Err(said)) => assert!(format!("{error:#}").contains(said), "{filming:?}: {error:#}"),
                (opened, _) => panic!("{filming:?}: {opened:?}"),
            }
        }
        assert!(SourceVideo::open(&path).unwrap().timed(Some(1e6)).remarks[1].contains("check --fps or --slow-motion"));
    }
}
