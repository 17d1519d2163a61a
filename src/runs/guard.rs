//! Which folders are of runs: they take no output of other commands.

use std::fs;
use std::io;
use std::path::{self, Component, Path, PathBuf};

use anyhow::{Context, Result, ensure};

use super::names::{CHECKPOINTS, CONFIG, LOCK, METRICS, SUMMARY};
use crate::support::output::FileKind;

/// What a run's folder holds. Two of these make a folder one, whatever else is missing: no run is passed over.
const MARKS: [&str; 5] = [CONFIG, METRICS, SUMMARY, CHECKPOINTS, LOCK];

/// Whether a folder is a run's, finished or not.
pub fn is_run(folder: &Path) -> bool {
    MARKS.iter().filter(|mark| folder.join(mark).exists()).count() >= 2
}

/// # Errors
/// A run's folder or a place among its checkpoints.
pub fn ensure_no_run(out: &Path) -> Result<()> {
    ensure!(!is_run(out), "{} is a run folder; choose another folder", out.display());
    ensure_outside_checkpoints(out)
}

/// The same for what may lie in the folder of a run, but not among its checkpoints.
///
/// # Errors
/// A place among the checkpoints of a run.
pub fn ensure_outside_checkpoints(out: &Path) -> Result<()> {
    let place = real_place(out).with_context(|| format!("cannot write to {}", out.display()))?;
    let of_run = |folder: &Path| folder.ends_with(CHECKPOINTS) && folder.parent().is_some_and(is_run);
    let among = place.ancestors().any(of_run);
    ensure!(!among, "{} lies among the checkpoints of a run; choose another place", out.display());
    Ok(())
}

/// Checks a file to write as [`FileKind::check`] and [`ensure_outside_checkpoints`].
///
/// # Errors
/// As both.
pub fn check_file(kind: &FileKind, file: &Path, inputs: &[&Path]) -> Result<PathBuf> {
    ensure_outside_checkpoints(file)?;
    kind.check(file, inputs)
}

/// Where a path leads: links are followed as far as there is something.
fn real_place(path: &Path) -> io::Result<PathBuf> {
    let path = path::absolute(path)?;
    for there in path.ancestors() {
        let Ok(mut place) = fs::canonicalize(there) else { continue };
        for part in path.strip_prefix(there).unwrap_or(Path::new("")).components() {
            match part {
                Component::ParentDir => _ = place.pop(),
                part => place.push(part),
            }
        }
        return Ok(place);
    }
    Ok(path)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn checkpoints_are_known_by_links_and_ways_round() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("run/checkpoints/step")).unwrap();
        fs::write(at("run/config.toml"), "").unwrap();
        symlink("run/checkpoints", at("link")).unwrap();
        for among in ["run/checkpoints", "run/checkpoints/new", "run/checkpoints/step/../x", "link", "link/new/x"] {
            assert!(ensure_outside_checkpoints(&at(among)).is_err(), "{among}");
        }
        for outside in ["run", "run/new", "run/checkpoints/../new", "link/../new", "checkpoints/new"] {
            ensure_outside_checkpoints(&at(outside)).unwrap();
        }
    }
}
