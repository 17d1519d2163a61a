//! `losses.png` and `parameters.png`: the training as metrics.jsonl tells it.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use plotters::chart::SeriesLabelPosition;
use plotters::style::RGBColor;

use super::canvas::{Canvas, drawn};
use super::chart::{Line, Panel, Phase, Stroke};
use crate::runs::metrics::{self, Kind, Stretch, points};
use crate::tasks::{Task, TrueParameter};

const WIDTH: u32 = 1600;
const LOSSES_HEIGHT: u32 = 900;
const PARAMETER_HEIGHT: u32 = 560;
const METRICS: &str = "metrics.jsonl";

const GREY: RGBColor = RGBColor(120, 128, 140);
const GREEN: RGBColor = RGBColor(36, 145, 84);
const BLUE: RGBColor = RGBColor(24, 119, 190);
const ORANGE: RGBColor = RGBColor(222, 106, 16);
const RED: RGBColor = RGBColor(196, 40, 58);

/// What `losses.png` shows: label, kind of record, name in it, colour, stroke. What comes later lies on top.
const LOSSES: [(&str, Kind, &str, RGBColor, Stroke); 6] = [
    ("train loss", Kind::Train, "train_loss", GREY, Stroke::Pale),
    ("train L_rec", Kind::Train, "recons_loss", GREEN, Stroke::Pale),
    ("train L_pred", Kind::Train, "pred_loss", BLUE, Stroke::Pale),
    ("valid L_extrap", Kind::Valid, "extrap_loss", ORANGE, Stroke::Dotted),
    ("valid L_pred", Kind::Valid, "pred_loss", BLUE, Stroke::Dotted),
    ("valid L_rec", Kind::Valid, "recons_loss", GREEN, Stroke::Dotted),
];

/// Plots a run folder's `metrics.jsonl`: `losses.png` (log axis), and `parameters.png` with the true values if the task
/// has physical parameters, those of `truth` with their true values. The steps are those of all phases.
///
/// # Errors
/// A missing or damaged `metrics.jsonl` (with the line's number), one without losses, a folder that cannot be written.
pub fn write_curves(folder: &Path, task: &Task, truth: &[TrueParameter]) -> Result<()> {
    let path = folder.join(METRICS);
    let records = metrics::read(&path)?;
    let stretches = metrics::stretches(&records);
    let phases: Vec<Phase> = stretches.iter().map(phase).collect();
    let mut lines = Vec::new();
    for (label, kind, name, colour, stroke) in LOSSES {
        // The train loss is another one in each phase, so nothing is joined across phases.
        let pieces = |stretch: &Stretch| points(&records[stretch.records.clone()], Some(kind), name);
        let pieces: Vec<_> = stretches.iter().map(pieces).filter(|piece| !piece.is_empty()).collect();
        if !pieces.is_empty() {
            lines.push(Line { label, colour, stroke, pieces });
        }
    }
    ensure!(!lines.is_empty(), "{} holds no losses", path.display());
    let title = format!("{}: losses", task.key);
    let legend = SeriesLabelPosition::UpperRight;
    let panel = Panel { title, axis: "step", phases: &phases, lines, log: Some(true), legend };
    write(&folder.join("losses.png"), LOSSES_HEIGHT, vec![panel])?;
    let mut panels = Vec::new();
    for parameter in task.cell.parameters {
        let learned = points(&records, None, parameter.name);
        let Some(&(last, value)) = learned.last() else { continue };
        let mut title = format!("{}: {} = {value:.3}", task.key, parameter.name);
        let mut lines = vec![Line { label: "learned", colour: BLUE, stroke: Stroke::Plain, pieces: vec![learned] }];
        if let Some(truth) = truth.iter().find(|truth| truth.name == parameter.name) {
            title += &format!(" (true value {})", truth.value);
            let level = vec![(0.0, truth.value), (last.max(1.0), truth.value)];
            lines.push(Line { label: "true value", colour: RED, stroke: Stroke::Dashed, pieces: vec![level] });
        }
        // A parameter goes from where it started to the truth: the middle of the panel's right side stays free.
        let legend = SeriesLabelPosition::MiddleRight;
        panels.push(Panel { title, axis: "step", phases: &phases, lines, log: None, legend });
    }
    if panels.is_empty() {
        return Ok(());
    }
    write(&folder.join("parameters.png"), PARAMETER_HEIGHT * panels.len() as u32, panels)
}

fn phase(stretch: &Stretch) -> Phase {
    Phase { name: stretch.phase.clone(), steps: (stretch.steps.0 as f64, stretch.steps.1 as f64) }
}

/// Draws panels of equal height, one above the other.
pub(super) fn write(path: &Path, height: u32, panels: Vec<Panel>) -> Result<()> {
    let mut canvas = Canvas::new(WIDTH, height);
    {
        let area = canvas.area();
        let parts = area.split_evenly((panels.len(), 1));
        for (panel, part) in panels.into_iter().zip(&parts) {
            panel.draw(part).with_context(|| format!("plot {}", path.display()))?;
        }
        drawn(area.present())?;
    }
    canvas.write_png(path)
}
