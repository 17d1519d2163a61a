//! `encoder_masks.png`: how the encoder segments a few frames.
//!
//! Paper: figure 3.

use std::path::Path;

use anyhow::Result;
use tch::Tensor;

use super::canvas::picture;
use super::grid::{Grid, enlargement};
use crate::datasets::iterators::Clips;
use crate::network::physics_models::PhysicsNet;

/// Frames shown: the first ones of as many clips.
const FRAMES: usize = 5;
/// Extra space between frame, masks, masked objects and background, pixels.
const GROUP_GAP: u32 = 14;

/// Draws a row for each frame: the frame, the objects' masks, the masked objects, the background's mask.
pub(super) fn write(path: &Path, model: &PhysicsNet, test: &Clips) -> Result<()> {
    let clips: Vec<i64> = (0..test.len().min(FRAMES) as i64).collect();
    let frames = test.batch(&clips, 1).select(1, 0);
    let encoding = model.look(&frames);
    let objects = model.system.objects;
    let mask = |place: usize| encoding.masks.narrow(1, place as i64, 1);
    let mut columns: Vec<(String, Tensor)> = vec![("frame".into(), frames.shallow_clone())];
    columns.extend((0..objects).map(|object| (format!("mask {object}"), mask(object))));
    columns.extend((0..objects).map(|object| (format!("object {object}"), encoding.masked.get(object as i64))));
    columns.push(("background".into(), mask(objects)));
    let times = enlargement(&model.system);
    let breaks = [1, 1 + objects, 1 + 2 * objects].map(|first| (first, GROUP_GAP)).to_vec();
    let frames = Grid::of_frames(&model.system, clips.len(), columns.len());
    let grid = Grid { gap: 6, breaks, font_size: 20, ..frames };
    let mut canvas = grid.canvas();
    for (column, (caption, pictures)) in columns.iter().enumerate() {
        grid.caption(&mut canvas, column, caption)?;
        for row in 0..clips.len() {
            canvas.paste(&picture(&pictures.get(row as i64), times)?, grid.corner(row, column));
        }
    }
    canvas.write_png(path)
}
