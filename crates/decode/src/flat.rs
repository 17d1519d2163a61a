//! Pictures with transparency, made opaque.

use image::{Rgb, RgbImage, RgbaImage};

/// The picture over black: the colour of transparent pixels, which nobody is meant to see, does not show.
pub(crate) fn over_black(picture: &RgbaImage) -> RgbImage {
    RgbImage::from_fn(picture.width(), picture.height(), |x, y| {
        let [red, green, blue, alpha] = picture.get_pixel(x, y).0.map(u32::from);
        Rgb([red, green, blue].map(|level| ((level * alpha + 127) / 255) as u8))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgba;

    #[test]
    fn hidden_colours_do_not_show() {
        let picture = RgbaImage::from_fn(3, 1, |x, _| Rgba([200, 100, 50, [0, 128, 255][x as usize]]));
        assert_eq!(over_black(&picture).into_raw(), [0, 0, 0, 100, 50, 25, 200, 100, 50]);
    }
}
