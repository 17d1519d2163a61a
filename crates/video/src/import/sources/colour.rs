//! From the planes of a film to RGB.

use image::{Rgb, RgbImage};
use rusty_h264_common::YuvFrame;

/// From this height on films have the colours of HDTV (ITU-R BT.709), below those of BT.601, where nothing else is said.
const HD_HEIGHT: usize = 720;

/// Luma 16 to 235 and chroma at half the resolution, as films have them, to RGB.
pub(super) fn to_rgb(frame: &YuvFrame) -> RgbImage {
    // Weights of red and blue in the luma.
    let (red, blue) = if frame.height >= HD_HEIGHT { (0.2126, 0.0722) } else { (0.299, 0.114) };
    let green = 1.0 - red - blue;
    let (of_luma, of_chroma) = (255.0 / 219.0, 255.0 / 112.0);
    let fixed = |weight: f64| (weight * f64::from(1 << 16)).round() as i32;
    let luma = fixed(of_luma);
    let (v_red, u_blue) = (fixed(of_chroma * (1.0 - red)), fixed(of_chroma * (1.0 - blue)));
    let v_green = fixed(of_chroma * (1.0 - red) * red / green);
    let u_green = fixed(of_chroma * (1.0 - blue) * blue / green);
    let half = frame.width.div_ceil(2);
    RgbImage::from_fn(frame.width as u32, frame.height as u32, |x, y| {
        let (x, y) = (x as usize, y as usize);
        let chroma = (y / 2) * half + x / 2;
        let level = (i32::from(frame.y[y * frame.width + x]) - 16) * luma + (1 << 15);
        let (u, v) = (i32::from(frame.u[chroma]) - 128, i32::from(frame.v[chroma]) - 128);
        let byte = |value: i32| (value >> 16).clamp(0, 255) as u8;
        Rgb([byte(level + v_red * v), byte(level - v_green * v - u_green * u), byte(level + u_blue * u)])
    })
}
