//! The square that is cut out of each frame.

use anyhow::{Result, ensure};
use image::{RgbImage, imageops};

use super::scaling::scaled;

/// What is to be cut out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CropChoice {
    /// Around what moves.
    Auto,
    /// The whole frame.
    Full,
    /// A rectangle, squared.
    Rectangle(CropRectangle),
}

/// A rectangle within a frame: its top left corner, width and height, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CropRectangle {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

/// A square that may stick out of the frame, where it is black.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Square {
    pub x: i64,
    pub y: i64,
    pub side: u32,
}

impl CropRectangle {
    /// The smallest rectangle around both.
    pub fn joined(self, other: Self) -> Self {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let right = (self.x + self.width).max(other.x + other.width);
        let bottom = (self.y + self.height).max(other.y + other.height);
        CropRectangle { x, y, width: right - x, height: bottom - y }
    }

    /// The shorter side grows about its middle. The square is moved into a frame of `width` x `height`; in one that is
    /// too narrow for it, it lies in the middle and sticks out on both sides.
    ///
    /// # Errors
    /// A rectangle that is empty or not within the frame.
    pub fn squared(self, width: u32, height: u32) -> Result<Square> {
        let within = |start: u32, length: u32, all: u32| start.checked_add(length).is_some_and(|end| end <= all);
        ensure!(
            self.width > 0
                && self.height > 0
                && within(self.x, self.width, width)
                && within(self.y, self.height, height),
            "crop {},{},{},{}: must lie within the frames of {width} x {height}",
            self.x,
            self.y,
            self.width,
            self.height
        );
        let side = self.width.max(self.height);
        let place = |start: u32, length: u32, all: u32| {
            let start = i64::from(start) - i64::from(side - length) / 2;
            let room = i64::from(all) - i64::from(side);
            if room >= 0 { start.clamp(0, room) } else { room / 2 }
        };
        Ok(Square { x: place(self.x, self.width, width), y: place(self.y, self.height, height), side })
    }
}

impl Square {
    /// Cuts the square out of a frame and scales it to `side` x `side` pixels: averages where it shrinks.
    pub fn cut(self, frame: &RgbImage, side: u32) -> RgbImage {
        let (width, height) = frame.dimensions();
        let inside = |start: i64, all: u32| start >= 0 && start + i64::from(self.side) <= i64::from(all);
        if inside(self.x, width) && inside(self.y, height) {
            return scaled(frame, (self.x as u32, self.y as u32), (self.side, self.side), (side, side));
        }
        let mut square = RgbImage::new(self.side, self.side);
        imageops::replace(&mut square, frame, -self.x, -self.y);
        scaled(&square, (0, 0), (self.side, self.side), (side, side))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_grow_to_squares_within_the_frame() {
        let square = |x, y, width, height| CropRectangle { x, y, width, height }.squared(100, 60).unwrap();
        assert_eq!(square(10, 10, 20, 30), Square { x: 5, y: 10, side: 30 });
        assert_eq!(square(0, 0, 20, 30), Square { x: 0, y: 0, side: 30 });
        assert_eq!(square(70, 40, 30, 20), Square { x: 70, y: 30, side: 30 });
        assert_eq!(square(0, 0, 100, 60), Square { x: 0, y: -20, side: 100 });
        for (x, y, width, height) in [(0, 0, 0, 5), (90, 0, 11, 5), (0, 60, 5, 1), (u32::MAX, 0, 5, 5)] {
            assert!(CropRectangle { x, y, width, height }.squared(100, 60).is_err());
        }
    }

    #[test]
    fn what_sticks_out_is_black() {
        let frame = RgbImage::from_pixel(100, 60, image::Rgb([200; 3]));
        let cut = Square { x: 0, y: -20, side: 100 }.cut(&frame, 20);
        assert_eq!((cut[(10, 1)].0, cut[(10, 10)].0, cut[(10, 18)].0), ([0; 3], [200; 3], [0; 3]));
    }
}
