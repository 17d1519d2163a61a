//! How a video was filmed, where the file does not say.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use paig_track::calibration::Lens;

use super::SourceVideo;
use crate::calibration::Calibration;
use crate::import::stated::WIDTHS;

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
        self.check(&video).with_context(|| format!("video {}", path.display()))?;
        Ok(video)
    }

    /// Holds the statements against the video.
    fn check(&self, video: &SourceVideo) -> Result<()> {
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
        if let Some(ReferenceRectangle { corners, sides, .. }) = self.plane {
            let (width, height) = (f64::from(video.width), f64::from(video.height));
            for [x, y] in corners {
                ensure!(
                    (0.0..=width).contains(&x) && (0.0..=height).contains(&y),
                    "--plane: the corner {x},{y} is outside the picture of {width} x {height} pixels"
                );
            }
            for side in sides {
                ensure!(
                    (WIDTHS[0]..=WIDTHS[1]).contains(&side),
                    "--plane: a side of {side:e} m; expected {:e} to {:e} m",
                    WIDTHS[0],
                    WIDTHS[1]
                );
            }
        }
        Ok(())
    }

    /// The plane of the motion in a video, if one was given.
    ///
    /// # Errors
    /// Corners that are not those of a rectangle.
    pub fn calibration(&self, video: &SourceVideo) -> Result<Option<Calibration>> {
        let of = |ReferenceRectangle { corners, sides, distortion }: ReferenceRectangle| {
            let lens = distortion.map(|k| Lens::new(k, video.width as usize, video.height as usize));
            Calibration::new(corners, sides, lens)
        };
        self.plane.map(of).transpose()
    }
}
