//! `encoder_masks.png`: how the encoder segments a few frames.
//!
//! Paper: figure 3.

use std::path::Path;

use anyhow::Result;
use plotters::style::text_anchor::HPos;
use tch::Tensor;

use super::canvas::{Canvas, INK, picture};
use super::enlargement;
use crate::datasets::iterators::Clips;
use crate::network::physics_models::PhysicsNet;

/// Frames shown: the first ones of as many clips.
const FRAMES: usize = 5;
const GAP: u32 = 6;
/// Extra space between frame, masks, masked objects and background.
const GROUP_GAP: u32 = 14;
const CAPTIONS_HEIGHT: u32 = 42;
const MARGIN: u32 = 12;
const FONT_SIZE: u32 = 20;

/// Draws a row for each frame: the frame, the objects' masks, the masked objects, the background's mask.
pub(super) fn write(path: &Path, model: &PhysicsNet, test: &Clips) -> Result<()> {
    let clips: Vec<i64> = (0..test.len().min(FRAMES) as i64).collect();
    let frames = test.batch(&clips, 1).select(1, 0);
    let encoding = model.encoder.forward(&frames);
    let objects = model.task.objects as i64;
    let mask = |place: i64| encoding.masks.narrow(1, place, 1);
    let masks = (0..objects).map(|object| (format!("mask {object}"), mask(object)));
    let masked = (0..objects).map(|object| (format!("object {object}"), encoding.masked.get(object)));
    let groups: [Vec<(String, Tensor)>; 4] = [
        vec![("frame".into(), frames.shallow_clone())],
        masks.collect(),
        masked.collect(),
        vec![("background".into(), mask(objects))],
    ];
    let times = enlargement(&model.task);
    let cell = model.task.side as u32 * times;
    let columns: usize = groups.iter().map(Vec::len).sum();
    let width = 2 * MARGIN + columns as u32 * (cell + GAP) - GAP + (groups.len() as u32 - 1) * GROUP_GAP;
    let height = CAPTIONS_HEIGHT + clips.len() as u32 * (cell + GAP) - GAP + MARGIN;
    let mut canvas = Canvas::new(width, height);
    let mut x = MARGIN;
    for group in &groups {
        for (caption, column) in group {
            canvas.text(caption, (x + cell / 2, CAPTIONS_HEIGHT / 2), FONT_SIZE, HPos::Center, INK)?;
            for row in 0..clips.len() as u32 {
                let y = CAPTIONS_HEIGHT + row * (cell + GAP);
                canvas.paste(&picture(&column.get(i64::from(row)), times)?, (x, y));
            }
            x += cell + GAP;
        }
        x += GROUP_GAP;
    }
    canvas.write_png(path)
}
