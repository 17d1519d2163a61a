//! Finding runs, each once.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::run::StoredRun;
use crate::support::guard::is_run;

/// All run folders that were found.
#[derive(Debug, Default)]
pub struct FoundRuns {
    pub runs: Vec<StoredRun>,
    /// Folders that cannot be listed, or whose config or summary is missing or damaged, and how.
    pub unreadable: Vec<(PathBuf, anyhow::Error)>,
}

/// The runs in and under some folders, in the order of their names. What `skip` names is not entered.
///
/// # Errors
/// One of the folders themselves cannot be listed.
pub fn find_runs(folders: &[PathBuf], skip: &dyn Fn(&Path) -> bool) -> Result<FoundRuns> {
    let mut places = Vec::new();
    let mut found = FoundRuns::default();
    for folder in folders {
        search(folder, skip, &mut places, &mut found.unreadable)?;
    }
    for (folder, _) in places {
        match StoredRun::read(&folder) {
            Ok(run) => found.runs.push(run),
            Err(error) => found.unreadable.push((folder, error)),
        }
    }
    found.runs = without_copies(found.runs);
    share_data(&mut found.runs);
    Ok(found)
}

/// `places`: run folders as they were reached, and their true paths; `unreadable`: those below that cannot be listed.
fn search(
    folder: &Path,
    skip: &dyn Fn(&Path) -> bool,
    places: &mut Vec<(PathBuf, PathBuf)>,
    unreadable: &mut Vec<(PathBuf, anyhow::Error)>,
) -> Result<()> {
    let context = || format!("cannot list {}", folder.display());
    if is_run(folder) {
        let canonical = fs::canonicalize(folder).with_context(context)?;
        if places.iter().all(|(_, known)| *known != canonical) {
            places.push((folder.into(), canonical));
        }
        return Ok(());
    }
    let mut below = Vec::new();
    for entry in fs::read_dir(folder).with_context(context)? {
        let entry = entry.with_context(context)?;
        // Not through links: they can lead in a circle.
        if entry.file_type().with_context(context)?.is_dir() && !skip(&entry.path()) {
            below.push(entry.path());
        }
    }
    below.sort();
    for folder in below {
        if let Err(error) = search(&folder, skip, places, unreadable) {
            unreadable.push((folder, error));
        }
    }
    Ok(())
}

/// Of runs that are one and the same the one that went furthest: a run and its record in an earlier report, which may
/// have been made before the run went on. Their configs are equal, and the course of one begins with that of the other.
fn without_copies(runs: Vec<StoredRun>) -> Vec<StoredRun> {
    let mut kept: Vec<(StoredRun, [Vec<u8>; 2])> = Vec::new();
    let further = |run: &StoredRun, course: &[u8]| (course.len(), run.summary.is_some());
    for run in runs {
        let files = run.config_and_course();
        let [config, course] = &files;
        let same = kept.iter_mut().find(|(_, [other_config, other])| {
            // Of runs without a course nothing says that they are one.
            let begun = !course.is_empty() && !other.is_empty();
            other_config == config && begun && (other.starts_with(course) || course.starts_with(other))
        });
        match same {
            Some(other) if further(&run, course) > further(&other.0, &other.1[1]) => *other = (run, files),
            Some(_) => {}
            None => kept.push((run, files)),
        }
    }
    kept.into_iter().map(|(run, _)| run).collect()
}

/// A run that has not finished learned from what other runs on the same files say.
fn share_data(runs: &mut [StoredRun]) {
    for place in 0..runs.len() {
        let files =
            |run: &StoredRun| (run.config.task.name.clone(), run.config.data_files().map(Option::<&String>::cloned));
        let here = files(&runs[place]);
        let known = runs.iter().filter(|run| files(run) == here).find_map(|run| run.data.clone());
        runs[place].data = runs[place].data.take().or(known);
    }
}
