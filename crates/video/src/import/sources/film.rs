//! Frames of a film by their numbers, with square pixels.

use anyhow::{Context, Result};
use image::RgbImage;
use paig_decode::{Frame, VideoFile};
use paig_resize::{RgbPicture, SourceRectangle};

use super::FrameReader;

/// Part by which a pixel may be wider than high, or less wide, and count as square: the rounding of a converter's sides.
const SQUARE: f64 = 1e-4;

/// The size of frames of so many pixels, each `aspect` times as wide as high, in square pixels; the longer side of a pixel counts.
pub(super) fn square((width, height): (u32, u32), aspect: f64) -> (u32, u32) {
    let scaled = |side: u32, by: f64| ((f64::from(side) * by).round() as u32).max(1);
    match aspect {
        _ if (aspect - 1.0).abs() <= SQUARE => (width, height),
        _ if aspect > 1.0 => (scaled(width, aspect), height),
        _ => (width, scaled(height, 1.0 / aspect)),
    }
}

/// A pass through a film from the first frame that is asked for on.
pub(super) struct FilmPass<'a> {
    video: &'a VideoFile,
    /// Of the frames that are given.
    size: (u32, u32),
    ahead: Option<paig_decode::Frames>,
    at: Option<Frame>,
}

impl<'a> FilmPass<'a> {
    pub(super) fn new(video: &'a VideoFile, size: (u32, u32)) -> Self {
        FilmPass { video, size, ahead: None, at: None }
    }
}

impl FrameReader for FilmPass<'_> {
    fn frame(&mut self, number: usize) -> Result<RgbImage> {
        if self.ahead.is_none() {
            self.ahead = Some(self.video.frames_from(number)?);
        }
        let ahead = self.ahead.as_mut().expect("it was just opened");
        while self.at.as_ref().is_none_or(|at| at.number() < number) {
            let next = ahead.next().with_context(|| format!("it ends before frame {number}"))?;
            self.at = Some(next?);
        }
        let frame = self.at.as_ref().expect("it was just decoded").rgb();
        if frame.dimensions() == self.size {
            return Ok(frame);
        }
        let (width, height) = frame.dimensions();
        let whole = SourceRectangle { x: 0, y: 0, width, height };
        let scaled = paig_resize::scaled(RgbPicture { width, height, pixels: frame.as_raw() }, whole, self.size);
        Ok(RgbImage::from_raw(self.size.0, self.size.1, scaled).expect("three bytes for each pixel"))
    }
}

#[cfg(test)]
mod tests {
    use super::square;

    #[test]
    fn pixels_become_square_by_growing() {
        assert_eq!(square((720, 576), 1.0), (720, 576));
        // PAL DV, 4:3: 16 to 15.
        assert_eq!(square((720, 576), 16.0 / 15.0), (768, 576));
        assert_eq!(square((640, 480), 0.5), (640, 960));
    }
}
