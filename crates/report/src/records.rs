//! What the report was made of, kept beside it: config, course and summary of every run, so that a reader can check it
//! and a later report can count these runs too, when checkpoints and arrays are long gone.

use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use super::groups::{RunGroup, numbered};
use paig::runs::find::{FoundRuns, find_runs};
use paig::support::atomic;
use paig::support::run_names::{CONFIG, RECORDS, SUMMARY};
use paig::support::storage::{self, storage};

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
pub(super) fn write(out: &Path, groups: &[RunGroup]) -> Result<Vec<Vec<PathBuf>>> {
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
        // What the report was made of may not be missing from its records.
        let was_read = |name: &str| match name {
            CONFIG => true,
            SUMMARY => run.summary.is_some(),
            _ => run.course.is_ok(),
        };
        for name in RECORDS {
            let from = run.folder.join(name);
            let copied = copy(&from, &folder.join(name))?;
            ensure!(
                copied || !was_read(name),
                "{} could be read before and cannot be now; make the report again",
                from.display()
            );
        }
    }
    Ok(places)
}

/// Copies a file of a run, if it has it and it can be read: one run that is damaged costs the others no report. Whether it
/// did.
pub(super) fn copy(from: &Path, to: &Path) -> Result<bool> {
    let Ok(bytes) = storage::read(from) else { return Ok(false) };
    atomic::write_file(to, |file| Ok(file.write_all(&bytes)?))?;
    Ok(true)
}

/// `RECIPE`, or `RECIPE-NAME` of a changed one: the name it was given, else what was changed.
fn group_name(group: &RunGroup) -> String {
    let changes = || (!group.changes.is_empty()).then(|| group.changes.join("-"));
    let Some(name) = group.folder_name().or_else(changes) else { return group.recipe.clone() };
    let plain = |c: char| if c.is_ascii_alphanumeric() || "=._-".contains(c) { c } else { '-' };
    format!("{}-{}", group.recipe, name.chars().map(plain).take(LONGEST_NAME).collect::<String>())
}
