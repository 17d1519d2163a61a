//! One clip and its roll-out: as a strip of frames, in motion, and as numbers.

use std::fs;
use std::io::{ErrorKind, Write};
use std::ops::Range;
use std::path::Path;

use anyhow::{Context, Result, anyhow};
use image::RgbImage;
use plotters::style::text_anchor::HPos;
use tch::Tensor;

use super::canvas::{Canvas, pictures};
use super::grid::{Grid, enlargement};
use super::sections::{Section, section_at, sections};
use super::{arrays, gif};
use crate::evaluation::rollout::Rollout;
use crate::network::System;
use crate::network::cells::Coordinates;
use crate::support::error::Error;
use crate::support::output::FileSet;
use crate::support::significant::six_digits;
use crate::support::{atomic, memory};

/// Frames in one line of the strip.
const PER_LINE: usize = 12;
const ROW_LABELS: [&str; 2] = ["clip", "model"];
/// The number and the coloured band above a frame, space between two lines, width of a section's name; pixels.
const NUMBER: u32 = 34;
const BAND: u32 = 6;
const LINE_GAP: u32 = 16;
const CAPTION: u32 = 150;

/// Writes a roll-out into a folder.
///
/// * `frames.png`: all frames, the clip above the model, and `animation.gif`, the same in motion;
/// * `states.csv`: a line for each frame from the last input frame on: its place in the clip, the time since the last
///   input frame, then x, y (pixels), vx, vy (pixels per time unit) of each object, or its angle and rate (radians);
/// * `rollout.npz`: float32 `positions` and `velocities` `[1 + frames, coordinates * N]`, `frames` `[frames, S, S, C]` in \[0, 1\].
///
/// # Errors
/// A folder that cannot be written, frames with neither 1 nor 3 channels.
pub fn write_rollout(folder: &Path, system: &System, rollout: &Rollout) -> Result<(), Error> {
    Ok(FILES.replace(folder, |folder| {
        write_strip(&folder.join("frames.png"), &Moments::new(system, rollout, 1)?)?;
        write_animation(&folder.join("animation.gif"), &Moments::new(system, rollout, 2)?)?;
        let (positions, velocities) = (rollout.positions.shallow_clone(), rollout.velocities.shallow_clone());
        let frames = arrays::channels_last(&rollout.frames);
        let all = [("positions", positions), ("velocities", velocities), ("frames", frames)];
        arrays::write(&folder.join("rollout.npz"), &all)?;
        atomic::write_file(&folder.join("states.csv"), |file| Ok(file.write_all(states(system, rollout).as_bytes())?))
    })?)
}

/// The files of a roll-out.
const FILES: FileSet = FileSet {
    name: "a prediction",
    files: &["frames.png", "animation.gif", "rollout.npz", "states.csv"],
    recognizes: |states| states.starts_with(HEAD.as_bytes()),
};
/// Beginning of the table of states.
const HEAD: &str = "frame,time,";

/// Checks that a roll-out may be written into a folder: an earlier one is replaced, nothing else.
///
/// # Errors
/// A folder that holds anything but a roll-out, as a run's does, or that cannot be written.
pub fn check_rollout_folder(folder: &Path) -> Result<(), Error> {
    FILES.settle(folder)?;
    FILES.check(folder)?;
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        entries => entries.with_context(|| format!("cannot write into {}", folder.display()))?,
    };
    for entry in entries {
        let name = entry.with_context(|| format!("cannot list {}", folder.display()))?.file_name();
        if !FILES.files.iter().any(|file| name == *file) && !atomic::is_partial(&name) {
            let strange = anyhow!(
                "{} holds {name:?}, which is of no prediction, and a prediction would write among it; choose another folder",
                folder.display()
            );
            return Err(strange.into());
        }
    }
    Ok(())
}

/// What is shown: for each moment the clip's frame, if there is one, and the model's (the input, then the prediction).
struct Moments {
    clip: Vec<RgbImage>,
    model: Vec<RgbImage>,
    sections: Vec<Section>,
    /// One line, number and band being above its rows.
    line: Grid,
}

impl Moments {
    /// Pixels `times` as large as in the other pictures.
    fn new(system: &System, rollout: &Rollout, times: u32) -> Result<Self> {
        let pixel = times * enlargement(system);
        let moments = system.input_steps as u64 + rollout.frames.size()[0] as u64 + rollout.clip.size()[0] as u64;
        let of_picture = 3 * (u64::from(pixel) * system.side as u64).pow(2);
        memory::ensure_free(moments * of_picture).context("pictures of so many frames (--frames)")?;
        let input = rollout.clip.narrow(0, 0, system.input_steps as i64);
        let model = pictures(&Tensor::cat(&[&input, &rollout.frames], 0), pixel)?;
        let sections = sections(system, model.len().max(system.input_steps + system.pred_steps));
        let frames = Grid::of_frames(system, ROW_LABELS.len(), 1);
        let line = Grid { cell: frames.cell * times, left: 96, top: NUMBER + BAND + frames.gap, ..frames };
        Ok(Moments { clip: pictures(&rollout.clip, pixel)?, model, sections, line })
    }

    /// The rows of a line that begins at a frame: the clip may have ended before, and leaves no empty row then.
    fn rows(&self, first: usize) -> Vec<(&'static str, &Vec<RgbImage>)> {
        let rows = ROW_LABELS.into_iter().zip([&self.clip, &self.model]);
        rows.filter(|(_, pictures)| pictures.len() > first).collect()
    }

    /// Draws a line of frames: number, band, and the rows.
    fn draw(
        &self,
        canvas: &mut Canvas,
        line: &Grid,
        rows: &[(&str, &Vec<RgbImage>)],
        frames: Range<usize>,
    ) -> Result<()> {
        for (row, (label, pictures)) in rows.iter().enumerate() {
            if pictures.len() > frames.start {
                line.label(canvas, row, &[label])?;
            }
            for (column, picture) in pictures.iter().skip(frames.start).take(frames.len()).enumerate() {
                canvas.paste(picture, line.corner(row, column));
            }
        }
        for (column, frame) in frames.enumerate() {
            let section = section_at(&self.sections, frame);
            let (x, y) = (line.corner(0, column).0, line.top - self.line.top);
            let middle = (x + line.cell / 2, y + NUMBER / 2);
            canvas.text(&frame.to_string(), middle, line.font_size, HPos::Center, section.colour)?;
            canvas.fill((x, y + NUMBER), (line.cell, BAND), section.colour);
        }
        Ok(())
    }
}

/// All frames in lines of twelve.
fn write_strip(path: &Path, moments: &Moments) -> Result<()> {
    let (frames, line) = (moments.model.len(), &moments.line);
    let head = NUMBER + line.margin;
    let firsts = || (0..frames).step_by(PER_LINE);
    let line_height = |first| line.top + moments.rows(first).len() as u32 * (line.cell + line.gap) + LINE_GAP;
    let width = line.left + frames.min(PER_LINE) as u32 * (line.cell + line.gap) + line.margin;
    let mut canvas = Canvas::new(width, head + firsts().map(line_height).sum::<u32>());
    let shown = moments.sections.iter().filter(|section| section.first < frames);
    for (x, section) in (line.left..).step_by(CAPTION as usize).zip(shown) {
        canvas.text(section.name, (x, head / 2), line.font_size, HPos::Left, section.colour)?;
    }
    let mut above = head;
    for first in firsts() {
        let place = Grid { top: above + line.top, ..line.clone() };
        moments.draw(&mut canvas, &place, &moments.rows(first), first..frames.min(first + PER_LINE))?;
        above += line_height(first);
    }
    canvas.write_png(path)
}

/// The clip above the model in motion.
fn write_animation(path: &Path, moments: &Moments) -> Result<()> {
    let (width, height) = moments.line.size();
    gif::write(path, moments.model.len(), |frame| {
        let mut canvas = Canvas::new(width, height + moments.line.gap);
        moments.draw(&mut canvas, &moments.line, &moments.rows(0), frame..frame + 1)?;
        Ok(canvas)
    })
}

/// The text of `states.csv`.
fn states(system: &System, rollout: &Rollout) -> String {
    let names: &[&str] = match system.cell.coordinates {
        Coordinates::Position => &["x", "y", "vx", "vy"],
        Coordinates::Angle => &["angle", "rate"],
    };
    let axes = names.len() / 2;
    let columns = (0..system.objects).flat_map(|object| names.iter().map(move |name| format!(",{name}{object}")));
    let mut text = format!("{}{}\n", HEAD.trim_end_matches(','), columns.collect::<String>());
    for place in 0..rollout.positions.size()[0] {
        let frame = system.input_steps as i64 - 1 + place;
        text += &format!("{frame},{}", six_digits(place as f64 * system.dt));
        for object in 0..system.objects {
            for states in [&rollout.positions, &rollout.velocities] {
                for column in axes * object..axes * (object + 1) {
                    text += &format!(",{}", six_digits(states.double_value(&[place, column as i64])));
                }
            }
        }
        text.push('\n');
    }
    text
}
