//! Table of the measured synthetic videos.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use paig_video::measure::results::{Measurement, Outcome};
use serde::Serialize;

use super::VideoPlan;
use super::kinds::{KINDS, MotionKind, TrueMotion};
use crate::report_files;

/// Errors up to which a quantity counts as right, and beyond which one that is `found` counts as false.
const RIGHT: f64 = 0.01;
const FALSE: f64 = 0.05;

/// One quantity of one video.
#[derive(Debug, Serialize)]
pub struct SyntheticRow {
    clip: u64,
    kind: &'static str,
    quantity: &'static str,
    /// Whether the video is made for this quantity.
    main: bool,
    verdict: Option<Outcome>,
    value: Option<f64>,
    low: Option<f64>,
    high: Option<f64>,
    truth: f64,
    tracker_value: Option<f64>,
    tracker_low: Option<f64>,
    tracker_high: Option<f64>,
    heldout_error: Option<f64>,
    heldout_error_constant_velocity: Option<f64>,
    frames: usize,
    seconds: f64,
    /// What speaks against the number, or why there is none.
    reason: Option<String>,
}

impl SyntheticRow {
    /// Relative error.
    fn error(&self) -> Option<f64> {
        Some((self.value? / self.truth - 1.0).abs())
    }

    fn held(&self) -> Option<bool> {
        Some(self.low? <= self.truth && self.truth <= self.high?)
    }

    /// Said to be found, but neither near the truth nor with it in the interval.
    fn false_found(&self) -> bool {
        self.found() && self.held() == Some(false) && self.error().is_none_or(|error| error > FALSE)
    }

    fn found(&self) -> bool {
        self.verdict == Some(Outcome::Found)
    }

    pub fn print(&self) {
        let number = |x: Option<f64>| x.map_or("-".into(), |x| format!("{x:.4}"));
        println!(
            "{:>3} {:<26} {:<3} {:>9}: {:>10} [{}, {}] truth {:.4}, error {} %, {} frames, {:.0} s{}",
            self.clip,
            self.kind,
            self.quantity,
            self.verdict.map_or("-".into(), |verdict| verdict.to_string()),
            number(self.value),
            number(self.low),
            number(self.high),
            self.truth,
            number(self.error().map(|error| 100.0 * error)),
            self.frames,
            self.seconds,
            if self.found() { String::new() } else { format!(" ({})", self.reason.clone().unwrap_or_default()) },
        );
    }
}

/// The quantities of one video.
pub fn rows(
    clip: u64,
    kind: &MotionKind,
    made: &VideoPlan,
    measured: Result<&Measurement, &anyhow::Error>,
    seconds: f64,
) -> Vec<SyntheticRow> {
    let measurement = measured.ok();
    let reason = match measured {
        Ok(measurement) => measurement.verdict.as_ref().and_then(|verdict| verdict.reasons.first().cloned()),
        Err(error) => Some(format!("{error:#}")),
    };
    let row = |(place, (name, truth)): (usize, &(&'static str, f64))| {
        let quantity = measurement.and_then(|measurement| measurement.quantity(name));
        SyntheticRow {
            clip,
            kind: kind.name,
            quantity: name,
            main: place == 0,
            verdict: quantity.and_then(|it| it.outcome),
            value: quantity.map(|it| it.value),
            low: quantity.and_then(|it| it.low),
            high: quantity.and_then(|it| it.high),
            truth: *truth,
            tracker_value: quantity.and_then(|it| it.by_tracker),
            tracker_low: quantity.and_then(|it| it.tracker_low),
            tracker_high: quantity.and_then(|it| it.tracker_high),
            heldout_error: measurement.map(|it| it.held_out.error),
            heldout_error_constant_velocity: measurement.map(|it| it.held_out.constant_velocity),
            frames: made.clock.frames,
            seconds,
            reason: reason.clone(),
        }
    };
    let TrueMotion { truth, renumbered, .. } = &made.motion;
    let off = |truths: &[(&'static str, f64)]| -> f64 {
        let values = truths.iter().filter_map(|(name, truth)| Some(measurement?.quantity(name)?.value / truth));
        values.map(|ratio| ratio.abs().ln().abs()).sum()
    };
    let other: Vec<_> = truth.iter().zip(renumbered).map(|((name, _), value)| (*name, *value)).collect();
    let truth = if !other.is_empty() && off(&other) < off(truth) { &other } else { truth };
    truth.iter().enumerate().map(row).collect()
}

/// Writes results.json and report.md.
///
/// # Errors
/// A full disk.
pub fn write(folder: &Path, rows: &[SyntheticRow]) -> Result<()> {
    report_files::write(folder, rows, &text(rows)?)
}

fn text(rows: &[SyntheticRow]) -> Result<String> {
    let mut text = String::from(
        "# Synthetic videos\n\nMade and measured by `cargo xtask synthetic-video`: 1280 x 720 pixels, H.264, with texture, shadow, \
         motion blur, noise and changing light; the true values are known. The equation is that of the gallery, with no other \
         option. Errors are those of the quantity that a video is made for (the first of each kind); coverage is of all \
         quantities.\n\n| motion | videos | found | within 1 % | median error | false `found` | coverage of 95 % intervals | \
         median time |\n|---|---|---|---|---|---|---|---|\n",
    );
    let kinds = KINDS.iter().map(|kind| (kind.name, vec![kind.name])).collect::<Vec<_>>();
    let all = ("all", KINDS.iter().map(|kind| kind.name).collect());
    for (name, kinds) in kinds.into_iter().chain([all]) {
        let of_kinds: Vec<&SyntheticRow> = rows.iter().filter(|row| kinds.contains(&row.kind)).collect();
        let main: Vec<_> = of_kinds.iter().filter(|row| row.main).collect();
        if main.is_empty() {
            continue;
        }
        let count = |condition: &dyn Fn(&SyntheticRow) -> bool| main.iter().filter(|row| condition(row)).count();
        let median = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
        };
        let held: Vec<bool> = of_kinds.iter().filter_map(|row| row.held()).collect();
        writeln!(
            text,
            "| {name} | {} | {} | {} | {:.3} % | {} | {} of {} | {:.1} s |",
            main.len(),
            count(&SyntheticRow::found),
            count(&|row| row.error().is_some_and(|error| error <= RIGHT)),
            100.0 * median(main.iter().map(|row| row.error().unwrap_or(f64::INFINITY)).collect()),
            of_kinds.iter().filter(|row| row.false_found()).count(),
            held.iter().filter(|held| **held).count(),
            held.len(),
            median(main.iter().map(|row| row.seconds).collect()),
        )?;
    }
    Ok(text)
}
