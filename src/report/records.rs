//! What the report was made of, kept beside it: config, course and summary of every run, so that a reader can check it
//! and a later report can count these runs too, when checkpoints and arrays are long gone.

use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use super::groups::Group;
use crate::runs::folder::RECORDS;
use crate::support::atomic;

/// The folder of all records, in that of the report.
pub(super) const FOLDER: &str = "records";

/// Characters of a changed recipe's name that its folder bears: file systems allow 255 in all.
const LONGEST_NAME: usize = 100;

/// The results in the folder of the report, by which it is known.
pub(super) const RESULTS: &str = "results.json";

/// The records in the folder of an earlier report; none in any other folder.
pub(super) fn of_report(folder: &Path) -> Option<PathBuf> {
    let records = folder.join(FOLDER);
    (folder.join(RESULTS).exists() && records.exists()).then_some(records)
}

/// Where the runs of a given folder are searched: of an earlier report in its records.
pub(super) fn searched(folder: &Path) -> PathBuf {
    of_report(folder).unwrap_or_else(|| folder.into())
}

/// Refuses to replace records that are themselves among the runs.
///
/// # Errors
/// A folder of runs in that of the records.
pub(super) fn check(out: &Path, folders: &[PathBuf]) -> Result<()> {
    let Ok(records) = fs::canonicalize(out.join(FOLDER)) else { return Ok(()) };
    for folder in folders {
        let inside = fs::canonicalize(searched(folder)).is_ok_and(|searched| searched.starts_with(&records));
        ensure!(!inside, "{} would be replaced by the new report; choose another folder with --out", folder.display());
    }
    Ok(())
}

/// Copies the records of all runs into `out/records`, in the folders that `sweep` would give them: one for each run, in
/// the order of the groups and of their runs.
pub(super) fn write(out: &Path, groups: &[Group]) -> Result<Vec<Vec<PathBuf>>> {
    let mut taken = BTreeSet::new();
    let places = groups.iter().map(|group| {
        let group_folder = unused(&mut taken, Path::new(FOLDER).join(group.task.key).join(group_name(group)));
        group
            .runs
            .iter()
            .map(|run| unused(&mut taken, group_folder.join(format!("seed={}", run.config.seed))))
            .collect()
    });
    let places: Vec<Vec<PathBuf>> = places.collect();
    for (run, place) in groups.iter().flat_map(|group| &group.runs).zip(places.iter().flatten()) {
        let folder = out.join(place);
        fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
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
    let bytes = fs::read(from).with_context(|| format!("cannot read {}", from.display()))?;
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

/// The path, or its first numbered version that is still free.
fn unused(taken: &mut BTreeSet<PathBuf>, path: PathBuf) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let numbered = (2..).map(|number| path.with_file_name(format!("{name}-{number}")));
    let free = std::iter::once(path.clone()).chain(numbered).find(|path| !taken.contains(path));
    let free = free.expect("there is always one more");
    taken.insert(free.clone());
    free
}
