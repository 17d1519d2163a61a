//! A picture of a few clips, to look at before training on them.

use std::io::Cursor;
use std::path::Path;

use anyhow::{Context, Result};
use image::{ImageFormat, Rgb, RgbImage};
use ndarray::Array5;

use crate::datasets::npz::write_whole;

/// Clips, and most frames of each: longer ones are shown by frames that are evenly spread.
const CLIPS: usize = 6;
const FRAMES: usize = 60;
/// Small frames are enlarged to this side, pixels, at most 4 times.
const SIDE: usize = 128;
const ENLARGEMENT: usize = 4;
/// Grey lines between frames, pixels.
const GAP: usize = 2;

/// Writes a PNG with a row for each of the first clips `[clips, frames, S, S, channels]`, frames from left to right, small ones
/// enlarged.
pub(super) fn write_samples(path: &Path, clips: &Array5<u8>) -> Result<()> {
    let (count, frames, side, _, channels) = clips.dim();
    let enlargement = (SIDE / side).clamp(1, ENLARGEMENT);
    let pitch = side * enlargement + GAP;
    let shown = frames.min(FRAMES);
    let (width, height) = (shown * pitch + GAP, count.min(CLIPS) * pitch + GAP);
    let picture = RgbImage::from_fn(width as u32, height as u32, |x, y| {
        let (column, row) = (x as usize / pitch, y as usize / pitch);
        let (within_x, within_y) = (x as usize % pitch, y as usize % pitch);
        if within_x < GAP || within_y < GAP {
            return Rgb([128; 3]);
        }
        let (px, py) = ((within_x - GAP) / enlargement, (within_y - GAP) / enlargement);
        let frame = column * frames / shown;
        Rgb([0, 1, 2].map(|channel| clips[[row, frame, py, px, channel.min(channels - 1)]]))
    });
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png).with_context(|| format!("cannot encode {path:?}"))?;
    write_whole(path, bytes.get_ref())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_clips_are_shown_by_some_of_their_frames() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("samples.png");
        // Frames of 4 pixels are enlarged to 16; a grey line stands before each and after the last.
        for (frames, columns, last) in [(1, 1, 0), (60, 60, 59), (200, 60, 196)] {
            let clips = Array5::from_shape_fn((1, frames, 4, 4, 1), |(_, frame, ..)| frame as u8);
            write_samples(&path, &clips).unwrap();
            let picture = image::open(&path).unwrap().into_rgb8();
            assert_eq!(picture.width(), 18 * columns + 2, "{frames} frames");
            let shown = |column: u32| picture[(18 * column + 8, 8)].0[0];
            assert_eq!([shown(0), shown(columns - 1)], [0, last], "{frames} frames");
        }
    }
}
