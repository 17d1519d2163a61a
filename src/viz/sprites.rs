//! `templates.png`: what the decoder has learned to draw.
//!
//! Original: `templates.jpg` (contents over masks); paper: figure 4.

use std::path::Path;

use anyhow::Result;
use image::{Rgb, RgbImage};

use super::canvas::picture;
use super::grid::{Grid, enlargement};
use crate::network::System;
use crate::network::physics_models::{BACKGROUND_LOGIT, Sprites};

const ROW_LABELS: [&str; 3] = ["contents", "mask", "masked"];
/// Squares of the checkerboard behind a masked sprite, pixels.
const SQUARE: u32 = 8;

/// Draws a column for each object (colours, visibility alone before the background, both together) and the background.
pub(super) fn write(path: &Path, system: &System, sprites: &Sprites) -> Result<()> {
    let (times, objects) = (enlargement(system), system.objects);
    let frames = Grid::of_frames(system, ROW_LABELS.len(), objects + 1);
    let grid = Grid { gap: 10, left: 130, label_gap: 12, ..frames };
    let mut canvas = grid.canvas();
    for (row, label) in ROW_LABELS.into_iter().enumerate() {
        grid.label(&mut canvas, row, &[label])?;
    }
    for object in 0..objects {
        // A sprite is half as wide as a frame.
        let contents = picture(&sprites.contents.get(object as i64).sigmoid(), 2 * times)?;
        let mask = picture(&(sprites.template.get(object as i64) - BACKGROUND_LOGIT).sigmoid(), 2 * times)?;
        let masked = over_checkerboard(&contents, &mask);
        for (row, picture) in [contents, mask, masked].iter().enumerate() {
            canvas.paste(picture, grid.corner(row, object));
        }
        grid.caption(&mut canvas, object, &format!("object {object}"))?;
    }
    canvas.paste(&picture(&sprites.background.get(0), times)?, grid.corner(0, objects));
    grid.caption(&mut canvas, objects, "background")?;
    canvas.write_png(path)
}

/// Contents where the mask is white, a checkerboard where it is black. All of one size.
fn over_checkerboard(contents: &RgbImage, mask: &RgbImage) -> RgbImage {
    RgbImage::from_fn(contents.width(), contents.height(), |x, y| {
        let board = if (x / SQUARE + y / SQUARE).is_multiple_of(2) { 205.0 } else { 235.0 };
        let visible = f32::from(mask.get_pixel(x, y)[0]) / 255.0;
        Rgb(contents.get_pixel(x, y).0.map(|c| (visible * f32::from(c) + (1.0 - visible) * board).round() as u8))
    })
}
