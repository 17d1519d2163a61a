//! Interlaced frames split into their two fields, each with its own time.

use image::{GrayImage, ImageBuffer, Pixel, RgbImage};

use crate::error::Result;
use crate::frame::Frame;
use crate::info::Fields;

/// Lines of a frame that one field recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Parity {
    Even,
    Odd,
}

impl Parity {
    /// The two fields of a frame in the order of their times. An unknown order is that of most cameras.
    pub(crate) fn in_order(fields: Fields) -> [Parity; 2] {
        match fields {
            Fields::BottomFirst => [Parity::Odd, Parity::Even],
            Fields::TopFirst | Fields::Unknown => [Parity::Even, Parity::Odd],
        }
    }

    fn has(self, row: usize) -> bool {
        row.is_multiple_of(2) == (self == Parity::Even)
    }

    /// A frame's picture with the lines of the other field replaced by the mean of their neighbours: places keep their
    /// coordinates.
    pub(crate) fn rgb(self, picture: RgbImage) -> RgbImage {
        self.filled(picture)
    }

    /// The same of grey levels.
    pub(crate) fn grey(self, picture: GrayImage) -> GrayImage {
        self.filled(picture)
    }

    fn filled<P: Pixel<Subpixel = u8>>(self, mut picture: ImageBuffer<P, Vec<u8>>) -> ImageBuffer<P, Vec<u8>> {
        let (height, stride) = (picture.height() as usize, picture.width() as usize * usize::from(P::CHANNEL_COUNT));
        if height < 2 {
            return picture;
        }
        for row in (0..height).filter(|row| !self.has(*row)) {
            let (above, below) = (row.checked_sub(1).unwrap_or(1), if row + 1 < height { row + 1 } else { row - 1 });
            let mean: Vec<u8> = (0..stride)
                .map(|x| {
                    let level = |row: usize| u16::from(picture.as_raw()[row * stride + x]);
                    (level(above) + level(below)).div_ceil(2) as u8
                })
                .collect();
            let levels: &mut [u8] = &mut picture;
            levels[row * stride..(row + 1) * stride].copy_from_slice(&mean);
        }
        picture
    }
}

/// Times of the fields of frames with these times: the second field half a frame after the first.
pub(crate) fn times(frames: &[f64]) -> Vec<f64> {
    let step = |frame: usize| match (frames.get(frame + 1), frame.checked_sub(1)) {
        (Some(next), _) => next - frames[frame],
        (None, Some(before)) => frames[frame] - frames[before],
        (None, None) => 0.0,
    };
    (0..frames.len()).flat_map(|frame| [frames[frame], frames[frame] + 0.5 * step(frame)]).collect()
}

/// The fields of frames, from a field's number on.
pub(crate) struct SplitFields<I> {
    pub(crate) frames: I,
    pub(crate) order: [Parity; 2],
    pub(crate) times: Option<Vec<f64>>,
    /// Number of the next field.
    pub(crate) next: usize,
    pub(crate) frame: Option<Frame>,
}

impl<I: Iterator<Item = Result<Frame>>> Iterator for SplitFields<I> {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.frame.as_ref().is_none_or(|frame| frame.number < self.next / 2) {
            match self.frames.next()? {
                Ok(frame) => self.frame = Some(frame),
                Err(error) => return Some(Err(error)),
            }
        }
        let number = self.next;
        self.next += 1;
        let seconds = self.times.as_ref().and_then(|times| times.get(number).copied());
        self.frame.clone().map(|frame| Ok(Frame { number, seconds, field: Some(self.order[number % 2]), ..frame }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Luma;

    #[test]
    fn the_lines_of_the_other_field_are_means_of_their_neighbours() {
        let picture = GrayImage::from_fn(2, 5, |_, y| Luma([[10, 200, 30, 202, 50][y as usize]]));
        assert_eq!(Parity::Even.grey(picture.clone()).into_raw(), [10, 10, 20, 20, 30, 30, 40, 40, 50, 50]);
        assert_eq!(Parity::Odd.grey(picture).into_raw(), [200, 200, 200, 200, 201, 201, 202, 202, 202, 202]);
    }

    #[test]
    fn the_second_field_comes_half_a_frame_later() {
        assert_eq!(times(&[0.0, 0.04, 0.1]), [0.0, 0.02, 0.04, 0.07, 0.1, 0.13]);
    }
}
