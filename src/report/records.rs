//! What the report was made of, kept beside it: config, course and summary of every run, so that a reader can check it
//! and a later report can count these runs too, when checkpoints and arrays are long gone.

use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use super::groups::{Group, numbered};
use crate::runs::find::{FoundRuns, find_runs};
use crate::runs::names::RECORDS;
use crate::support::atomic;
use crate::support::storage::{self, storage};

/// The folder of all records, in that of a report.
pub(super) const FOLDER: &str = "records";
/// The results in the folder of a report, by which it is known.
pub(super) const RESULTS: &str = "results.json";
/// Characters of a changed recipe's name that its folder bears: file systems allow 255 in all.
const LONGEST_NAME: usize = 100;

/// The runs in and under some folders. Of a report's folder its records count; those of a report met on the way do not, the
/// runs being somewhere else.
pub(super) fn find(folders: &[PathBuf], out: &Path) -> Result<FoundRuns> {
    let of_report = |folder: &Path| folder.join(RESULTS).exists() && folder.join(FOLDER).exists();
    let searched = |folder: &PathBuf| if of_report(folder) { folder.join(FOLDER) } else { folder.clone() };
    let searched: Vec<_> = folders.iter().map(searched).collect();
    for (folder, searched) in folders.iter().zip(&searched) {
        let replaced = fs::canonicalize(out.join(FOLDER)).ok().zip(fs::canonicalize(searched).ok());
        let inside = replaced.is_some_and(|(records, searched)| searched.starts_with(records));
        ensure!(!inside, "{} would be replaced by the new report; choose another folder with --out", folder.display());
    }
    let half_written = |folder: &Path| folder.file_name().is_some_and(atomic::is_partial);
    find_runs(&searched, &|folder| {
        half_written(folder) || folder.ends_with(FOLDER) && folder.with_file_name(RESULTS).exists()
    })
}

/// Copies the records of all runs into `out/records`, in the folders that `sweep` would give them: one for each run, in
/// the order of the groups and of their runs.
pub(super) fn write(out: &Path, groups: &[Group]) -> Result<Vec<Vec<PathBuf>>> {
    let mut taken = BTreeSet::new();
    let mut unused =
        |place: String| numbered(place, |number| format!("-{number}"), |place| taken.insert(place.to_string()));
    let mut places: Vec<Vec<PathBuf>> = Vec::new();
    for group in groups {
        let folder = unused(format!("{FOLDER}/{}/{}", group.task.name, group_name(group)));
        let seeds = group.runs.iter().map(|run| unused(format!("{folder}/seed={}", run.config.seed)).into());
        places.push(seeds.collect());
    }
    for (run, place) in groups.iter().flat_map(|group| &group.runs).zip(places.iter().flatten()) {
        let folder = out.join(place);
        storage().create_folder(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        for name in RECORDS {
            copy(&run.folder.join(name), &folder.join(name))?;
        }
    }
    Ok(places)
}

/// Copies a file of a run, if it has it; whether it did.
pub(super) fn copy(from: &Path, to: &Path) -> Result<bool> {
    if !from.exists() {
        return Ok(false);
    }
    let bytes = storage::read(from).with_context(|| format!("cannot read {}", from.display()))?;
    atomic::write_file(to, |file| Ok(file.write_all(&bytes)?))?;
    Ok(true)
}

/// `RECIPE`, or `RECIPE-NAME` of a changed one: the name it was given, else what was changed.
fn group_name(group: &Group) -> String {
    let changes = || (!group.changes.is_empty()).then(|| group.changes.join("-"));
    let Some(name) = group.folder_name().or_else(changes) else { return group.recipe.clone() };
    let plain = |c: char| if c.is_ascii_alphanumeric() || "=._-".contains(c) { c } else { '-' };
    format!("{}-{}", group.recipe, name.chars().map(plain).take(LONGEST_NAME).collect::<String>())
}
