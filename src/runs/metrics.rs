//! Reading metrics.jsonl back.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use serde::Deserialize;
use serde_json::{Map, Value};

/// What kind of record a line is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Kind {
    Train,
    Valid,
    Identify,
    /// Nothing that is plotted.
    #[serde(other)]
    Other,
}

/// One line of metrics.jsonl.
#[derive(Debug, Deserialize)]
pub(crate) struct Record {
    pub kind: Kind,
    pub phase: String,
    /// Steps taken in all phases.
    pub step: u64,
    #[serde(flatten)]
    values: Map<String, Value>,
}

impl Record {
    /// A number of the record, if it has it (null stands for what is not a number).
    pub(crate) fn value(&self, name: &str) -> Option<f64> {
        self.values.get(name).and_then(Value::as_f64)
    }
}

/// All records, in the order in which they were written. A damaged last line without its end is being written, or was
/// when the run was killed: it is left out.
///
/// # Errors
/// A missing file, or the number of a line that is no record.
pub(crate) fn read(path: &Path) -> Result<Vec<Record>> {
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let mut records = Vec::new();
    for (number, line) in text.split_inclusive('\n').enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        match serde_json::from_str(line) {
            Ok(record) => records.push(record),
            Err(_) if !line.ends_with('\n') => {}
            Err(error) => {
                return Err(error).with_context(|| format!("{}: line {} is damaged", path.display(), number + 1));
            }
        }
    }
    Ok(records)
}

/// (step, value) of the records of a kind (of any, if none is given) that hold a value.
pub(crate) fn points(records: &[Record], kind: Option<Kind>, name: &str) -> Vec<(f64, f64)> {
    let chosen = records.iter().filter(|record| kind.is_none_or(|kind| kind == record.kind));
    chosen.filter_map(|record| Some((record.step as f64, record.value(name)?))).collect()
}

/// One uninterrupted stretch of a phase.
#[derive(Debug)]
pub(crate) struct Stretch {
    pub phase: String,
    /// Where its first and its last record stand among all.
    pub records: std::ops::Range<usize>,
    /// Its first and last step.
    pub steps: (u64, u64),
}

/// The phases in their order.
pub(crate) fn stretches(records: &[Record]) -> Vec<Stretch> {
    let mut stretches: Vec<Stretch> = Vec::new();
    for (place, record) in records.iter().enumerate() {
        match stretches.last_mut() {
            Some(last) if last.phase == record.phase => {
                last.records.end = place + 1;
                last.steps.1 = record.step;
            }
            _ => stretches.push(Stretch {
                phase: record.phase.clone(),
                records: place..place + 1,
                steps: (record.step, record.step),
            }),
        }
    }
    stretches
}
