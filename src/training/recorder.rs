//! Writes what happens in a training into the run's folder: log.txt, with the original's lines, and metrics.jsonl.

use anyhow::{Context, Result};

use super::observer::{TrainingEvent, TrainingObserver};
use crate::runs::folder::RunFolder;
use crate::runs::metrics::{Record, RecordKind};
use crate::support::run_names::LOG;
use crate::support::storage::StorageOutput;

/// The run folder's logs.
#[derive(Debug)]
pub struct Recorder {
    log: Box<dyn StorageOutput>,
    metrics: Box<dyn StorageOutput>,
}

impl Recorder {
    /// # Errors
    /// Files that cannot be opened.
    pub fn new(folder: &RunFolder) -> Result<Self> {
        Ok(Recorder { log: folder.log()?, metrics: folder.metrics()? })
    }

    fn log(&mut self, line: &str) -> Result<()> {
        self.log.write_all(format!("{line}\n").as_bytes()).with_context(|| format!("cannot write {LOG}"))
    }
}

/// The original's line for a record, if it has one.
pub fn line(record: &Record) -> Option<String> {
    match record.kind {
        RecordKind::Train => {
            let parameters = record.parameters_text();
            let loss = record.train_loss.unwrap_or(f64::NAN);
            let line = format!("train - iter={} train_loss={loss:.4} {parameters}", record.step);
            Some(line.trim_end().to_string())
        }
        RecordKind::Valid => {
            // Of a phase that predicts nothing only the last.
            let losses = [("extrap", record.extrap_loss), ("pred", record.pred_loss), ("recons", record.recons_loss)];
            let losses = losses.into_iter().filter_map(|(name, loss)| Some(format!(" eval_{name}_loss={:.4}", loss?)));
            Some(format!("valid - epoch={}{}", record.epoch.unwrap_or_default(), losses.collect::<String>()))
        }
        RecordKind::Begin | RecordKind::Identify | RecordKind::Other => None,
    }
}

impl<M> TrainingObserver<M> for Recorder {
    fn observe(&mut self, event: &TrainingEvent<M>) -> Result<()> {
        match event {
            TrainingEvent::Recorded { record, .. } => {
                if self.metrics.length()? == 0 {
                    Record::begin().write(&mut self.metrics)?;
                }
                line(record).map_or(Ok(()), |line| self.log(&line))?;
                record.write(&mut self.metrics)
            }
            TrainingEvent::Note(line) => self.log(line),
            _ => Ok(()),
        }
    }
}
