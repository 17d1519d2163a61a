//! A report of many runs: report.md, report.html (one file, nothing loaded from anywhere), results.json, and the runs'
//! records, from which it can be made again.
//!
//! Every run found under the given folders is counted; nothing is selected. The numbers come from each run's
//! `summary.json` and `metrics.jsonl`; published numbers, hypotheses, rules and all words from files in `reports/`.

mod commands;
mod criteria;
mod groups;
pub(crate) mod html;
mod hypotheses;
mod page;
mod pictures;
mod plots;
mod protocol;
mod records;
mod results;
mod template;
mod view;

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use self::groups::Group;
use self::results::Results;
use crate::support::atomic;

/// How many runs were found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunCounts {
    pub finished: usize,
    pub unfinished: usize,
    /// Folders with a config or a summary that cannot be read.
    pub unreadable: usize,
}

/// Reads all run folders in and under `folders` and writes the report of them into `out`.
///
/// # Errors
/// A folder that cannot be listed or that the report would replace, no run at all, an output folder that cannot be
/// written. A run that is damaged is no error: the report says so.
pub fn write(folders: &[PathBuf], out: &Path) -> Result<RunCounts> {
    let found = records::find(folders, out)?;
    let places: Vec<_> = folders.iter().map(|folder| folder.display().to_string()).collect();
    ensure!(
        !found.runs.is_empty() || !found.unreadable.is_empty(),
        "there is no run folder (a folder with a config.toml and a metrics.jsonl) in {}",
        places.join(", ")
    );
    let finished = found.runs.iter().filter(|run| run.summary.is_some()).count();
    let unfinished = found.runs.len() - finished;
    let groups = groups::group(found.runs);
    fs::create_dir_all(out).with_context(|| format!("cannot create {}", out.display()))?;
    // Made aside: whatever goes wrong, the earlier report and its records stay as they are.
    let new = tempfile::Builder::new().prefix(".new-").tempdir_in(out);
    let new = new.with_context(|| format!("cannot write into {}", out.display()))?;
    fill(new.path(), &groups, &found.unreadable, &places)?;
    clear(out)?;
    move_into(new.path(), out)?;
    Ok(RunCounts { finished, unfinished, unreadable: found.unreadable.len() })
}

/// Writes all of a report into an empty folder.
fn fill(out: &Path, groups: &[Group], unreadable: &[(PathBuf, anyhow::Error)], places: &[String]) -> Result<()> {
    let places_of_records = records::write(out, groups)?;
    let pictures = pictures::write(out, groups, &places_of_records)?;
    let markdown = page::page(groups, unreadable, &pictures, places)?;
    let results = Results::of(groups);
    atomic::write_file(&out.join(records::RESULTS), |file| Ok(serde_json::to_writer_pretty(file, &results)?))?;
    atomic::write_file(&out.join("report.md"), |file| Ok(file.write_all(markdown.as_bytes())?))?;
    let html = html::render(template::TITLE, &markdown, out)?;
    atomic::write_file(&out.join("report.html"), |file| Ok(file.write_all(html.as_bytes())?))
}

/// Moves what is in a folder into another one of the same file system, among what is there.
fn move_into(from: &Path, to: &Path) -> Result<()> {
    for entry in fs::read_dir(from).with_context(|| format!("cannot list {}", from.display()))? {
        let entry = entry?;
        let (from, to) = (from.join(entry.file_name()), to.join(entry.file_name()));
        if from.is_dir() && to.is_dir() {
            move_into(&from, &to)?;
        } else {
            fs::rename(&from, &to).with_context(|| format!("cannot write {}", to.display()))?;
        }
    }
    Ok(())
}

/// Removes what an earlier report would leave among the files of the new one. Folders of these names beside which no
/// report lies stay.
fn clear(out: &Path) -> Result<()> {
    let report = fs::read_to_string(out.join("report.md")).unwrap_or_default();
    if !report.starts_with(&format!("# {}", template::TITLE)) {
        return Ok(());
    }
    for folder in [records::FOLDER, pictures::FOLDER].map(|name| out.join(name)) {
        if folder.exists() {
            fs::remove_dir_all(&folder).with_context(|| format!("cannot replace {}", folder.display()))?;
        }
    }
    Ok(())
}
