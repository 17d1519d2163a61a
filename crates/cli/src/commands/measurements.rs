//! One table of many measurements. See `paig measurements --help`.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use paig::support::significant::significant;
use paig_terminal::say;
use paig_video::measure::results::Measurement;
use paig_video::measure::table::{ROWS, References, read_references, rows, write};

/// Puts the measurements of some runs into one table, beside what is known of their videos.
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  paig measurements runs/a runs/b --references reports/real/references.toml --json results.json"
)]
pub struct MeasurementsArguments {
    /// Folders with a measurement.json
    #[arg(required = true)]
    folders: Vec<PathBuf>,
    /// TOML with what is known: a table for each video, by its file's name without the ending, with quantities
    #[arg(long, value_name = "FILE")]
    references: Option<PathBuf>,
    /// Write the rows to this file, too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

pub fn run(arguments: &MeasurementsArguments) -> Result<()> {
    let inputs: Vec<&Path> = arguments.references.as_deref().into_iter().collect();
    let json = arguments.json.as_deref().map(|path| ROWS.check(path, &inputs)).transpose()?;
    let references = arguments.references.as_deref().map(read_references).transpose()?;
    let references: References = references.unwrap_or_default();
    let measurements: Vec<_> =
        arguments.folders.iter().map(|folder| Measurement::read(folder)).collect::<Result<_>>()?;
    let rows: Vec<_> = measurements.iter().flat_map(|it| rows(it, &references)).collect();
    let number = |value: Option<f64>| value.map_or("-".into(), |value| significant(value, 5));
    say!(
        "{:<18}{:<38}{:>12}{:>12}{:>12}  {:<8}{:>12}  {}",
        "clip",
        "quantity",
        "value",
        "low",
        "high",
        "unit",
        "reference",
        "verdict"
    );
    for row in &rows {
        let verdict = row.verdict.map_or(String::new(), |outcome| outcome.to_string());
        let (low, high, reference) = (number(row.low), number(row.high), number(row.reference));
        say!(
            "{:<18}{:<38}{:>12.4}{low:>12}{high:>12}  {:<8}{reference:>12}  {verdict}",
            row.clip,
            row.quantity,
            row.value,
            row.unit
        );
    }
    if let Some(path) = &json {
        write(path, &rows)?;
    }
    Ok(())
}
