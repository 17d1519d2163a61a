//! A run's folder: its lock, its config, its logs.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, anyhow, bail, ensure};

use crate::support::error::{self, Error};
use crate::support::run_names::{CHECKPOINTS, CONFIG, DONE, LOCK, LOG, METRICS, OUTPUT, TENSORBOARD};
use crate::support::storage::{StorageOutput, storage};
use crate::support::{atomic, guard};

/// What a folder may hold before a run begins in it: what `sweep` writes, and what a run that was killed at its start left.
const BEFORE: [&str; 3] = [LOCK, OUTPUT, DONE];

/// An opened and locked run folder.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    /// Held, not read: the lock goes with it.
    _lock: File,
}

impl RunFolder {
    /// Opens a folder for a new run with this config.
    ///
    /// # Errors
    /// A folder that holds a run or anything else already, or that another process runs in.
    pub fn create(path: &Path, config: &str) -> Result<Self> {
        Self::ensure_free(path)?;
        storage().create_folder(path).with_context(|| format!("cannot create the run folder {}", path.display()))?;
        let folder = Self::open(path)?;
        // Of a run that was deleted: this one is not finished.
        storage()
            .remove_if_there(&path.join(DONE))
            .with_context(|| format!("cannot begin a run in {}", path.display()))?;
        atomic::write_file(&path.join(CONFIG), |file| Ok(file.write_all(config.as_bytes())?))?;
        Ok(folder)
    }

    /// # Errors
    /// A folder that holds a run or files of someone else already, or that cannot be written.
    pub(crate) fn ensure_free(path: &Path) -> Result<()> {
        guard::check_folder(path)?;
        // Checkpoints alone are of a run whose config was deleted: a new run must not go on from them.
        ensure!(
            !path.join(CONFIG).exists() && !path.join(CHECKPOINTS).exists(),
            "{} holds a run already; continue it with --resume, or choose another folder with --out (also for other clips)",
            path.display()
        );
        let entries = match fs::read_dir(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            entries => entries.with_context(|| format!("cannot begin a run in {}", path.display()))?,
        };
        for entry in entries {
            let entry = entry.with_context(|| format!("cannot list {}", path.display()))?;
            let name = entry.file_name();
            // The mark of a finished run is empty.
            let marks = name != DONE || entry.metadata().is_ok_and(|described| described.len() == 0);
            let ours = BEFORE.iter().any(|known| name == *known) && marks || atomic::is_partial(&name);
            ensure!(
                ours,
                "{} holds {name:?}, which is of no run, and a run would write among it; choose a new folder with --out",
                path.display()
            );
        }
        Ok(())
    }

    /// Whether a program runs in a folder now.
    pub fn is_in_use(path: &Path) -> bool {
        let lock = path.join(LOCK);
        lock.is_file()
            && File::open(lock).is_ok_and(|lock| matches!(lock.try_lock_shared(), Err(TryLockError::WouldBlock)))
    }

    /// Opens the folder of an earlier run.
    ///
    /// # Errors
    /// A folder without a run, or one that another process runs in.
    pub fn reopen(path: &Path) -> Result<Self> {
        if !path.join(CONFIG).exists() {
            let missing = anyhow!("nothing to resume: {} holds no run", path.display());
            return Err(Error::new(error::ErrorKind::Missing, missing).into());
        }
        Self::open(path)
    }

    /// Opens a folder for a training that keeps its config there itself in a file of this name, or goes on in it.
    ///
    /// # Errors
    /// A folder without that file that holds another run or files of someone else, one that cannot be made, or that another
    /// process runs in.
    pub fn enter(path: &Path, config: &str) -> Result<Self> {
        if !path.join(config).exists() {
            Self::ensure_free(path)?;
        }
        storage().create_folder(path).with_context(|| format!("cannot create the run folder {}", path.display()))?;
        Self::open(path)
    }

    fn open(path: &Path) -> Result<Self> {
        let lock = lock(path)?;
        // Nobody else writes here now.
        [path.to_path_buf(), path.join(CHECKPOINTS)].iter().for_each(|folder| atomic::remove_partials(folder));
        Ok(RunFolder { path: path.to_path_buf(), _lock: lock })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// log.txt, to be appended to.
    ///
    /// # Errors
    /// A file that cannot be opened.
    pub fn log(&self) -> Result<Box<dyn StorageOutput>> {
        append(&self.path, LOG)
    }

    /// metrics.jsonl, to be appended to.
    ///
    /// # Errors
    /// A file that cannot be opened.
    pub fn metrics(&self) -> Result<Box<dyn StorageOutput>> {
        append(&self.path, METRICS)
    }

    /// TensorBoard's file, begun anew.
    ///
    /// # Errors
    /// A file that cannot be made.
    pub fn tensorboard(&self) -> Result<Box<dyn StorageOutput>> {
        let path = self.path.join(TENSORBOARD);
        storage().create(&path).with_context(|| format!("cannot make {}", path.display()))
    }
}

/// How often a folder's lock is asked for, and how long apart: whoever looks whether it is in use holds it for a moment.
const ATTEMPTS: usize = 5;
const BETWEEN: Duration = Duration::from_millis(20);

/// Takes a folder for this program alone, as long as the file is open.
///
/// # Errors
/// A folder that another program uses, or that cannot be written.
pub fn lock(path: &Path) -> Result<File> {
    let place = path.join(LOCK);
    ensure_own_file(&place)?;
    let lock = OpenOptions::new().create(true).append(true).open(&place);
    let lock = lock.with_context(|| format!("cannot open {}", place.display()))?;
    for _ in 0..ATTEMPTS {
        match lock.try_lock() {
            Ok(()) => return Ok(lock),
            Err(TryLockError::WouldBlock) => thread::sleep(BETWEEN),
            Err(TryLockError::Error(error)) => {
                return Err(error).with_context(|| format!("cannot lock {}", path.display()));
            }
        }
    }
    bail!("another run is using {}", path.display())
}

/// A file of the folder, made if it is not there, to be appended to.
fn append(folder: &Path, name: &str) -> Result<Box<dyn StorageOutput>> {
    let path = folder.join(name);
    ensure_own_file(&path)?;
    storage().append(&path).with_context(|| format!("cannot open {}", path.display()))
}

/// Refuses what is no file: a pipe would block, and what a link leads to may be no file of the run.
fn ensure_own_file(path: &Path) -> Result<()> {
    let strange = fs::symlink_metadata(path).is_ok_and(|described| !described.is_file());
    ensure!(!strange, "{} is not a file but a link, a folder, a pipe or a device; remove it", path.display());
    Ok(())
}
