//! `example{i}.png`: a test clip, frame by frame, beside what the model makes of it.
//!
//! Original: `example%d.jpg` (`physics_models.py`); paper: figure 5.

use std::path::Path;

use anyhow::{Context, Result};
use plotters::style::text_anchor::HPos;

use super::canvas::{Canvas, INK, enlarge, pictures};
use super::enlargement;
use super::outputs::Outputs;
use super::sections::{Section, sections};
use crate::tasks::Task;

const ROW_LABELS: [&[&str]; 3] = [&["input +", "prediction"], &["truth"], &["reconstruction"]];
/// Space between two frames, and the extra space that a boundary between two parts of the clip takes, pixels.
const GAP: u32 = 2;
const BOUNDARY: u32 = 12;
const BOUNDARY_LINE: u32 = 4;
const LABELS_WIDTH: u32 = 226;
const CAPTIONS_HEIGHT: u32 = 60;
const BAND_HEIGHT: u32 = 6;
const MARGIN: u32 = 12;
const FONT_SIZE: u32 = 28;

/// Where everything stands in `example{i}.png`.
#[derive(Debug)]
pub struct Layout {
    sections: Vec<Section>,
    /// Side of a frame on the picture, pixels.
    cell: u32,
    time: usize,
}

impl Layout {
    /// For clips of `time` frames, at least L + T_pred.
    pub fn new(task: &Task, time: usize) -> Self {
        Layout { sections: sections(task, time), cell: task.side as u32 * enlargement(task), time }
    }

    /// Width and height of the picture, pixels.
    pub fn size(&self) -> (u32, u32) {
        let (x, y) = self.corner(2, self.time - 1);
        (x + self.cell + MARGIN, y + self.cell + MARGIN)
    }

    /// Side of an enlarged frame, pixels.
    pub fn cell(&self) -> u32 {
        self.cell
    }

    /// Top left corner (x, y) of a frame, pixels. Rows: 0 input and prediction, 1 truth, 2 reconstruction.
    pub fn corner(&self, row: usize, frame: usize) -> (u32, u32) {
        let boundaries = self.sections.iter().skip(1).filter(|section| section.first <= frame).count() as u32;
        let x = LABELS_WIDTH + frame as u32 * (self.cell + GAP) + boundaries * BOUNDARY;
        (x, CAPTIONS_HEIGHT + row as u32 * (self.cell + GAP))
    }

    /// An empty picture with its captions, row labels and boundaries.
    fn draw(&self) -> Result<Canvas> {
        let (width, height) = self.size();
        let mut canvas = Canvas::new(width, height);
        for (row, lines) in ROW_LABELS.iter().enumerate() {
            let middle = self.corner(row, 0).1 + self.cell / 2;
            for (line, text) in lines.iter().enumerate() {
                let y = middle + line as u32 * FONT_SIZE - (lines.len() as u32 - 1) * FONT_SIZE / 2;
                canvas.text(text, (LABELS_WIDTH - 10, y), FONT_SIZE, HPos::Right, INK)?;
            }
        }
        let band = CAPTIONS_HEIGHT - BAND_HEIGHT - 4;
        for section in &self.sections {
            let left = self.corner(0, section.first).0;
            let right = self.corner(0, section.first + section.frames - 1).0 + self.cell;
            let caption = format!("{}, {} = {}", section.name, section.symbol, section.frames);
            canvas.text(&caption, (left + 2, band / 2 + 1), FONT_SIZE, HPos::Left, section.colour)?;
            canvas.fill((left, band), (right - left, BAND_HEIGHT), section.colour);
            if section.first > 0 {
                let line = left - GAP - BOUNDARY / 2 - BOUNDARY_LINE / 2 + 1;
                canvas.fill((line, band), (BOUNDARY_LINE, height - MARGIN - band), section.colour);
            }
        }
        Ok(canvas)
    }
}

/// Writes the pictures of the first `count` clips.
pub(super) fn write(folder: &Path, task: &Task, outputs: &Outputs, count: usize) -> Result<()> {
    let layout = Layout::new(task, outputs.time());
    for clip in 0..outputs.len().min(count) {
        let mut canvas = layout.draw()?;
        let rows = [
            outputs.input_and_prediction(clip),
            outputs.clips.get(clip as i64),
            outputs.reconstructions.get(clip as i64),
        ];
        for (row, frames) in rows.iter().enumerate() {
            for (frame, picture) in pictures(frames)?.iter().enumerate() {
                canvas.paste(&enlarge(picture, enlargement(task)), layout.corner(row, frame));
            }
        }
        let path = folder.join(format!("example{clip}.png"));
        canvas.write_png(&path).with_context(|| format!("picture of test clip {clip}"))?;
    }
    Ok(())
}
