//! One clip and its roll-out, as a strip of frames and in motion.

use std::path::Path;

use anyhow::Result;
use image::RgbImage;
use plotters::style::text_anchor::HPos;
use tch::Tensor;

use super::canvas::{Canvas, INK, enlarge, pictures};
use super::sections::{Section, section_at, sections};
use super::{enlargement, gif};
use crate::evaluation::rollout::Rollout;
use crate::tasks::Task;

/// Frames in one line of the strip.
const PER_LINE: usize = 12;
const ROW_LABELS: [&str; 2] = ["clip", "model"];
const GAP: u32 = 4;
const LABELS_WIDTH: u32 = 96;
const NUMBERS_HEIGHT: u32 = 34;
const BAND_HEIGHT: u32 = 6;
const CAPTION_WIDTH: u32 = 150;
const LINE_GAP: u32 = 16;
const MARGIN: u32 = 12;
const FONT_SIZE: u32 = 22;

/// What is shown: for each moment the clip's frame, if there is one, and the model's (the input, then the prediction).
struct Moments {
    clip: Vec<RgbImage>,
    model: Vec<RgbImage>,
    sections: Vec<Section>,
    /// Side of a frame, pixels.
    cell: u32,
}

impl Moments {
    /// Pixels `times` as large as in the other pictures.
    fn new(task: &Task, rollout: &Rollout, times: u32) -> Result<Self> {
        let times = times * enlargement(task);
        let input = rollout.clip.narrow(0, 0, task.input_steps as i64);
        let large = |frames: &Tensor| -> Result<Vec<RgbImage>> {
            Ok(pictures(frames)?.iter().map(|picture| enlarge(picture, times)).collect())
        };
        let model = large(&Tensor::cat(&[&input, &rollout.frames], 0))?;
        let time = model.len().max(task.input_steps + task.pred_steps);
        let clip = large(&rollout.clip)?;
        Ok(Moments { clip, model, sections: sections(task, time), cell: task.side as u32 * times })
    }

    /// Pastes a moment with its corner at (x, y): number, band, clip, model.
    fn paste(&self, canvas: &mut Canvas, frame: usize, (x, y): (u32, u32)) -> Result<()> {
        let section = section_at(&self.sections, frame);
        let middle = (x + self.cell / 2, y + NUMBERS_HEIGHT / 2);
        canvas.text(&frame.to_string(), middle, FONT_SIZE, HPos::Center, section.colour)?;
        canvas.fill((x, y + NUMBERS_HEIGHT), (self.cell, BAND_HEIGHT), section.colour);
        for (row, pictures) in [&self.clip, &self.model].into_iter().enumerate() {
            if let Some(picture) = pictures.get(frame) {
                canvas.paste(picture, (x, self.row(y, row)));
            }
        }
        Ok(())
    }

    /// Top of a row of a line that begins at `y`.
    fn row(&self, y: u32, row: usize) -> u32 {
        y + NUMBERS_HEIGHT + BAND_HEIGHT + GAP + row as u32 * (self.cell + GAP)
    }

    /// Names the rows of a line that begins at `y` with a frame; the clip may have ended before.
    fn labels(&self, canvas: &mut Canvas, frame: usize, y: u32) -> Result<()> {
        let shown = |row: usize| [&self.clip, &self.model][row].len() > frame;
        ROW_LABELS.iter().enumerate().filter(|(row, _)| shown(*row)).try_for_each(|(row, label)| {
            let at = (LABELS_WIDTH - 10, self.row(y, row) + self.cell / 2);
            canvas.text(label, at, FONT_SIZE, HPos::Right, INK)
        })
    }
}

/// Writes all frames in lines of twelve: number (coloured by part of the clip), the clip's frame, the model's.
pub(crate) fn write_strip(path: &Path, task: &Task, rollout: &Rollout) -> Result<()> {
    let moments = Moments::new(task, rollout, 1)?;
    let frames = moments.model.len();
    let line_height = moments.row(0, ROW_LABELS.len()) + LINE_GAP;
    let lines = frames.div_ceil(PER_LINE) as u32;
    let width = LABELS_WIDTH + frames.min(PER_LINE) as u32 * (moments.cell + GAP) + MARGIN;
    let top = NUMBERS_HEIGHT + MARGIN;
    let mut canvas = Canvas::new(width, top + lines * line_height);
    let mut x = LABELS_WIDTH;
    for section in moments.sections.iter().filter(|section| section.first < frames) {
        canvas.text(section.name, (x, top / 2), FONT_SIZE, HPos::Left, section.colour)?;
        x += CAPTION_WIDTH;
    }
    for frame in 0..frames {
        let (line, column) = (frame / PER_LINE, frame % PER_LINE);
        let y = top + line as u32 * line_height;
        if column == 0 {
            moments.labels(&mut canvas, frame, y)?;
        }
        moments.paste(&mut canvas, frame, (LABELS_WIDTH + column as u32 * (moments.cell + GAP), y))?;
    }
    canvas.write_png(path)
}

/// Writes the clip above the model in motion.
pub(crate) fn write_animation(path: &Path, task: &Task, rollout: &Rollout) -> Result<()> {
    let moments = Moments::new(task, rollout, 2)?;
    gif::write(path, moments.model.len(), |frame| {
        let mut canvas = Canvas::new(LABELS_WIDTH + moments.cell + MARGIN, moments.row(0, 2) + MARGIN);
        moments.labels(&mut canvas, frame, 0)?;
        moments.paste(&mut canvas, frame, (LABELS_WIDTH, 0))?;
        Ok(canvas)
    })
}
