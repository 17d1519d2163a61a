//! Measurements of many videos in one table: CSV, JSON and a page with a picture of each video.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use image::imageops::thumbnail;
use paig::support::output::{FileSet, has_keys};
use paig::support::significant::significant;
use paig::support::{atomic, storage};
use paig_report::{cell, html};
use serde::{Deserialize, Serialize};

use crate::import::sources::SourceVideo;
use crate::measure::results::{Measurement, Quantity};

/// Files of the table.
pub const CSV: &str = "batch.csv";
pub const JSON: &str = "batch.json";
pub const PAGE: &str = "batch.html";
/// The table as files that are replaced together.
pub const FILES: FileSet = FileSet {
    name: "a table of `paig batch`",
    files: &[CSV, PAGE, JSON],
    recognizes: |json| has_keys(json, &["name", "video", "verdict", "reason"]),
};
/// Picture of a video in its folder, and its longer side, pixels.
const THUMBNAIL: &str = "thumbnail.png";
const SIDE: u32 = 160;
/// Endings of files that a folder's videos have.
const ENDINGS: [&str; 15] =
    ["mp4", "mov", "m4v", "mkv", "webm", "avi", "ts", "m2ts", "mts", "mpg", "ogv", "wmv", "gif", "trz", "npz"];

/// One video of a batch.
#[derive(Debug, Clone)]
pub struct BatchEntry {
    /// Name of its folder within the batch's.
    pub name: String,
    pub video: PathBuf,
    /// What was measured, or why nothing was.
    pub ending: Result<Measurement, String>,
}

/// A quantity of a video, or its failure, as batch.json has it.
#[derive(Debug, Serialize)]
struct BatchRow<'a> {
    name: &'a str,
    video: &'a Path,
    verdict: Option<String>,
    /// Reasons of the verdict, or of the failure.
    reason: String,
    quantities: &'a [Quantity],
}

/// Videos of a folder by their endings, in order of their names; not those in folders within it.
///
/// # Errors
/// A folder that cannot be read, or one without videos.
pub fn videos_of(folder: &Path) -> Result<Vec<PathBuf>> {
    let named = || format!("folder {}", folder.display());
    let mut videos = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(named)? {
        let path = entry.with_context(named)?.path();
        let ending = path.extension().and_then(|it| it.to_str()).unwrap_or_default().to_lowercase();
        if path.is_file() && ENDINGS.contains(&ending.as_str()) {
            videos.push(path);
        }
    }
    ensure!(!videos.is_empty(), "folder {}: no videos in it ({})", folder.display(), ENDINGS.join(", "));
    videos.sort();
    Ok(videos)
}

/// Writes the table into the folder of the batch.
///
/// # Errors
/// A folder that cannot be written, or that holds other files of the table's names.
pub fn write(folder: &Path, entries: &[BatchEntry]) -> Result<()> {
    let rows: Vec<BatchRow> = entries.iter().map(BatchEntry::row).collect();
    let page = html::render("Measured videos", &page(folder, entries, &rows)?, folder)?;
    FILES.replace(folder, |folder| {
        atomic::write_file(&folder.join(JSON), |file| Ok(serde_json::to_writer_pretty(file, &rows)?))?;
        atomic::write_file(&folder.join(CSV), |file| Ok(file.write_all(csv(&rows).as_bytes())?))?;
        atomic::write_file(&folder.join(PAGE), |file| Ok(file.write_all(page.as_bytes())?))
    })
}

/// Entries of the batch in a folder; none of a folder that is no batch's.
///
/// # Errors
/// A damaged batch.json.
pub fn read(folder: &Path) -> Result<Option<Vec<BatchEntry>>> {
    #[derive(Deserialize)]
    struct EntryRecord {
        name: String,
        video: PathBuf,
        verdict: Option<String>,
        reason: String,
    }
    let path = folder.join(JSON);
    if !path.is_file() {
        return Ok(None);
    }
    let text = storage::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let rows: Vec<EntryRecord> =
        serde_json::from_slice(&text).with_context(|| format!("{} is damaged", path.display()))?;
    let entry = |EntryRecord { name, video, verdict, reason }| {
        let read = || Measurement::read(&folder.join(&name)).map_err(|error| format!("{error:#}"));
        let ending = if verdict.is_some() { read() } else { Err(reason) };
        BatchEntry { name, video, ending }
    };
    Ok(Some(rows.into_iter().map(entry).collect()))
}

impl BatchEntry {
    fn row(&self) -> BatchRow<'_> {
        let (verdict, reason, quantities) = match &self.ending {
            Ok(it) => {
                let verdict = it.verdict.as_ref();
                let reasons = verdict.map_or(String::new(), |it| it.reasons.join("; "));
                (verdict.map(|it| it.outcome.to_string()), reasons, &it.quantities[..])
            }
            Err(reason) => (None, reason.clone(), &[][..]),
        };
        BatchRow { name: &self.name, video: &self.video, verdict, reason, quantities }
    }

    /// Puts a picture of the video into its folder. A video that cannot be decoded has none.
    fn thumbnail(&self, folder: &Path) -> Option<String> {
        let video = SourceVideo::open(&self.video).ok()?;
        let frame = video.decode().ok()?.frame(video.frames / 2).ok()?;
        let (width, height) = frame.dimensions();
        let side = |side: u32| (side * SIDE / width.max(height)).max(1);
        let small = thumbnail(&frame, side(width), side(height));
        let written = atomic::write_file(&folder.join(&self.name).join(THUMBNAIL), |file| {
            Ok(small.write_with_encoder(image::codecs::png::PngEncoder::new(file))?)
        });
        written.ok().map(|()| format!("{}/{THUMBNAIL}", self.name))
    }
}

/// A line for each quantity; one without a quantity for a failure.
fn csv(rows: &[BatchRow]) -> String {
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    let mut text = String::from("name,video,quantity,value,low,high,unit,outcome,verdict,reason\n");
    for row in rows {
        let (name, video) = (quoted(row.name), quoted(&row.video.display().to_string()));
        let end = format!("{},{}", row.verdict.as_deref().unwrap_or("failed"), quoted(&row.reason));
        let lines = row.quantities.iter().map(|it| {
            let outcome = it.outcome.map_or(String::new(), |outcome| outcome.to_string());
            format!("{},{},{},{},{},{outcome}", it.name, it.value, number(it.low), number(it.high), it.unit)
        });
        let none = row.quantities.is_empty().then(|| ",,,,,".to_string());
        lines.chain(none).for_each(|line| text.push_str(&format!("{name},{video},{line},{end}\n")));
    }
    text
}

fn page(folder: &Path, entries: &[BatchEntry], rows: &[BatchRow]) -> Result<String> {
    let mut page = String::from("# Measured videos\n\n| | video | verdict | quantities | |\n|---|---|---|---|---|\n");
    for (entry, row) in entries.iter().zip(rows) {
        let picture = entry.thumbnail(folder).map_or(String::new(), |path| format!("![](<{path}>)"));
        let digits = |value: f64| significant(value, 5);
        let quantities = row.quantities.iter().map(|it| {
            let interval = it.interval(digits).map_or(String::new(), |interval| format!(" ({interval})"));
            format!("{} {}{interval} {}", it.name.replace('_', " "), digits(it.value), it.unit)
        });
        let quantities = quantities.collect::<Vec<_>>().join("; ");
        let verdict = row.verdict.as_deref().unwrap_or("failed");
        let link = match entry.ending {
            Ok(_) => format!("[measurement](<{}/measurement.html>)", entry.name),
            Err(_) => String::new(),
        };
        let reason = if row.reason.is_empty() { String::new() } else { format!(": {}", cell(&row.reason)) };
        writeln!(page, "| {picture} | {} | {verdict}{reason} | {} | {link} |", cell(row.name), cell(&quantities))?;
    }
    Ok(page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_video_has_a_line_in_every_table() {
        let folder = tempfile::tempdir().unwrap();
        let entry = BatchEntry {
            name: "a".into(),
            video: folder.path().join("a \"1\".mp4"),
            ending: Err("nothing moves, or nearly".into()),
        };
        write(folder.path(), &[entry]).unwrap();
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        let csv = read(CSV);
        assert_eq!(csv.lines().count(), 2);
        assert!(csv.contains("a \"\"1\"\".mp4") && csv.ends_with(",failed,\"nothing moves, or nearly\"\n"), "{csv}");
        assert!(read(PAGE).contains("nothing moves, or nearly"));
        let json: serde_json::Value = serde_json::from_str(&read(JSON)).unwrap();
        assert_eq!(json[0]["reason"], "nothing moves, or nearly");
    }

    #[test]
    fn videos_of_a_folder_come_in_order_and_without_other_files() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.MOV", "a.mp4", "notes.txt"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let names = videos_of(folder.path()).unwrap();
        assert_eq!(names, ["a.mp4", "b.MOV"].map(|name| folder.path().join(name)));
    }
}
