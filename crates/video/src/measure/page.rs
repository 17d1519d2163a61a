//! measurement.html: one page with all of a measurement, and its charts.

use std::fmt::Write;
use std::io::Write as _;
use std::path::Path;

use anyhow::Result;
use plotters::chart::SeriesLabelPosition;

use super::measured::MeasuredSubject;
use super::motion;
use super::results::EXTENDED;
use super::results::{Alternative, Quantity};
use paig::support::atomic;
use paig::support::significant::significant;
use paig::viz::chart::{self, BLUE, Chart, GREEN, GREY, Line, ORANGE, Span, Stroke};
use paig_report::{cell, code, html};

/// Height of each chart.
const HEIGHT: u32 = 420;
pub(super) const POSITIONS: &str = "measurement-positions.png";
pub(super) const PAGE: &str = "measurement.html";

/// Writes the page and its charts.
pub(super) fn write(folder: &Path, measured: &MeasuredSubject) -> Result<()> {
    chart::write(&folder.join(POSITIONS), HEIGHT, charts(measured))?;
    let page = html::render(&format!("{}: measurement", measured.measurement.task), &text(measured)?, folder)?;
    atomic::write_file(&folder.join(PAGE), |file| Ok(file.write_all(page.as_bytes())?))
}

/// Position of the first object of the first video along its way, measured and fitted, and the residual.
fn charts(measured: &MeasuredSubject) -> Vec<Chart> {
    let recording = &measured.scene.recordings[0];
    let objects = measured.explained.dynamics.system.objects;
    let second = measured.scene.scale.seconds;
    let of_first =
        |numbers: &[f64]| numbers.chunks(2 * objects).flat_map(|frame| frame[..2].to_vec()).collect::<Vec<_>>();
    let places: Vec<f64> = measured.places(0).iter().flat_map(|place| place.at).collect();
    // Both on the line of the fitted motion.
    let both: Vec<f64> = of_first(&places).into_iter().chain(of_first(measured.pixels[0])).collect();
    let along = motion::along_the_way(&both, 2);
    let (fitted, seen_along) = along.split_at(along.len() / 2);
    let times = measured.scene.scale.video_pixels;
    let points = |values: &[f64], from: usize, to: usize| -> Vec<(f64, f64)> {
        (from..to.min(values.len())).map(|frame| (second * recording.times[frame], times * values[frame])).collect()
    };
    let (trained, all) = (recording.trained, fitted.len());
    let left: Vec<f64> = seen_along.iter().zip(fitted).map(|(seen, fitted)| seen - fitted).collect();
    let spans = vec![
        Span { name: "fitted".into(), first: 0.0, last: second * recording.times[trained.min(all - 1)] },
        Span {
            name: "held out".into(),
            first: second * recording.times[trained.min(all - 1)],
            last: second * recording.times[all - 1],
        },
    ];
    let line = |label: &str, colour, stroke, points| Line { label: label.into(), colour, stroke, pieces: vec![points] };
    let chart = |title: &'static str, lines| Chart {
        title: title.into(),
        axis: "seconds",
        values: title,
        spans: spans.clone(),
        lines,
        level: None,
        log: Some(false),
        legend: Some(SeriesLabelPosition::UpperRight),
    };
    vec![
        chart(
            "position along the way, pixels of the video",
            vec![
                line("measured", GREEN, Stroke::Pale, points(seen_along, 0, all)),
                line("fitted", BLUE, Stroke::Plain, points(fitted, 0, trained)),
                line("predicted", ORANGE, Stroke::Plain, points(fitted, trained, all)),
            ],
        ),
        chart(
            "residual: measured minus fitted, pixels of the video",
            vec![line("residual", GREY, Stroke::Plain, points(&left, 0, all))],
        ),
    ]
}

fn text(measured: &MeasuredSubject) -> Result<String> {
    let it = &measured.measurement;
    let mut page = String::new();
    writeln!(page, "# {}\n", it.task)?;
    writeln!(
        page,
        "{} frames of {}, {:.5} s apart; the equation ({}) was fitted to {} in the first {} of them and predicts the rest.\n",
        it.frames,
        it.videos.iter().map(|name| code(name)).collect::<Vec<_>>().join(", "),
        it.seconds_between_frames,
        it.equation,
        it.by,
        it.learned_frames
    )?;
    let beginnings = it.frames - it.learned_frames - it.held_out.frames;
    if beginnings > 0 {
        writeln!(
            page,
            "{beginnings} frames are of videos held out whole: they fix only the initial states of these, no parameter.\n"
        )?;
    }
    writeln!(page, "{}", quantities(&it.quantities)?)?;
    writeln!(
        page,
        "The intervals are from a block bootstrap over time, with the stated uncertainties of scale and time. "
    )?;
    writeln!(
        page,
        "They do not cover systematic errors: lens distortion, a camera that looks obliquely at the plane of the motion.\n"
    )?;
    for note in &it.notes {
        writeln!(page, "- {note}")?;
    }
    let held_out = &it.held_out;
    writeln!(page, "\n## Prediction of the {} held-out frames\n", held_out.frames)?;
    writeln!(page, "| predicted by | distance, {} |\n|---|---|", held_out.unit)?;
    writeln!(
        page,
        "| the fitted equation | {} ({:.2} % of the amplitude) |",
        digits(held_out.error),
        held_out.percent_of_amplitude
    )?;
    writeln!(page, "| constant velocity | {} |", digits(held_out.constant_velocity))?;
    if let Some(error) = held_out.tracker_fit {
        writeln!(page, "| the equation fitted to a colour tracker, at its own positions | {} |", digits(error))?;
    }
    if let Some(metres) = held_out.metres_per_unit {
        writeln!(page, "\nA pixel of the video is {metres:.6} m.")?;
    }
    writeln!(page, "\n![positions]({POSITIONS})\n\n![overlay](overlay.gif)\n")?;
    writeln!(page, "Green: measured. Blue: fitted. Orange: predicted.\n\n## Residuals\n")?;
    let left = &it.residuals;
    let in_pieces = match left.usual_in_pieces {
        Some(usual) => format!("{} {} in short parts with initial states of their own", digits(usual), left.unit),
        None => "the video is too short for parts to compare it with".into(),
    };
    writeln!(
        page,
        "Typically {} {unit} of a coordinate ({in_pieces}). Residuals of neighbouring frames correlate by {:.2}; {:.1} frames \
         count as one independent frame. Blocks of the bootstrap have {} frames.\n",
        digits(left.usual),
        left.autocorrelation.first().copied().unwrap_or(0.0),
        left.frames_in_one,
        left.block,
        unit = left.unit
    )?;
    if let Some(missing) = &it.missing {
        let [before, after] = missing.held_out_error.map(digits);
        writeln!(
            page,
            "## Missing term\n\n{}: the held-out error falls from {before} to {after} {}, the Bayesian criterion by {:.0}.{}\n\n{}",
            missing.name,
            left.unit,
            missing.gain,
            if missing.equation.is_some() {
                format!(" Measure with it: `--equation {EXTENDED}`.")
            } else {
                String::new()
            },
            quantities(&missing.quantities)?
        )?;
    }
    if !it.alternatives.is_empty() {
        writeln!(page, "## Which equation\n\n{}", alternatives(&it.alternatives, &left.unit)?)?;
    }
    Ok(page)
}

fn quantities(quantities: &[Quantity]) -> Result<String> {
    let mut table = String::from("| quantity | value | 95 % interval | unit | cross-check |\n|---|---|---|---|---|\n");
    for it in quantities {
        let tracker = it.by_tracker.map_or("–".into(), digits);
        writeln!(
            table,
            "| {} | {} | {} | {} | {tracker} |",
            it.name.replace('_', " "),
            digits(it.value),
            it.interval(digits).unwrap_or("–".into()),
            it.unit
        )?;
    }
    Ok(table)
}

fn alternatives(alternatives: &[Alternative], unit: &str) -> Result<String> {
    let mut table = format!(
        "| equation | unknowns | residual, {unit} | held-out error, {unit} | AIC | BIC | parameters |\n|---|---|---|---|---|---|---|\n"
    );
    for it in alternatives {
        let parameters = it.parameters.iter().map(|(name, value)| format!("{name} {}", digits(*value)));
        let parameters = parameters.collect::<Vec<_>>().join(", ");
        writeln!(
            table,
            "| {} | {} | {} | {} | {:.1} | {:.1} | {parameters} |",
            cell(&it.equation),
            it.unknowns,
            digits(it.residual),
            digits(it.held_out_error),
            it.aic,
            it.bic
        )?;
    }
    Ok(table)
}

fn digits(value: f64) -> String {
    significant(value, 5)
}
