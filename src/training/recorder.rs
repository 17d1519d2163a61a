//! Writes what happens in a training into the run's folder: log.txt, with the original's lines, and metrics.jsonl.

use anyhow::{Context, Result};

use super::observer::{Event, Observer};
use crate::runs::folder::RunFolder;
use crate::runs::metrics::{Kind, Record};
use crate::runs::names::LOG;
use crate::support::storage::Output;

/// The run folder's logs.
#[derive(Debug)]
pub struct Recorder {
    log: Box<dyn Output>,
    metrics: Box<dyn Output>,
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
    let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
    match record.kind {
        Kind::Train => {
            let parameters = record.parameters_text();
            let line = format!("train - iter={} train_loss={:.4} {parameters}", record.step, number(record.train_loss));
            Some(line.trim_end().to_string())
        }
        Kind::Valid => Some(format!(
            "valid - epoch={} eval_extrap_loss={:.4} eval_pred_loss={:.4} eval_recons_loss={:.4}",
            record.epoch.unwrap_or_default(),
            number(record.extrap_loss),
            number(record.pred_loss),
            number(record.recons_loss)
        )),
        Kind::Begin | Kind::Identify | Kind::Other => None,
    }
}

impl Observer for Recorder {
    fn observe(&mut self, event: &Event) -> Result<()> {
        match event {
            Event::Recorded(record) => {
                if self.metrics.length()? == 0 {
                    Record::begin().write(&mut self.metrics)?;
                }
                line(record).map_or(Ok(()), |line| self.log(&line))?;
                record.write(&mut self.metrics)
            }
            Event::Note(line) => self.log(line),
            _ => Ok(()),
        }
    }
}
