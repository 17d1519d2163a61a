//! Frames made smaller: every pixel of the video counts, so a motion by a part of a small pixel still shows.

use fast_image_resize::images::{Image, ImageRef};
use fast_image_resize::{FilterType, PixelType, ResizeAlg, ResizeOptions, Resizer};
use image::RgbImage;

/// A part of a frame, from `(x, y)` on and `size` large, as a picture of `width` x `height` pixels: linear weights as wide
/// as the pixels of the picture.
///
/// # Panics
/// If the part is empty or not within the frame.
pub(super) fn scaled(frame: &RgbImage, (x, y): (u32, u32), size: (u32, u32), (width, height): (u32, u32)) -> RgbImage {
    let whole = ImageRef::new(frame.width(), frame.height(), frame.as_raw(), PixelType::U8x3);
    let mut picture = Image::new(width, height, PixelType::U8x3);
    let [left, top, across, down] = [x, y, size.0, size.1].map(f64::from);
    let options =
        ResizeOptions::new().crop(left, top, across, down).resize_alg(ResizeAlg::Convolution(FilterType::Bilinear));
    let whole = whole.expect("three bytes for each pixel");
    Resizer::new().resize(&whole, &mut picture, &options).expect("the part lies within the frame");
    RgbImage::from_raw(width, height, picture.into_vec()).expect("three bytes for each pixel")
}
