//! Which folders are of runs: they take no output of other commands.

use std::path::{self, Path};

use anyhow::{Context, Result, ensure};

use super::names::{CHECKPOINTS, CONFIG, LOCK, METRICS, SUMMARY};

/// What a run's folder holds. Two of these make a folder one, whatever else is missing: no run is passed over.
const MARKS: [&str; 5] = [CONFIG, METRICS, SUMMARY, CHECKPOINTS, LOCK];

/// Whether a folder is a run's, finished or not.
pub fn is_run(folder: &Path) -> bool {
    MARKS.iter().filter(|mark| folder.join(mark).exists()).count() >= 2
}

/// # Errors
/// A run's folder or a place among its checkpoints.
pub fn ensure_no_run(out: &Path) -> Result<()> {
    ensure!(!is_run(out), "{} is a run folder; choose another folder with --out", out.display());
    ensure_outside_checkpoints(out)
}

/// The same for what may lie in the folder of a run, but not among its checkpoints.
///
/// # Errors
/// A place among the checkpoints of a run.
pub fn ensure_outside_checkpoints(out: &Path) -> Result<()> {
    let place = path::absolute(out).with_context(|| format!("cannot write into {}", out.display()))?;
    let of_run = |folder: &Path| folder.ends_with(CHECKPOINTS) && folder.parent().is_some_and(is_run);
    let among = place.ancestors().any(of_run);
    ensure!(!among, "{} lies among the checkpoints of a run; choose another folder with --out", out.display());
    Ok(())
}
