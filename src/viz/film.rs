//! Frames in motion, without anything around them.

use std::path::Path;

use anyhow::Result;
use tch::Tensor;

use super::canvas::{Canvas, pictures};
use super::gif;

/// Writes frames `[n, C, S, S]` in \[0, 1\] as an endless animation, every pixel `times` as large.
///
/// # Errors
/// A file that cannot be written, frames with neither 1 nor 3 channels.
pub fn write_film(path: &Path, frames: &Tensor, times: u32) -> Result<()> {
    let pictures = pictures(frames, times)?;
    gif::write(path, pictures.len(), |frame| {
        let (width, height) = pictures[frame].dimensions();
        let mut canvas = Canvas::new(width, height);
        canvas.paste(&pictures[frame], (0, 0));
        Ok(canvas)
    })
}
