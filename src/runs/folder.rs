//! A run's folder: its lock, its config, its logs, its summary.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::Serialize;

use super::summary::SUMMARY;
use crate::support::atomic;
use crate::training::config::Config;

const LOCK: &str = ".lock";
/// What was asked for, the course of the training, what came out.
pub const CONFIG: &str = "config.toml";
pub const METRICS: &str = "metrics.jsonl";
const LOG: &str = "log.txt";
const CHECKPOINTS: &str = "checkpoints";
/// What says all of a run in few bytes: what was asked for, how it went, what came out.
pub const RECORDS: [&str; 3] = [CONFIG, METRICS, SUMMARY];

/// An opened and locked run folder.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    log: File,
    metrics: File,
    /// Held, not read: the lock goes with it.
    _lock: File,
}

impl RunFolder {
    /// Opens a folder for a new run.
    ///
    /// # Errors
    /// A folder that holds a run already, or that another process runs in.
    pub fn create(path: &Path, config: &Config) -> Result<Self> {
        Self::ensure_free(path)?;
        fs::create_dir_all(path).with_context(|| format!("cannot create the run folder {}", path.display()))?;
        let folder = Self::open(path)?;
        atomic::write_file(&path.join(CONFIG), |file| Ok(file.write_all(config.to_toml().as_bytes())?))?;
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

    /// Opens the folder of an earlier run and returns its config.
    ///
    /// # Errors
    /// A folder without a run, or one that another process runs in.
    pub fn reopen(path: &Path) -> Result<(Self, Config)> {
        if !path.join(CONFIG).exists() {
            bail!("nothing to resume: {} holds no run", path.display());
        }
        Ok((Self::open(path)?, Config::read(&path.join(CONFIG))?))
    }

    fn open(path: &Path) -> Result<Self> {
        let open = |name: &str| {
            let path = path.join(name);
            let file = OpenOptions::new().create(true).read(true).append(true).open(&path);
            file.with_context(|| format!("cannot open {}", path.display()))
        };
        let lock = open(LOCK)?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => bail!("another run is using {}", path.display()),
            Err(TryLockError::Error(error)) => {
                return Err(error).with_context(|| format!("cannot lock {}", path.display()));
            }
        }
        Ok(RunFolder { path: path.to_path_buf(), log: open(LOG)?, metrics: open(METRICS)?, _lock: lock })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn checkpoints(&self) -> PathBuf {
        self.path.join(CHECKPOINTS)
    }

    /// Appends a line to log.txt.
    ///
    /// # Errors
    /// A full disk.
    pub fn log(&mut self, line: &str) -> Result<()> {
        writeln!(self.log, "{line}").with_context(|| format!("cannot write {LOG} in {}", self.path.display()))
    }

    /// Appends a record to metrics.jsonl.
    ///
    /// # Errors
    /// A full disk.
    pub fn record(&mut self, record: &impl Serialize) -> Result<()> {
        let line = serde_json::to_string(record)?;
        writeln!(self.metrics, "{line}").with_context(|| format!("cannot write {METRICS} in {}", self.path.display()))
    }

    /// Lengths of log and metrics in bytes, once on the disk.
    ///
    /// # Errors
    /// A full disk.
    pub fn lengths(&mut self) -> Result<(u64, u64)> {
        let context = || format!("cannot write the logs in {}", self.path.display());
        self.log.sync_data().with_context(context)?;
        self.metrics.sync_data().with_context(context)?;
        Ok((self.log.metadata()?.len(), self.metrics.metadata()?.len()))
    }

    /// Cuts off what was logged after a checkpoint.
    ///
    /// # Errors
    /// Files that cannot be changed.
    pub fn truncate(&mut self, log_bytes: u64, metrics_bytes: u64) -> Result<()> {
        for (file, length) in [(&mut self.log, log_bytes), (&mut self.metrics, metrics_bytes)] {
            let context = || format!("cannot shorten the logs in {}", self.path.display());
            // A log that was deleted stays short: what it held is lost, the run is not.
            let present = file.metadata().with_context(context)?.len();
            file.set_len(length.min(present)).with_context(context)?;
            file.seek(SeekFrom::End(0)).with_context(context)?;
        }
        Ok(())
    }
}
