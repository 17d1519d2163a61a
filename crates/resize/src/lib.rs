//! Scaling of pictures.
//!
//! A crate of its own: the generic code of the library behind it is compiled again whenever its caller is.

use fast_image_resize::images::{TypedImage, TypedImageRef};
use fast_image_resize::pixels::U8x3;
use fast_image_resize::{FilterType, ResizeAlg, ResizeOptions, Resizer};

/// An RGB picture, `[height, width, 3]`, 8 bits each.
#[derive(Debug, Clone, Copy)]
pub struct RgbPicture<'a> {
    pub width: u32,
    pub height: u32,
    pub pixels: &'a [u8],
}

/// A rectangle of a picture, pixels.
#[derive(Debug, Clone, Copy)]
pub struct SourceRectangle {
    pub x: u32,
    pub y: u32,
    pub width: u32,
    pub height: u32,
}

/// Scales a rectangle of a picture to `[height, width, 3]` by a triangular filter as wide as the pixels of the result (at
/// least as those of the picture).
///
/// # Panics
/// If the rectangle is empty or not within the picture, or the picture has not three bytes for each pixel.
pub fn scaled(picture: RgbPicture, rectangle: SourceRectangle, (width, height): (u32, u32)) -> Vec<u8> {
    let RgbPicture { width: columns, height: rows, pixels } = picture;
    let whole = TypedImageRef::<U8x3>::from_buffer(columns, rows, pixels).expect("three bytes for each pixel");
    let mut result = TypedImage::<U8x3>::new(width, height);
    let SourceRectangle { x, y, width, height } = rectangle;
    let [left, top, across, down] = [x, y, width, height].map(f64::from);
    let options =
        ResizeOptions::new().crop(left, top, across, down).resize_alg(ResizeAlg::Convolution(FilterType::Bilinear));
    Resizer::new().resize_typed(&whole, &mut result, &options).expect("the rectangle lies within the picture");
    result.pixels().iter().flat_map(|pixel| pixel.0).collect()
}
