//! Plots over all seeds of a group.

use plotters::chart::SeriesLabelPosition;
use plotters::style::RGBColor;

use super::criteria::{Status, status};
use super::groups::RunGroup;
use paig::network::cells::PhysicalParameter;
use paig::network::physics_models::losses::Loss;
use paig::runs::metrics::RecordKind;
use paig::tasks::published::published;
use paig::viz::chart::{BLUE, Chart, GREEN, Line, ORANGE, RED, Span, Stroke};

/// How each status is drawn; what comes later lies on top.
const STATUSES: [(Status, &str, RGBColor); 4] = [
    (Status::Unfinished, "unfinished", RGBColor(140, 146, 156)),
    (Status::Unjudged, "finished", BLUE),
    (Status::Missed, "criterion missed", ORANGE),
    (Status::Succeeded, "succeeded", BLUE),
];

/// The validation losses of all runs, with the paper's test losses where there are some.
pub(super) fn losses(group: &RunGroup) -> Vec<Chart> {
    let task = &group.task.name;
    let chart = |loss: Loss| Chart {
        title: format!("{task}: validation {}, every seed", loss.symbol()),
        level: published().paper_loss(task, loss).map(|paper| ("paper (test)", RED, paper)),
        values: "squared error of a frame",
        log: Some(true),
        legend: Some(SeriesLabelPosition::UpperRight),
        ..courses(group, Some(RecordKind::Valid), loss.key())
    };
    Loss::ALL.map(chart).into()
}

/// The physical parameters of all runs with their true values.
pub(super) fn parameters(group: &RunGroup) -> Vec<Chart> {
    let chart = |parameter: &PhysicalParameter| {
        let finished = group.finished().next().is_some();
        let truth = if finished { group.truth(parameter) } else { group.task.truth_of(&parameter.name) };
        let stated = truth.map_or(String::new(), |truth| format!(" (true value {truth})"));
        Chart {
            title: format!("{}: {}, every seed{stated}", group.task.name, parameter.name),
            level: truth.map(|truth| ("true value", GREEN, truth)),
            ..courses(group, None, &parameter.name)
        }
    };
    group.task.system.cell.parameters.iter().map(chart).collect()
}

/// The values of this name, a line for each run.
fn courses(group: &RunGroup, kind: Option<RecordKind>, name: &str) -> Chart {
    let line = |(of, label, colour): (Status, &str, RGBColor)| {
        let runs = group.runs.iter().filter(|run| status(run) == of);
        let pieces = runs.filter_map(|run| Some(run.known_course()?.points(kind, name))).collect();
        Line { label: label.into(), colour, stroke: Stroke::Plain, pieces }
    };
    let last = group.runs.iter().filter_map(|run| Some(run.known_course()?.steps())).max().unwrap_or(0) as f64;
    Chart {
        title: String::new(),
        axis: "step",
        values: "",
        // Phases end at another step for each seed: one block for all.
        spans: vec![Span { name: String::new(), first: 0.0, last: last.max(1.0) }],
        lines: STATUSES.map(line).into(),
        level: None,
        log: None,
        legend: Some(SeriesLabelPosition::MiddleLeft),
    }
}
