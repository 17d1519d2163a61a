//! One table of many measurements. See `paig measurements --help`.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::Args;
use paig::support::significant::significant;
use paig_terminal::say;
use paig_video::batch;
use paig_video::measure::results::Measurement;
use paig_video::measure::table::{QuantityRow, ROWS, References, read_references, rows, write};

/// Puts measurements into one table, beside the references of their videos.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  paig measurements runs/a runs/b\n  paig measurements real --references reports/real/references.toml --json results.json"
)]
pub struct MeasurementsArguments {
    /// Folders with a measurement.json, or of a `paig batch`
    #[arg(required = true)]
    folders: Vec<PathBuf>,
    /// TOML with references: a table for each video, by its name in the batch or its file's without the ending, with
    /// quantities (period = 2.077, or period = { value = 2.077, from = "source" })
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
    let of_folders: Vec<Vec<QuantityRow>> =
        arguments.folders.iter().map(|folder| rows_of(folder, &references)).collect::<Result<_>>()?;
    let rows = of_folders.concat();
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
        let Some(value) = row.value else {
            say!("{:<18}{}", row.clip, row.reason);
            continue;
        };
        say!(
            "{:<18}{:<38}{value:>12.4}{low:>12}{high:>12}  {:<8}{reference:>12}  {verdict}",
            row.clip,
            row.quantity,
            row.unit
        );
    }
    if let Some(path) = &json {
        write(path, &rows)?;
    }
    Ok(())
}

/// Rows of a measurement, or of all videos of a batch.
fn rows_of(folder: &Path, references: &References) -> Result<Vec<QuantityRow>> {
    let Some(entries) = batch::read(folder)? else {
        return Ok(rows(&Measurement::read(folder)?, None, references));
    };
    let of_entry = |entry: &batch::BatchEntry| match &entry.ending {
        Ok(measurement) => rows(measurement, Some(&entry.name), references),
        Err(reason) => vec![QuantityRow::failed(&entry.name, reason)],
    };
    Ok(entries.iter().flat_map(of_entry).collect())
}
