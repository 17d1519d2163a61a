//! How a video was filmed, where the file does not say.

use std::path::Path;

use anyhow::Result;
use paig_track::calibration::Lens;

use super::SourceVideo;
use crate::calibration::Calibration;

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

impl Filming {
    /// Opens a video: with the frames and times that it was filmed with, not yet rectified.
    ///
    /// # Errors
    /// As [`SourceVideo::open`]; fields of an array.
    pub fn open(&self, path: &Path) -> Result<SourceVideo> {
        let video = SourceVideo::open(path)?;
        let video = if self.fields { video.in_fields()? } else { video };
        Ok(match self.fps {
            Some(fps) => video.at_rate(fps),
            None => video,
        })
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
