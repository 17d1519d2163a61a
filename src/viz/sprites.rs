//! `templates.png`: what the decoder has learned to draw.
//!
//! Original: `templates.jpg` (contents over masks); paper: figure 4.

use std::path::Path;

use anyhow::Result;
use image::{Rgb, RgbImage};
use plotters::style::text_anchor::HPos;

use super::canvas::{Canvas, INK, picture};
use super::enlargement;
use crate::network::physics_models::{BACKGROUND_LOGIT, PhysicsNet};

const ROW_LABELS: [&str; 3] = ["contents", "mask", "masked"];
const GAP: u32 = 10;
const LABELS_WIDTH: u32 = 130;
const CAPTIONS_HEIGHT: u32 = 42;
const MARGIN: u32 = 12;
const FONT_SIZE: u32 = 22;
/// Squares of the checkerboard behind a masked sprite, pixels.
const SQUARE: u32 = 8;

/// Draws a column for each object (colours, visibility alone before the background, both together) and the background.
pub(super) fn write(path: &Path, model: &PhysicsNet) -> Result<()> {
    let sprites = model.decoder.sprites();
    let times = enlargement(&model.task);
    let cell = model.task.side as u32 * times;
    let objects = model.task.objects;
    let corner = |row: u32, column: u32| (LABELS_WIDTH + column * (cell + GAP), CAPTIONS_HEIGHT + row * (cell + GAP));
    let (right, bottom) = corner(3, objects as u32 + 1);
    let mut canvas = Canvas::new(right - GAP + MARGIN, bottom - GAP + MARGIN);
    for (row, label) in (0..).zip(ROW_LABELS) {
        canvas.text(label, (LABELS_WIDTH - 12, corner(row, 0).1 + cell / 2), FONT_SIZE, HPos::Right, INK)?;
    }
    for object in 0..objects {
        let column = object as u32;
        // A sprite is half as wide as a frame.
        let contents = picture(&sprites.contents.get(object as i64).sigmoid(), 2 * times)?;
        let mask = picture(&(sprites.template.get(object as i64) - BACKGROUND_LOGIT).sigmoid(), 2 * times)?;
        let masked = over_checkerboard(&contents, &mask);
        for (row, picture) in (0..).zip([contents, mask, masked]) {
            canvas.paste(&picture, corner(row, column));
        }
        caption(&mut canvas, &format!("object {object}"), corner(0, column).0 + cell / 2)?;
    }
    let column = objects as u32;
    canvas.paste(&picture(&sprites.background.get(0), times)?, corner(0, column));
    caption(&mut canvas, "background", corner(0, column).0 + cell / 2)?;
    canvas.write_png(path)
}

fn caption(canvas: &mut Canvas, text: &str, middle: u32) -> Result<()> {
    canvas.text(text, (middle, CAPTIONS_HEIGHT / 2), FONT_SIZE, HPos::Center, INK)
}

/// Contents where the mask is white, a checkerboard where it is black. All of one size.
fn over_checkerboard(contents: &RgbImage, mask: &RgbImage) -> RgbImage {
    RgbImage::from_fn(contents.width(), contents.height(), |x, y| {
        let board = if (x / SQUARE + y / SQUARE).is_multiple_of(2) { 205.0 } else { 235.0 };
        let visible = f32::from(mask.get_pixel(x, y)[0]) / 255.0;
        Rgb(contents.get_pixel(x, y).0.map(|c| (visible * f32::from(c) + (1.0 - visible) * board).round() as u8))
    })
}
