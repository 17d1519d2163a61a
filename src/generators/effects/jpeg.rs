//! Lossy compression of the files.

use anyhow::{Context, Result};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageFormat, load_from_memory_with_format};

/// Compresses each frame, uint8 `[frames, side, side, channels]`, as a JPEG of this quality, 1 to 100, and reads it back.
///
/// # Errors
/// None that is known: the encoder takes frames of one or three channels.
pub(crate) fn compress(frames: &mut [u8], side: usize, channels: usize, quality: u8) -> Result<()> {
    let colours = if channels == 1 { ExtendedColorType::L8 } else { ExtendedColorType::Rgb8 };
    for frame in frames.chunks_exact_mut(side * side * channels) {
        let mut file = Vec::new();
        let mut encoder = JpegEncoder::new_with_quality(&mut file, quality);
        encoder.encode(frame, side as u32, side as u32, colours).context("cannot compress a frame as JPEG")?;
        let picture = load_from_memory_with_format(&file, ImageFormat::Jpeg).context("cannot read a JPEG back")?;
        frame.copy_from_slice(&if channels == 1 {
            picture.into_luma8().into_raw()
        } else {
            picture.into_rgb8().into_raw()
        });
    }
    Ok(())
}
