//! The trainings of several seeds in one plot, for the report.

use std::path::Path;

use anyhow::Result;
use plotters::chart::SeriesLabelPosition;
use plotters::style::RGBColor;

use super::chart::{Line, Panel, Phase, Stroke};
use super::curves;
use crate::runs::metrics::{self, Kind, Record};
use crate::tasks::{self, Task};

const PANEL_HEIGHT: u32 = 520;
const RED: RGBColor = RGBColor(196, 40, 58);
const GREEN: RGBColor = RGBColor(36, 145, 84);

/// What became of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Finished, and within the task's criterion.
    Succeeded,
    /// Finished, but not within it.
    Missed,
    Unfinished,
}

/// How each outcome is drawn; what comes later lies on top.
const OUTCOMES: [(Outcome, &str, RGBColor); 3] = [
    (Outcome::Unfinished, "unfinished", RGBColor(140, 146, 156)),
    (Outcome::Missed, "criterion missed", RGBColor(222, 106, 16)),
    (Outcome::Succeeded, "succeeded", RGBColor(24, 119, 190)),
];

/// The course of one training.
#[derive(Debug)]
pub struct Trace {
    records: Vec<Record>,
}

impl Trace {
    /// Reads the `metrics.jsonl` of a run folder.
    ///
    /// # Errors
    /// A missing file, or the number of a damaged line.
    pub fn read(folder: &Path) -> Result<Self> {
        Ok(Trace { records: metrics::read(&folder.join("metrics.jsonl"))? })
    }

    /// Steps taken until the last record.
    pub fn steps(&self) -> u64 {
        self.records.last().map_or(0, |record| record.step)
    }

    /// Seconds of training until the last record that states them.
    pub fn seconds(&self) -> Option<f64> {
        self.records.iter().rev().find_map(|record| record.value("seconds"))
    }

    /// The first value of this name, the one half-way to the last step, and the last one.
    pub fn course(&self, name: &str) -> Option<[f64; 3]> {
        let points = self.points(None, name);
        let half = self.steps() as f64 / 2.0;
        let middle = points.iter().rfind(|(step, _)| *step <= half).or(points.first())?;
        Some([points.first()?.1, middle.1, points.last()?.1])
    }

    /// The last validation's value of this name.
    pub fn last_validation(&self, name: &str) -> Option<f64> {
        self.points(Some(Kind::Valid), name).last().map(|(_, value)| *value)
    }

    /// (step, value) of the records of a kind (of any, if none is given) that hold a value.
    fn points(&self, kind: Option<Kind>, name: &str) -> Vec<(f64, f64)> {
        metrics::points(&self.records, kind, name)
    }
}

/// Plots the validation losses of all traces, a panel for each loss with the paper's test loss where there is one.
/// False (and no file) if there is nothing to plot.
///
/// # Errors
/// A file that cannot be written.
pub fn write_losses(path: &Path, task: &Task, traces: &[(Outcome, &Trace)]) -> Result<bool> {
    let paper = tasks::paper_losses(task.key);
    let losses = [
        ("L_rec", "recons_loss", paper.map(|paper| paper.reconstruction)),
        ("L_pred", "pred_loss", paper.map(|paper| paper.prediction)),
        ("L_extrap", "extrap_loss", None),
    ];
    let panels = losses.map(|(symbol, name, paper)| PanelPlan {
        title: format!("{}: validation {symbol}, every seed", task.key),
        kind: Some(Kind::Valid),
        name,
        level: paper.map(|paper| ("paper (test)", RED, paper)),
        log: Some(true),
        legend: SeriesLabelPosition::UpperRight,
    });
    write(path, &panels, traces)
}

/// Plots the physical parameters of all traces, a panel for each with its true value. False (and no file) if there is
/// nothing to plot.
///
/// # Errors
/// A file that cannot be written.
pub fn write_parameters(path: &Path, task: &Task, traces: &[(Outcome, &Trace)]) -> Result<bool> {
    let panel = |name: &'static str| {
        let truth = task.truth.iter().find(|truth| truth.name == name).map(|truth| truth.value);
        let stated = truth.map_or(String::new(), |truth| format!(" (true value {truth})"));
        PanelPlan {
            title: format!("{}: {name}, every seed{stated}", task.key),
            kind: None,
            name,
            level: truth.map(|truth| ("true value", GREEN, truth)),
            log: None,
            legend: SeriesLabelPosition::MiddleLeft,
        }
    };
    let panels: Vec<_> = task.cell.parameters.iter().map(|parameter| panel(parameter.name)).collect();
    write(path, &panels, traces)
}

/// What one panel shows.
struct PanelPlan {
    title: String,
    kind: Option<Kind>,
    name: &'static str,
    /// A horizontal line: label, colour, value.
    level: Option<(&'static str, RGBColor, f64)>,
    log: Option<bool>,
    legend: SeriesLabelPosition,
}

fn write(path: &Path, plans: &[PanelPlan], traces: &[(Outcome, &Trace)]) -> Result<bool> {
    let last = traces.iter().map(|(_, trace)| trace.steps()).max().unwrap_or(0).max(1) as f64;
    // Phases end at another step for each seed: one block for all.
    let whole = [Phase { name: String::new(), steps: (0.0, last) }];
    let mut panels = Vec::new();
    for plan in plans {
        let mut lines = Vec::new();
        for (outcome, label, colour) in OUTCOMES {
            let pieces = traces.iter().filter(|(other, _)| *other == outcome);
            let pieces: Vec<_> =
                pieces.map(|(_, trace)| trace.points(plan.kind, plan.name)).filter(|piece| !piece.is_empty()).collect();
            if !pieces.is_empty() {
                lines.push(Line { label, colour, stroke: Stroke::Plain, pieces });
            }
        }
        if lines.is_empty() {
            continue;
        }
        if let Some((label, colour, value)) = plan.level {
            let pieces = vec![vec![(0.0, value), (last, value)]];
            lines.push(Line { label, colour, stroke: Stroke::Dashed, pieces });
        }
        let (title, legend) = (plan.title.clone(), plan.legend.clone());
        panels.push(Panel { title, axis: "step", phases: &whole, lines, log: plan.log, legend });
    }
    if panels.is_empty() {
        return Ok(false);
    }
    curves::write(path, PANEL_HEIGHT * panels.len() as u32, panels)?;
    Ok(true)
}
