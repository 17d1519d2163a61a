//! Writes the course of a training for TensorBoard while it runs.

use std::path::PathBuf;
use std::time::SystemTime;

use anyhow::{Context, Result};

use super::observer::{TrainingEvent, TrainingObserver};
use crate::runs::folder::RunFolder;
use crate::runs::metrics::{self, Record};
use crate::runs::tensorboard::{beginning, scalars};
use crate::support::run_names::{METRICS, TENSORBOARD};
use crate::support::storage::StorageOutput;

/// The run folder's file for TensorBoard.
#[derive(Debug)]
pub struct EventFile {
    file: Box<dyn StorageOutput>,
    metrics: PathBuf,
}

impl EventFile {
    /// Begins the file anew. What a run that goes on has done so far is written again from metrics.jsonl.
    ///
    /// # Errors
    /// A file that cannot be made.
    pub fn new(folder: &RunFolder) -> Result<Self> {
        let mut events = EventFile { file: folder.tensorboard()?, metrics: folder.path().join(METRICS) };
        events.write(&beginning(now()))?;
        Ok(events)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).with_context(|| format!("cannot write {TENSORBOARD}"))
    }
}

impl TrainingObserver for EventFile {
    fn observe(&mut self, event: &TrainingEvent) -> Result<()> {
        match event {
            TrainingEvent::Resumed { .. } => {
                let records = metrics::read(&self.metrics)?;
                // As if the run had never paused.
                let seconds = |record: &Record| record.seconds.unwrap_or_default();
                let begun = now() - records.last().map_or(0.0, seconds);
                records.iter().try_for_each(|record| self.write(&scalars(record, begun + seconds(record))))
            }
            TrainingEvent::Recorded { record, .. } => self.write(&scalars(record, now())),
            _ => Ok(()),
        }
    }
}

/// Seconds since 1970.
fn now() -> f64 {
    SystemTime::UNIX_EPOCH.elapsed().map_or(0.0, |time| time.as_secs_f64())
}
