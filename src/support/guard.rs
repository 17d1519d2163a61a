//! Where outputs may go: run folders take none of other commands, and what cannot be written is refused before the work.

use std::ffi::OsStr;
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{self, Component, Path, PathBuf};

use anyhow::{Context, Result, ensure};

use super::atomic;
use super::run_names::{CHECKPOINTS, CONFIG, LOCK, METRICS, SUMMARY};

/// What a run's folder holds. Two of these make a folder one, whatever else is missing: no run is passed over.
const MARKS: [&str; 5] = [CONFIG, METRICS, SUMMARY, CHECKPOINTS, LOCK];

/// File by which a folder is tried.
const PROBE: &str = "paig";

/// Whether a folder is a run's, finished or not.
pub fn is_run(folder: &Path) -> bool {
    MARKS.iter().filter(|mark| folder.join(mark).exists()).count() >= 2
}

/// # Errors
/// A run's folder; as [`check_folder`].
pub fn ensure_no_run(out: &Path) -> Result<()> {
    ensure!(!is_run(out), "{} is a run folder; choose another folder", out.display());
    check_folder(out)
}

/// Checks that files may be written into a folder, which need not be there yet.
///
/// # Errors
/// A place among the checkpoints of a run; a file, or a link that leads nowhere, in its place or above it; a name that is too long;
/// a folder that cannot be written.
pub fn check_folder(folder: &Path) -> Result<()> {
    ensure_outside_checkpoints(folder)?;
    let named = || format!("cannot write into {}", folder.display());
    let mut missing = Vec::new();
    for place in folder.ancestors() {
        let place = if place.as_os_str().is_empty() { Path::new(".") } else { place };
        match fs::metadata(place) {
            Ok(there) => {
                ensure!(there.is_dir(), "{} is a file; choose another folder", place.display());
                // Names of folders that are to be made may be too long.
                let names = if missing.is_empty() { &[OsStr::new(PROBE)] } else { &missing[..] };
                return names.iter().try_for_each(|name| atomic::try_place(&place.join(name))).with_context(named);
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {
                let link = place.display();
                ensure!(!place.is_symlink(), "{link} is a link that leads nowhere; remove it, or make its folder");
                missing.extend(place.file_name());
            }
            Err(error) => return Err(error).with_context(named),
        }
    }
    Ok(())
}

/// What may lie in the folder of a run may still not lie among its checkpoints.
///
/// # Errors
/// A place among the checkpoints of a run.
pub(crate) fn ensure_outside_checkpoints(out: &Path) -> Result<()> {
    let place = real_place(out).with_context(|| format!("cannot write to {}", out.display()))?;
    let of_run = |folder: &Path| folder.ends_with(CHECKPOINTS) && folder.parent().is_some_and(is_run);
    let among = place.ancestors().any(of_run);
    ensure!(!among, "{} lies among the checkpoints of a run; choose another place", out.display());
    Ok(())
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
    use crate::support::output::FileKind;

    /// By links and ways round, too, for files as for folders.
    #[test]
    fn checkpoints_take_no_output() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let any = FileKind { name: "anything", recognizes: |_| true };
        fs::create_dir_all(at("run/checkpoints/step")).unwrap();
        fs::create_dir(at("checkpoints")).unwrap();
        fs::write(at("run/config.toml"), "").unwrap();
        symlink("run/checkpoints", at("link")).unwrap();
        for among in ["run/checkpoints/new", "run/checkpoints/step/../x", "link", "link/new/x"] {
            assert!(check_folder(&at(among)).is_err() && any.check(&at(among), &[]).is_err(), "{among}");
        }
        for outside in ["run/new", "run/checkpoints/../new", "link/../new", "checkpoints/new"] {
            check_folder(&at(outside)).unwrap();
            any.check(&at(outside), &[]).unwrap();
        }
        check_folder(&at("run")).unwrap();
        assert!(ensure_no_run(&at("run")).unwrap_err().to_string().contains("is a run folder"));
    }

    #[test]
    fn folders_that_cannot_be_written_are_refused_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), "").unwrap();
        symlink("nothing", at("link")).unwrap();
        fs::create_dir(at("there")).unwrap();
        symlink("there", at("way")).unwrap();
        let long = "é".repeat(128);
        let below = format!("new/{long}/x");
        for (name, reason) in [
            ("file", "is a file"),
            ("file/new", "Not a directory"),
            ("link", "is a link that leads nowhere"),
            ("link/new/x", "is a link that leads nowhere"),
            (&long, "name too long"),
            (&below, "name too long"),
        ] {
            let error = format!("{:#}", check_folder(&at(name)).unwrap_err());
            assert!(error.contains(reason), "{name}: {error}");
        }
        for name in ["there", "there/new/x", "way", "way/new", &"x".repeat(255)] {
            check_folder(&at(name)).unwrap();
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count() + fs::read_dir(at("there")).unwrap().count(), 4);
    }
}
