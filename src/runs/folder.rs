//! A run's folder: its lock, its config, its logs.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use super::names::{CHECKPOINTS, CONFIG, LOG, METRICS};
use crate::support::atomic;

const LOCK: &str = ".lock";

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
    /// A folder that holds a run already, or that another process runs in.
    pub fn create(path: &Path, config: &str) -> Result<Self> {
        Self::ensure_free(path)?;
        fs::create_dir_all(path).with_context(|| format!("cannot create the run folder {}", path.display()))?;
        let folder = Self::open(path)?;
        atomic::write_file(&path.join(CONFIG), |file| Ok(file.write_all(config.as_bytes())?))?;
        Ok(folder)
    }

    /// # Errors
    /// A folder that holds a run already.
    pub fn ensure_free(path: &Path) -> Result<()> {
        // Checkpoints alone are of a run whose config was deleted: a new run must not go on from them.
        ensure!(
            !path.join(CONFIG).exists() && !path.join(CHECKPOINTS).exists(),
            "{} holds a run already; continue it with --resume, or choose another folder with --out",
            path.display()
        );
        Ok(())
    }

    /// Opens the folder of an earlier run.
    ///
    /// # Errors
    /// A folder without a run, or one that another process runs in.
    pub fn reopen(path: &Path) -> Result<Self> {
        ensure!(path.join(CONFIG).exists(), "nothing to resume: {} holds no run", path.display());
        Self::open(path)
    }

    fn open(path: &Path) -> Result<Self> {
        let lock = append(path, LOCK)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => bail!("another run is using {}", path.display()),
            Err(TryLockError::Error(error)) => {
                return Err(error).with_context(|| format!("cannot lock {}", path.display()));
            }
        }
        Ok(RunFolder { path: path.to_path_buf(), _lock: lock })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// log.txt, to be appended to.
    ///
    /// # Errors
    /// A file that cannot be opened.
    pub fn log(&self) -> Result<File> {
        append(&self.path, LOG)
    }

    /// metrics.jsonl, to be appended to.
    ///
    /// # Errors
    /// A file that cannot be opened.
    pub fn metrics(&self) -> Result<File> {
        append(&self.path, METRICS)
    }
}

/// A file of the folder, made if it is not there, to be appended to.
fn append(folder: &Path, name: &str) -> Result<File> {
    let path = folder.join(name);
    let file = OpenOptions::new().create(true).read(true).append(true).open(&path);
    file.with_context(|| format!("cannot open {}", path.display()))
}
