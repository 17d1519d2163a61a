//! `example{i}.png`: a test clip, frame by frame, beside what the model makes of it.
//!
//! Original: `example%d.jpg` (`physics_models.py`); paper: figure 5.

use std::path::Path;

use anyhow::{Context, Result};
use image::RgbImage;
use plotters::style::text_anchor::HPos;

use super::canvas::{Canvas, pictures};
use super::grid::{Grid, enlargement};
use super::sections::{Section, sections};
use crate::evaluation::outputs::Outputs;
use crate::network::System;

const ROW_LABELS: [&[&str]; 3] = [&["input +", "prediction"], &["truth"], &["reconstruction"]];
/// Space between two parts of the clip, and the line in it, pixels.
const BOUNDARY: u32 = 12;
const BOUNDARY_LINE: u32 = 4;
/// The coloured band under the name of a part, pixels.
const BAND: u32 = 6;

/// Where the frames of a clip of `time` frames stand, at least L + T_pred. Rows: input and prediction, truth,
/// reconstruction.
pub fn layout(system: &System, time: usize) -> Grid {
    let boundary = |section: &Section| (section.first > 0).then_some((section.first, BOUNDARY));
    let breaks = sections(system, time).iter().filter_map(boundary).collect();
    let frames = Grid::of_frames(system, ROW_LABELS.len(), time);
    Grid { gap: 2, breaks, left: 226, top: 60, font_size: 28, ..frames }
}

/// Writes the pictures of the first `count` clips.
pub(super) fn write(folder: &Path, system: &System, outputs: &Outputs, count: usize) -> Result<()> {
    for clip in 0..outputs.count().min(count) {
        let path = folder.join(format!("example{clip}.png"));
        canvas(system, outputs, clip)?.write_png(&path).with_context(|| format!("picture of test clip {clip}"))?;
    }
    Ok(())
}

/// The picture of one clip. Rows: input and prediction, truth, reconstruction.
///
/// # Errors
/// Frames with neither 1 nor 3 channels.
pub fn picture(system: &System, outputs: &Outputs, clip: usize) -> Result<RgbImage> {
    Ok(canvas(system, outputs, clip)?.into_pixels())
}

fn canvas(system: &System, outputs: &Outputs, clip: usize) -> Result<Canvas> {
    let grid = layout(system, outputs.time());
    let mut canvas = empty(&grid, &sections(system, outputs.time()))?;
    let rows =
        [outputs.input_and_prediction(clip), outputs.clips.get(clip as i64), outputs.reconstructions.get(clip as i64)];
    for (row, frames) in rows.iter().enumerate() {
        for (frame, picture) in pictures(frames, enlargement(system))?.iter().enumerate() {
            canvas.paste(picture, grid.corner(row, frame));
        }
    }
    Ok(canvas)
}

/// A picture with its captions, labels and boundaries.
fn empty(grid: &Grid, sections: &[Section]) -> Result<Canvas> {
    let mut canvas = grid.canvas();
    for (row, lines) in ROW_LABELS.into_iter().enumerate() {
        grid.label(&mut canvas, row, lines)?;
    }
    let band = grid.top - BAND - 4;
    for section in sections {
        let left = grid.corner(0, section.first).0;
        let right = grid.corner(0, section.first + section.frames - 1).0 + grid.cell;
        let caption = format!("{}, {} = {}", section.name, section.symbol, section.frames);
        canvas.text(&caption, (left + 2, band / 2 + 1), grid.font_size, HPos::Left, section.colour)?;
        canvas.fill((left, band), (right - left, BAND), section.colour);
        if section.first > 0 {
            let line = left - grid.gap - BOUNDARY / 2 - BOUNDARY_LINE / 2 + 1;
            canvas.fill((line, band), (BOUNDARY_LINE, grid.size().1 - grid.margin - band), section.colour);
        }
    }
    Ok(canvas)
}
