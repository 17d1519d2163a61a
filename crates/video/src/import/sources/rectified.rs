//! Frames as a camera in front of the plane of the motion would film them.

use anyhow::Result;
use image::RgbImage;

use super::FrameReader;
use crate::calibration::Calibration;

/// Bilinear sample of a frame.
#[derive(Debug, Clone, Copy)]
struct BilinearSample {
    /// Pixel to the left and above.
    corner: usize,
    part: [f32; 2],
}

/// How frames are rectified.
#[derive(Debug)]
pub(super) struct Rectification {
    pub calibration: Calibration,
    /// Where each pixel of a rectified frame lies in the filmed one; none of pixels beyond it.
    samples: Vec<Option<BilinearSample>>,
}

impl Rectification {
    pub(super) fn new(calibration: &Calibration, (width, height): (u32, u32)) -> Self {
        let sample = |place: usize| {
            let at = [place % width as usize, place / width as usize].map(|it| it as f64);
            let [x, y] = calibration.filmed(at);
            let inside = (0.0..f64::from(width - 1)).contains(&x) && (0.0..f64::from(height - 1)).contains(&y);
            let part = [x.fract() as f32, y.fract() as f32];
            inside.then(|| BilinearSample { corner: y as usize * width as usize + x as usize, part })
        };
        let samples = (0..width as usize * height as usize).map(sample).collect();
        Rectification { calibration: *calibration, samples }
    }
}

/// A pass whose frames are rectified. Pixels beyond the filmed frame are black.
pub(super) struct Rectified<'a> {
    pub frames: Box<dyn FrameReader + 'a>,
    pub rectification: &'a Rectification,
}

impl FrameReader for Rectified<'_> {
    fn frame(&mut self, number: usize) -> Result<RgbImage> {
        let filmed = self.frames.frame(number)?;
        let (width, height) = filmed.dimensions();
        let (bytes, row) = (filmed.as_raw(), 3 * width as usize);
        let mut rectified = RgbImage::new(width, height);
        for (pixel, sample) in rectified.pixels_mut().zip(&self.rectification.samples) {
            let Some(BilinearSample { corner, part: [across, down] }) = sample else { continue };
            for channel in 0..3 {
                let at = |offset: usize| f32::from(bytes[3 * corner + offset + channel]);
                let above = at(0) + across * (at(3) - at(0));
                let below = at(row) + across * (at(row + 3) - at(row));
                pixel.0[channel] = (above + down * (below - above) + 0.5) as u8;
            }
        }
        Ok(rectified)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One frame that is brighter to the right.
    struct Ramp;

    impl FrameReader for Ramp {
        fn frame(&mut self, _number: usize) -> Result<RgbImage> {
            Ok(RgbImage::from_fn(400, 400, |x, _| image::Rgb([(x / 2) as u8; 3])))
        }
    }

    #[test]
    fn pixels_show_what_was_filmed_at_their_places() {
        let corners = [[100.0, 300.0], [300.0, 270.0], [300.0, 110.0], [100.0, 80.0]];
        let calibration = Calibration::new(corners, [0.4, 0.4], None).unwrap();
        let rectification = Rectification::new(&calibration, (400, 400));
        let frame = Rectified { frames: Box::new(Ramp), rectification: &rectification }.frame(0).unwrap();
        let [x, _] = calibration.filmed([180.0, 190.0]);
        // The ramp's steps are one level high and two pixels wide.
        assert!((f64::from(frame.get_pixel(180, 190).0[1]) - (x - 0.5) / 2.0).abs() < 1.1);
    }
}
