//! `losses.png` and `parameters.png`: the training as metrics.jsonl tells it.

use std::path::Path;

use anyhow::{Result, anyhow};
use plotters::chart::SeriesLabelPosition;
use plotters::style::RGBColor;

use super::chart::{self, BLUE, Chart, GREEN, GREY, Line, ORANGE, RED, Span, Stroke};
use crate::runs::metrics::{self, RecordKind, Stretch, points};
use crate::support::error::Error;
use crate::support::run_names::METRICS;
use crate::tasks::{Task, TrueParameter};

const LOSSES_HEIGHT: u32 = 900;
const PARAMETER_HEIGHT: u32 = 560;

/// What `losses.png` shows: label, kind of record, name in it, colour, stroke. What comes later lies on top.
const LOSSES: [(&str, RecordKind, &str, RGBColor, Stroke); 6] = [
    ("train loss", RecordKind::Train, "train_loss", GREY, Stroke::Pale),
    ("train L_rec", RecordKind::Train, "recons_loss", GREEN, Stroke::Pale),
    ("train L_pred", RecordKind::Train, "pred_loss", BLUE, Stroke::Pale),
    ("valid L_extrap", RecordKind::Valid, "extrap_loss", ORANGE, Stroke::Dotted),
    ("valid L_pred", RecordKind::Valid, "pred_loss", BLUE, Stroke::Dotted),
    ("valid L_rec", RecordKind::Valid, "recons_loss", GREEN, Stroke::Dotted),
];

/// Plots a run folder's `metrics.jsonl`: `losses.png` (log axis), and `parameters.png` with the true values if the task
/// has physical parameters, those of `truth` with their true values. The steps are those of all phases.
///
/// # Errors
/// A missing or damaged `metrics.jsonl` (with the line's number), one without losses, a folder that cannot be written.
pub fn write_curves(folder: &Path, task: &Task, truth: &[TrueParameter]) -> Result<(), Error> {
    let path = folder.join(METRICS);
    let records = metrics::read(&path)?;
    let stretches = metrics::stretches(&records);
    let spans: Vec<Span> = stretches.iter().map(span).collect();
    let lines = LOSSES.map(|(label, kind, name, colour, stroke)| {
        // The train loss is another one in each phase, so nothing is joined across phases.
        let piece = |stretch: &Stretch| points(&records[stretch.records.clone()], Some(kind), name);
        Line { label: label.into(), colour, stroke, pieces: stretches.iter().map(piece).collect() }
    });
    let losses = Chart {
        title: format!("{}: losses", task.name),
        axis: "step",
        values: "loss: squared error of a frame",
        spans: spans.clone(),
        lines: lines.into(),
        level: None,
        log: Some(true),
        legend: Some(SeriesLabelPosition::UpperRight),
    };
    let any = chart::write(&folder.join("losses.png"), LOSSES_HEIGHT, vec![losses])?;
    if !any {
        return Err(anyhow!("{} holds no losses", path.display()).into());
    }
    let parameter = |name: &str| {
        let learned = points(&records, None, name);
        let truth = truth.iter().find(|truth| truth.name == name).map(|truth| truth.value);
        let stated = truth.map_or(String::new(), |truth| format!(" (true value {truth})"));
        Some(Chart {
            title: format!("{}: {name} = {:.3}{stated}", task.name, learned.last()?.1),
            axis: "step",
            values: "value, lengths in pixels",
            spans: spans.clone(),
            lines: vec![Line { label: "learned".into(), colour: BLUE, stroke: Stroke::Plain, pieces: vec![learned] }],
            level: truth.map(|truth| ("true value", RED, truth)),
            log: None,
            // A parameter goes from where it started to the truth: the middle of the right side stays free.
            legend: Some(SeriesLabelPosition::MiddleRight),
        })
    };
    let parameters = task.system.cell.parameters.iter().filter_map(|p| parameter(&p.name)).collect();
    chart::write(&folder.join("parameters.png"), PARAMETER_HEIGHT, parameters)?;
    Ok(())
}

fn span(stretch: &Stretch) -> Span {
    Span { name: stretch.phase.clone(), first: stretch.steps.0 as f64, last: stretch.steps.1 as f64 }
}
