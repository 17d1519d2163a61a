//! Measurements of filmed videos beside what others published of them: `cargo xtask tables`.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use paig::support::significant::significant;
use paig::support::storage;
use paig_video::batch::{self, BatchEntry};
use paig_video::measure::compare_track::{Estimate, compare_track};
use paig_video::measure::results::Measurement;
use paig_video::reference_track::ReferenceTrack;
use serde::{Deserialize, Serialize};

use crate::report_files;

/// Writes results.json and report.md of reports/tables from a batch of measurements and the authors' tracks.
#[derive(Debug, Args)]
pub struct TablesArguments {
    /// Folder of a `paig batch`, such as that of reports/real/videos.toml
    batch: PathBuf,
    /// Folder with the authors' tracks, if there are any
    tracks: Option<PathBuf>,
    /// Published values
    #[arg(long, value_name = "FILE", default_value = "reports/tables/published.toml")]
    published: PathBuf,
    /// Folder of results.json and report.md
    #[arg(long, value_name = "DIR", default_value = "reports/tables")]
    out: PathBuf,
}

/// Contents of the file of published values.
#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PublishedFile {
    /// Tracks that authors published.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub track: Vec<PublishedTrack>,
    /// Values that were published.
    pub value: Vec<PublishedValue>,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PublishedTrack {
    clip: String,
    file: PathBuf,
    by: String,
}

#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PublishedValue {
    pub table: String,
    pub clip: String,
    pub quantity: String,
    pub published: Option<f64>,
    pub by: String,
    pub truth: Option<f64>,
}

/// A row of the tables.
#[derive(Debug, Serialize)]
struct TableRow {
    table: String,
    clip: String,
    quantity: String,
    ours: Option<f64>,
    low: Option<f64>,
    high: Option<f64>,
    /// Verdict on our value.
    verdict: Option<String>,
    published: Option<f64>,
    published_low: Option<f64>,
    published_high: Option<f64>,
    published_by: String,
    truth: Option<f64>,
    unit: String,
}

/// # Errors
/// A batch without one of the clips, a damaged track, a full disk.
pub fn run(arguments: &TablesArguments) -> Result<()> {
    let text = storage::read_to_string(&arguments.published)?;
    let published: PublishedFile =
        toml::from_str(&text).with_context(|| format!("published values {}", arguments.published.display()))?;
    let entries = batch::read(&arguments.batch)?;
    let entries =
        entries.with_context(|| format!("folder {}: it is not that of a paig batch", arguments.batch.display()))?;
    let mut rows = Vec::new();
    for track in &published.track {
        rows.extend(of_track(arguments, track).with_context(|| format!("clip {}", track.clip))?);
    }
    for value in &published.value {
        let entry = entries.iter().find(|entry| entry.name == value.clip);
        let entry = entry.with_context(|| format!("clip {}: the batch has no video of this name", value.clip))?;
        rows.push(of_value(entry, value));
    }
    let page = page(&rows)?;
    print!("{page}");
    report_files::write(&arguments.out, &rows, &page)
}

/// Distances of the positions, and each parameter beside the same equation fitted to the author's track.
fn of_track(arguments: &TablesArguments, track: &PublishedTrack) -> Result<Vec<TableRow>> {
    let folder = arguments.batch.join(&track.clip);
    let measurement = Measurement::read(&folder)?;
    let tracks =
        arguments.tracks.as_deref().context("give the folder with the authors' tracks after that of the batch")?;
    let comparison = compare_track(&folder, &ReferenceTrack::read(&tracks.join(&track.file))?)?;
    let row = |quantity: &str, unit: &str| TableRow {
        table: "authors' tracks".into(),
        clip: track.clip.clone(),
        quantity: quantity.into(),
        ours: None,
        low: None,
        high: None,
        verdict: None,
        published: None,
        published_low: None,
        published_high: None,
        published_by: track.by.clone(),
        truth: None,
        unit: unit.into(),
    };
    let distances = comparison.points.iter().flat_map(|point| {
        let share = point.of_diameter.map(|share| TableRow {
            ours: Some(100.0 * share),
            ..row("median distance from the author's positions, of the diameter", "%")
        });
        let distance =
            TableRow { ours: Some(point.median), ..row("median distance from the author's positions", "px") };
        std::iter::once(distance).chain(share)
    });
    let values = comparison.quantities.iter().filter_map(|quantity| {
        let Estimate { value, low, high } = &quantity.by_other_track.as_ref()?;
        let outcome = measurement.quantity(&quantity.name).and_then(|it| it.outcome);
        Some(TableRow {
            ours: Some(quantity.measured.value),
            low: quantity.measured.low,
            high: quantity.measured.high,
            verdict: outcome.map(|outcome| outcome.to_string()),
            published: Some(*value),
            published_low: *low,
            published_high: *high,
            ..row(&quantity.name, &quantity.unit)
        })
    });
    Ok(distances.chain(values).collect())
}

/// A row without a value of ours for a video that could not be measured.
fn of_value(entry: &BatchEntry, value: &PublishedValue) -> TableRow {
    let measurement = entry.ending.as_ref().ok();
    let quantity = measurement.and_then(|measurement| measurement.quantity(&value.quantity));
    let failed = measurement.is_none().then(|| "not measured".to_string());
    TableRow {
        table: value.table.clone(),
        clip: value.clip.clone(),
        quantity: value.quantity.clone(),
        ours: quantity.map(|it| it.value),
        low: quantity.and_then(|it| it.low),
        high: quantity.and_then(|it| it.high),
        verdict: quantity.and_then(|it| it.outcome).map(|outcome| outcome.to_string()).or(failed),
        published: value.published,
        published_low: None,
        published_high: None,
        published_by: value.by.clone(),
        truth: value.truth,
        unit: quantity.map_or(String::new(), |it| it.unit.clone()),
    }
}

fn page(rows: &[TableRow]) -> Result<String> {
    let mut page = String::from(
        "# Published values beside ours\n\nMade by `cargo xtask tables`. For authors' tracks \"published\" is the same equation fitted to \
         the author's positions in the frames that both have.\n\n| table | clip | quantity | ours | verdict | published | by | true | unit |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    let number = |value: Option<f64>| value.map_or("–".into(), |value| significant(value, 5));
    for row in rows {
        let interval = |value, low: Option<f64>, high: Option<f64>| match low.zip(high) {
            Some((low, high)) => format!("{} [{}, {}]", number(value), significant(low, 5), significant(high, 5)),
            None => number(value),
        };
        writeln!(
            page,
            "| {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            row.table,
            row.clip,
            row.quantity,
            interval(row.ours, row.low, row.high),
            row.verdict.as_deref().unwrap_or("–"),
            interval(row.published, row.published_low, row.published_high),
            row.published_by,
            number(row.truth),
            row.unit
        )?;
    }
    Ok(page)
}
