//! `animation.gif`: the first test clips in motion, truth above the model.

use std::path::Path;

use anyhow::Result;
use image::RgbImage;
use plotters::style::text_anchor::HPos;

use super::canvas::{Canvas, INK, enlarge, pictures};
use super::outputs::Outputs;
use super::sections::{Section, section_at, sections};
use super::{enlargement, gif};
use crate::tasks::Task;

const CLIPS: usize = 5;
const BORDER: u32 = 4;
const GAP: u32 = 6;
const LABELS_WIDTH: u32 = 84;
const CAPTION_HEIGHT: u32 = 36;
const MARGIN: u32 = 8;
const FONT_SIZE: u32 = 22;

/// Writes the animation, the borders in the colour of the clip's part.
pub(super) fn write(path: &Path, task: &Task, outputs: &Outputs) -> Result<()> {
    let shown = outputs.len().min(CLIPS);
    let mut rows: [Vec<Vec<RgbImage>>; 2] = Default::default();
    for clip in 0..shown {
        rows[0].push(pictures(&outputs.clips.get(clip as i64))?);
        rows[1].push(pictures(&outputs.input_and_prediction(clip))?);
    }
    let sections = sections(task, outputs.time());
    gif::write(path, outputs.time(), |time| draw(task, &rows, section_at(&sections, time), time))
}

/// One moment. `rows`: truth, model; for each clip its frames.
fn draw(task: &Task, rows: &[Vec<Vec<RgbImage>>; 2], section: &Section, time: usize) -> Result<Canvas> {
    let cell = task.side as u32 * enlargement(task) + 2 * BORDER;
    let width = LABELS_WIDTH + rows[0].len() as u32 * (cell + GAP) - GAP + MARGIN;
    let mut canvas = Canvas::new(width, CAPTION_HEIGHT + 2 * cell + GAP + MARGIN);
    canvas.text(section.name, (LABELS_WIDTH, CAPTION_HEIGHT / 2), FONT_SIZE, HPos::Left, section.colour)?;
    canvas.text(&time.to_string(), (width - MARGIN, CAPTION_HEIGHT / 2), FONT_SIZE, HPos::Right, INK)?;
    for (row, (label, clips)) in ["truth", "model"].iter().zip(rows).enumerate() {
        let y = CAPTION_HEIGHT + row as u32 * (cell + GAP);
        canvas.text(label, (LABELS_WIDTH - 10, y + cell / 2), FONT_SIZE, HPos::Right, INK)?;
        for (clip, frames) in clips.iter().enumerate() {
            let x = LABELS_WIDTH + clip as u32 * (cell + GAP);
            canvas.fill((x, y), (cell, cell), section.colour);
            canvas.paste(&enlarge(&frames[time], enlargement(task)), (x + BORDER, y + BORDER));
        }
    }
    Ok(canvas)
}
