//! A picture of a few clips, to look at before training on them.

use std::io::Cursor;
use std::path::Path;

use anyhow::{Context, Result};
use image::{ImageFormat, Rgb, RgbImage};
use ndarray::Array5;

use crate::datasets::npz::write_whole;

const CLIPS: usize = 6;
/// Small frames are enlarged to this side, pixels, at most 4 times.
const SIDE: usize = 128;
const ENLARGEMENT: usize = 4;
/// Grey lines between frames, pixels.
const GAP: usize = 2;

/// Writes a PNG with a row for each of the first clips, frames from left to right, small ones enlarged.
pub(super) fn write_samples(path: &Path, clips: &Array5<u8>) -> Result<()> {
    let (count, frames, side, _, channels) = clips.dim();
    let enlargement = (SIDE / side).clamp(1, ENLARGEMENT);
    let pitch = side * enlargement + GAP;
    let (width, height) = (frames * pitch + GAP, count.min(CLIPS) * pitch + GAP);
    let picture = RgbImage::from_fn(width as u32, height as u32, |x, y| {
        let (column, row) = (x as usize / pitch, y as usize / pitch);
        let (within_x, within_y) = (x as usize % pitch, y as usize % pitch);
        if within_x < GAP || within_y < GAP {
            return Rgb([128; 3]);
        }
        let (px, py) = ((within_x - GAP) / enlargement, (within_y - GAP) / enlargement);
        Rgb([0, 1, 2].map(|channel| clips[[row, column, py, px, channel.min(channels - 1)]]))
    });
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png).with_context(|| format!("cannot encode {path:?}"))?;
    write_whole(path, bytes.get_ref())
}
