//! `animation.gif`: the first test clips in motion, truth above the model.

use std::path::Path;

use anyhow::Result;
use image::RgbImage;
use plotters::style::text_anchor::HPos;

use super::canvas::{Canvas, INK, pictures};
use super::gif;
use super::grid::{Grid, enlargement};
use super::sections::{Section, section_at, sections};
use crate::evaluation::outputs::Outputs;
use crate::network::System;

const CLIPS: usize = 5;
const BORDER: u32 = 4;
const ROW_LABELS: [&str; 2] = ["truth", "model"];

/// Writes the animation, the borders in the colour of the clip's part.
pub(super) fn write(path: &Path, system: &System, outputs: &Outputs) -> Result<()> {
    let shown = 0..outputs.count().min(CLIPS);
    let times = enlargement(system);
    let truth = shown.clone().map(|clip| pictures(&outputs.clips.get(clip as i64), times));
    let model = shown.clone().map(|clip| pictures(&outputs.input_and_prediction(clip), times));
    let rows: [Vec<Vec<RgbImage>>; 2] = [truth.collect::<Result<_>>()?, model.collect::<Result<_>>()?];
    let frames = Grid::of_frames(system, rows.len(), shown.len());
    let grid = Grid { cell: frames.cell + 2 * BORDER, gap: 6, left: 84, top: 36, margin: 8, ..frames };
    let sections = sections(system, outputs.time());
    gif::write(path, outputs.time(), |time| draw(&grid, &rows, section_at(&sections, time), time))
}

/// One moment. `rows`: truth, model; for each clip its frames.
fn draw(grid: &Grid, rows: &[Vec<Vec<RgbImage>>; 2], section: &Section, time: usize) -> Result<Canvas> {
    let mut canvas = grid.canvas();
    let middle = grid.top / 2;
    canvas.text(section.name, (grid.left, middle), grid.font_size, HPos::Left, section.colour)?;
    let right = grid.size().0 - grid.margin;
    canvas.text(&time.to_string(), (right, middle), grid.font_size, HPos::Right, INK)?;
    for (row, (label, clips)) in ROW_LABELS.into_iter().zip(rows).enumerate() {
        grid.label(&mut canvas, row, &[label])?;
        for (column, frames) in clips.iter().enumerate() {
            let (x, y) = grid.corner(row, column);
            canvas.fill((x, y), (grid.cell, grid.cell), section.colour);
            canvas.paste(&frames[time], (x + BORDER, y + BORDER));
        }
    }
    Ok(canvas)
}
