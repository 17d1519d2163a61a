//! Frames made smaller: every pixel of the video counts, so a motion by a part of a small pixel still shows.

use image::RgbImage;
use paig_resize::{RgbPicture, SourceRectangle};

/// A part of a frame, from `(x, y)` on and `size` large, as a picture of `width` x `height` pixels: linear weights as wide
/// as the pixels of the picture.
///
/// # Panics
/// If the part is empty or not within the frame.
pub(super) fn scaled(frame: &RgbImage, (x, y): (u32, u32), size: (u32, u32), (width, height): (u32, u32)) -> RgbImage {
    let whole = RgbPicture { width: frame.width(), height: frame.height(), pixels: frame.as_raw() };
    let part = SourceRectangle { x, y, width: size.0, height: size.1 };
    let picture = paig_resize::scaled(whole, part, (width, height));
    RgbImage::from_raw(width, height, picture).expect("three bytes for each pixel")
}
