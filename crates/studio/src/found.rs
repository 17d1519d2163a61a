//! Measurements, runs and imports in the projects' folder that were made by the commands, such as those of a sweep.

use std::fs;
use std::path::{Component, Path, PathBuf};

use anyhow::{Result, ensure};
use paig::runs::summary::Summary;
use paig::support::significant::significant;
use paig_video::measure::results::{MEASUREMENT, Measurement, Outcome};
use serde::Serialize;

use crate::cards::{DIGITS, quantity};
use crate::project::Project;

/// Folders within folders that are searched, and most results that are listed.
const DEEPEST: usize = 6;
const MOST: usize = 500;
const TASK: &str = "task.toml";
const PAGE: &str = "measurement.html";
/// Pictures of a measurement, a run and an import, the best one first.
const PICTURES: [&str; 3] = ["overlay.gif", "example0.png", "contact-sheet.png"];

/// A result, for the list of all.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Found {
    /// Its folder within the projects' folder.
    pub place: String,
    /// The equation, or the task of a run.
    pub equation: Option<String>,
    /// The first quantity with its interval.
    pub value: Option<String>,
    pub outcome: Option<Outcome>,
    /// Names of files in the folder.
    pub picture: Option<&'static str>,
    pub page: Option<&'static str>,
}

/// Results in a folder and below by their places, without those of projects. Links are not followed.
pub fn results(root: &Path) -> Vec<Found> {
    let mut found = Vec::new();
    search(root, root, DEEPEST, &mut found);
    found.sort_by(|a, b| a.place.cmp(&b.place));
    found
}

fn search(root: &Path, folder: &Path, deeper: usize, found: &mut Vec<Found>) {
    if found.len() >= MOST || Project::at(folder).is_ok() {
        return;
    }
    found.extend(result(root, folder));
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let folders = entries.filter(|entry| deeper > 0 && entry.file_type().is_ok_and(|kind| kind.is_dir()));
    folders.for_each(|entry| search(root, &entry.path(), deeper - 1, found));
}

/// None of a folder without a readable result.
fn result(root: &Path, folder: &Path) -> Option<Found> {
    let place = folder.strip_prefix(root).ok()?.to_str().filter(|place| !place.is_empty())?;
    let there = |name: &&'static str| folder.join(name).is_file();
    let bare = Found {
        place: place.into(),
        equation: None,
        value: None,
        outcome: None,
        picture: PICTURES.into_iter().find(there),
        page: Some(PAGE).filter(there),
    };
    if there(&MEASUREMENT) {
        let measurement = Measurement::read(folder).ok()?;
        let outcome = measurement.verdict.as_ref().map(|verdict| verdict.outcome);
        return Some(Found {
            equation: Some(measurement.equation.clone()),
            value: quantity(&measurement),
            outcome,
            ..bare
        });
    }
    if let Ok(Some(summary)) = Summary::read(folder) {
        let first = summary.parameters.first_key_value();
        let value = first.map(|(name, it)| format!("{} = {}", name.replace('_', " "), significant(it.learned, DIGITS)));
        let outcome = summary.verdict.map(|verdict| if verdict.found { Outcome::Found } else { Outcome::NotFound });
        return Some(Found { equation: Some(summary.task), value, outcome, ..bare });
    }
    there(&TASK).then_some(bare)
}

/// The page or a picture of a result by its place.
///
/// # Errors
/// Another file, none, or one outside the folder, by its parts or by a link.
pub fn file(root: &Path, place: &str) -> Result<PathBuf> {
    let path = Path::new(place);
    let plain = path.components().all(|part| matches!(part, Component::Normal(_)));
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    ensure!(plain && (name == PAGE || PICTURES.contains(&name)), "{place:?} is no file of a result");
    let root = root.canonicalize()?;
    let full = root.join(path).canonicalize()?;
    ensure!(full == root.join(path), "{place:?} is a link");
    Ok(full)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_files_of_results_are_handed_out() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("runs");
        fs::create_dir_all(root.join("a/b")).unwrap();
        fs::write(root.join("a/b").join(PAGE), "page").unwrap();
        fs::write(root.join("a/b/secret.txt"), "s").unwrap();
        fs::write(folder.path().join(PAGE), "outside").unwrap();
        std::os::unix::fs::symlink(folder.path().join(PAGE), root.join("a").join(PAGE)).unwrap();
        assert!(file(&root, "a/b/measurement.html").is_ok());
        for other in ["a/b/secret.txt", "a/measurement.html", "../measurement.html", "/etc/passwd", "", "a/b"] {
            assert!(file(&root, other).is_err(), "{other}");
        }
    }

    #[test]
    fn imports_are_listed_and_what_is_damaged_is_left_out() {
        let root = tempfile::tempdir().unwrap();
        for place in ["scenes/throw", "damaged"] {
            fs::create_dir_all(root.path().join(place)).unwrap();
        }
        fs::write(root.path().join("scenes/throw").join(TASK), "").unwrap();
        fs::write(root.path().join("damaged").join(MEASUREMENT), "{}").unwrap();
        Project::create(root.path(), "own.mp4", None).unwrap();
        fs::write(root.path().join("own").join(TASK), "").unwrap();
        let places: Vec<_> = results(root.path()).into_iter().map(|it| it.place).collect();
        assert_eq!(places, ["scenes/throw"]);
    }
}
