//! A report of many runs: report.md, report.html (one file, nothing loaded from anywhere), results.json, and the runs'
//! records, from which it can be made again.
//!
//! Every run found under the given folders is counted; nothing is selected. The numbers come from each run's
//! `summary.json` and `metrics.jsonl`; published numbers, hypotheses, rules and all words from files in `reports/`.

mod commands;
mod criteria;
mod groups;
pub mod html;
mod hypotheses;
mod page;
mod pictures;
mod plots;
mod protocol;
mod records;
mod results;
mod template;
mod times;
mod view;

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use self::groups::RunGroup;
use self::results::Results;
use paig::Error;
use paig::support::guard::ensure_no_run;
use paig::support::output::FileSet;
use paig::support::{atomic, json_lines};

pub use self::pictures::WithPictures;
pub use self::template::{cell, code, fill_template};

/// How many runs were found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunCounts {
    pub finished: usize,
    pub unfinished: usize,
    /// Folders with a config or a summary that cannot be read.
    pub unreadable: usize,
    /// Why the courses of finished runs cannot be used: damaged, or of another run.
    pub without_course: Vec<String>,
}

/// Reads all run folders in and under `folders` and writes the report of them into `out`, with or without pictures.
///
/// # Errors
/// A folder that cannot be listed or that the report would replace, no run at all, an output folder that cannot be
/// written. A run that is damaged is no error: the report says so.
pub fn write(folders: &[PathBuf], out: &Path, shown: WithPictures) -> Result<RunCounts, Error> {
    Ok(written(folders, out, shown)?)
}

fn written(folders: &[PathBuf], out: &Path, shown: WithPictures) -> Result<RunCounts> {
    ensure_no_run(out)?;
    FILES.settle(out)?;
    FILES.check(out)?;
    let found = records::find(folders, out)?;
    let places: Vec<_> = folders.iter().map(|folder| folder.display().to_string()).collect();
    ensure!(
        !found.runs.is_empty() || !found.unreadable.is_empty(),
        "there is no run folder (a folder with a config.toml and a metrics.jsonl) in {}",
        places.join(", ")
    );
    let finished = found.runs.iter().filter(|run| run.summary.is_some()).count();
    let unfinished = found.runs.len() - finished;
    let of_finished = found.runs.iter().filter(|run| run.summary.is_some());
    let without_course = of_finished.filter_map(|run| Some(format!("{:#}", run.course.as_ref().err()?))).collect();
    let groups = groups::group(found.runs);
    FILES.replace(out, |new| fill(new, out, &groups, &found.unreadable, &places, shown))?;
    Ok(RunCounts { finished, unfinished, unreadable: found.unreadable.len(), without_course })
}

/// The files of a report. The page comes last: it shows whose the folders are.
const FILES: FileSet = FileSet {
    name: "a report",
    files: &[records::FOLDER, pictures::FOLDER, records::RESULTS, HTML, PAGE],
    recognizes: |page| page.starts_with(format!("# {}", template::TITLE).as_bytes()),
};
const PAGE: &str = "report.md";
const HTML: &str = "report.html";

/// Writes all of a report into an empty folder, from where it moves to `place`.
fn fill(
    out: &Path,
    place: &Path,
    groups: &[RunGroup],
    unreadable: &[(PathBuf, anyhow::Error)],
    searched: &[String],
    shown: WithPictures,
) -> Result<()> {
    let records = records::write(out, groups)?;
    let pictures = pictures::write(out, groups, &records, shown)?;
    let records: Vec<Vec<_>> = records.iter().map(|runs| runs.iter().map(|run| place.join(run)).collect()).collect();
    let markdown = page::page(groups, unreadable, &pictures, &records, searched, shown)?;
    let results = Results::of(groups);
    atomic::write_file(&out.join(records::RESULTS), |file| Ok(json_lines::write(file, &results, 2)?))?;
    atomic::write_file(&out.join(PAGE), |file| Ok(file.write_all(markdown.as_bytes())?))?;
    let html = html::render(template::TITLE, &markdown, out)?;
    atomic::write_file(&out.join(HTML), |file| Ok(file.write_all(html.as_bytes())?))
}
