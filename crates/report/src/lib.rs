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

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use self::groups::Group;
use self::results::Results;
use paig::Error;
use paig::support::storage::{self, storage};
use paig::support::{atomic, json_lines};

pub use self::pictures::Pictures;
pub use self::template::{cell, code};

/// How many runs were found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunCounts {
    pub finished: usize,
    pub unfinished: usize,
    /// Folders with a config or a summary that cannot be read.
    pub unreadable: usize,
}

/// Reads all run folders in and under `folders` and writes the report of them into `out`, with or without pictures.
///
/// # Errors
/// A folder that cannot be listed or that the report would replace, no run at all, an output folder that cannot be
/// written. A run that is damaged is no error: the report says so.
pub fn write(folders: &[PathBuf], out: &Path, shown: Pictures) -> Result<RunCounts, Error> {
    Ok(written(folders, out, shown)?)
}

fn written(folders: &[PathBuf], out: &Path, shown: Pictures) -> Result<RunCounts> {
    put_in_place(out)?;
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
    storage().create_folder(out).with_context(|| format!("cannot create {}", out.display()))?;
    // Made aside, whole or not at all: whatever goes wrong, the earlier report and its records stay as they are.
    let new = out.join(NEW);
    atomic::write_folder(&new, |new| fill(new, out, &groups, &found.unreadable, &places, shown))?;
    put_in_place(out)?;
    Ok(RunCounts { finished, unfinished, unreadable: found.unreadable.len() })
}

/// A whole report that is not in its place yet.
const NEW: &str = ".new";
const PAGE: &str = "report.md";
const HTML: &str = "report.html";

/// Puts a new report in the place of the earlier one; also one that was cut off here. What an earlier report left in its
/// folders goes; folders of these names beside which no report lies stay, and the new files go among theirs. The page comes
/// last: it says whose the folders are.
fn put_in_place(out: &Path) -> Result<()> {
    let new = out.join(NEW);
    if !new.exists() {
        return Ok(());
    }
    let before = match storage::read_to_string(&out.join(PAGE)) {
        Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
        read => read.with_context(|| format!("cannot read {}", out.join(PAGE).display()))?,
    };
    let ours = before.starts_with(&format!("# {}", template::TITLE));
    for folder in [records::FOLDER, pictures::FOLDER].iter().filter(|folder| new.join(folder).exists()) {
        let (from, to) = (new.join(folder), out.join(folder));
        if ours && to.exists() {
            storage().remove_folder(&to).with_context(|| format!("cannot replace {}", to.display()))?;
        }
        move_to(&from, &to)?;
    }
    for name in [records::RESULTS, HTML, PAGE].iter().filter(|name| new.join(name).exists()) {
        move_to(&new.join(name), &out.join(name))?;
    }
    storage().sync(out).with_context(|| format!("cannot write into {}", out.display()))?;
    storage().remove_folder(&new).with_context(|| format!("cannot remove {}", new.display()))
}

/// Writes all of a report into an empty folder, from where it moves to `place`.
fn fill(
    out: &Path,
    place: &Path,
    groups: &[Group],
    unreadable: &[(PathBuf, anyhow::Error)],
    searched: &[String],
    shown: Pictures,
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

/// Moves a file or a folder to its place on the same file system; what is in a folder goes among what is there.
fn move_to(from: &Path, to: &Path) -> Result<()> {
    if !(from.is_dir() && to.is_dir()) {
        return storage().rename(from, to).with_context(|| format!("cannot write {}", to.display()));
    }
    for entry in fs::read_dir(from).with_context(|| format!("cannot list {}", from.display()))? {
        let entry = entry?;
        move_to(&entry.path(), &to.join(entry.file_name()))?;
    }
    Ok(())
}
