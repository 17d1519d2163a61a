//! Pictures in motion.

use std::path::Path;

use anyhow::Result;
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, DynamicImage, Frame};

use super::canvas::Canvas;
use crate::support::atomic;

/// Milliseconds. A GIF counts in hundredths of a second, so 8 frames a second cannot be had exactly.
const FRAME_TIME: u32 = 120;
const LAST_FRAME_TIME: u32 = 1200;
/// 1 (best colours) to 30 (fastest); the slowest ones take minutes for no visible gain.
const QUANTISER_SPEED: i32 = 10;

/// Writes `frames` pictures as an animation, endless, about 8 of them a second; the last one stands longer.
pub fn write(path: &Path, frames: usize, draw: impl Fn(usize) -> Result<Canvas>) -> Result<()> {
    atomic::write_file(path, |file| {
        let mut encoder = GifEncoder::new_with_speed(file, QUANTISER_SPEED);
        encoder.set_repeat(Repeat::Infinite)?;
        for frame in 0..frames {
            let pixels = DynamicImage::ImageRgb8(draw(frame)?.pixels().clone()).into_rgba8();
            let time = if frame + 1 == frames { LAST_FRAME_TIME } else { FRAME_TIME };
            encoder.encode_frame(Frame::from_parts(pixels, 0, 0, Delay::from_numer_denom_ms(time, 1)))?;
        }
        Ok(())
    })
}
