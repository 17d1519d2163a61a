//! Files and folders that appear whole or not at all: written beside their place, synced, then renamed.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

/// Writes a file in one step; what stood there before stays until the new one is complete.
///
/// # Errors
/// A full disk or a missing folder; nothing is left behind then.
pub fn write_file(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> Result<()>) -> Result<()> {
    write_path(path, |partial| {
        let mut file = BufWriter::new(File::create(partial)?);
        write(&mut file)?;
        Ok(file.flush()?)
    })
}

/// Writes a file in one step by something that takes a path.
///
/// # Errors
/// As for [`write_file`].
pub fn write_path(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let partial = partial_name(path);
    let attempt = || -> Result<()> {
        write(&partial)?;
        File::open(&partial)?.sync_all()?;
        fs::rename(&partial, path)?;
        sync_folder(path)
    };
    attempt()
        .inspect_err(|_| drop(fs::remove_file(&partial)))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Fills a new folder in one step. A folder of that name must not exist yet.
///
/// # Errors
/// As for [`write_file`].
pub fn write_folder(path: &Path, fill: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let partial = partial_name(path);
    let attempt = || -> Result<()> {
        if partial.exists() {
            fs::remove_dir_all(&partial)?;
        }
        fs::create_dir_all(&partial)?;
        fill(&partial)?;
        for entry in fs::read_dir(&partial)? {
            File::open(entry?.path())?.sync_all()?;
        }
        File::open(&partial)?.sync_all()?;
        fs::rename(&partial, path)?;
        sync_folder(path)
    };
    attempt()
        .inspect_err(|_| drop(fs::remove_dir_all(&partial)))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Tries whether a file could be written: what takes long should not fail at its end.
///
/// # Errors
/// A missing folder or one that cannot be written, a folder in the file's place.
pub fn check_place(path: &Path) -> Result<()> {
    let attempt = || -> Result<()> {
        ensure!(!path.is_dir(), "a folder is there");
        let partial = partial_name(path);
        File::create(&partial)?;
        Ok(fs::remove_file(&partial)?)
    };
    attempt().with_context(|| format!("cannot write {}", path.display()))
}

fn partial_name(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}.partial", std::process::id()));
    path.with_file_name(name)
}

/// Makes a rename last through a power cut.
fn sync_folder(path: &Path) -> Result<()> {
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        File::open(folder)?.sync_all()?;
    }
    Ok(())
}
