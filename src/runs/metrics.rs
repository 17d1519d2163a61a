//! metrics.jsonl: the course of a training, one record a line. The one writer and the one reader of that file.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Deserializer, Serialize};

use crate::network::cells::PhysicalParameter;
use crate::support::run_names::METRICS;
use crate::support::storage;

/// Version of the file's form, in its first record; to be raised when a reader of today could misread it. Files of before
/// it have none.
const FORMAT: u32 = 1;

/// What kind of record a line is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RecordKind {
    /// The first line: the version of the file's form.
    Begin,
    /// A step's losses.
    Train,
    /// The losses on the validation split.
    Valid,
    /// The fit of the parameters.
    Identify,
    /// Nothing that this version knows.
    #[default]
    #[serde(other)]
    Other,
}

/// One line of the file. What a kind of record does not say is left out; null stands for what is not a number.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    pub kind: RecordKind,
    #[serde(default)]
    pub phase: String,
    /// Steps taken in all phases.
    #[serde(default)]
    pub step: u64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<u32>,
    /// Passes over the training clips, as the original counts them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub epoch: Option<u64>,
    /// What is differentiated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub train_loss: Option<f64>,
    /// By which the phase ends.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub score: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recons_loss: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pred_loss: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub extrap_loss: Option<f64>,
    /// Root mean square of the fit, pixels or radians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub residual: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub iterations: Option<usize>,
    /// Encoded minus fitted position of each object, pixels or radians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offsets: Option<Vec<f64>>,
    /// Whether the templates were shifted by the offsets.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recentred: Option<bool>,
    /// What the velocity estimator's own fit leaves, per time unit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity_residual: Option<f64>,
    /// Seconds of computing so far.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// The physical parameters by symbol, lengths in true pixels.
    #[serde(flatten, deserialize_with = "numbers")]
    pub parameters: BTreeMap<String, f64>,
}

/// What else a record holds, as far as it is numbers.
fn numbers<'de, D: Deserializer<'de>>(deserializer: D) -> Result<BTreeMap<String, f64>, D::Error> {
    let all = BTreeMap::<String, serde_json::Value>::deserialize(deserializer)?;
    Ok(all.into_iter().filter_map(|(name, value)| Some((name, value.as_f64()?))).collect())
}

/// What a record has beside the parameters.
const KEYS: [&str; 16] = [
    "kind",
    "phase",
    "step",
    "format",
    "epoch",
    "train_loss",
    "score",
    "recons_loss",
    "pred_loss",
    "extrap_loss",
    "residual",
    "iterations",
    "offsets",
    "recentred",
    "velocity_residual",
    "seconds",
];

/// Whether a record can hold parameters of these names.
///
/// # Errors
/// One that is called like another number: the line could not be read again.
pub fn check_parameters(parameters: &[PhysicalParameter]) -> Result<()> {
    for PhysicalParameter { name, .. } in parameters {
        ensure!(
            !KEYS.contains(&&**name),
            "the files of a run have another number called {name}; give the parameter another name"
        );
    }
    Ok(())
}

impl Record {
    /// A record that says only where it stands.
    pub fn new(kind: RecordKind, phase: &str, step: u64) -> Self {
        Record { kind, phase: phase.into(), step, ..Record::default() }
    }

    /// The first record of a file.
    pub fn begin() -> Self {
        Record { format: Some(FORMAT), ..Record::new(RecordKind::Begin, "", 0) }
    }

    /// A number of the record by its key, if it has it.
    pub fn value(&self, name: &str) -> Option<f64> {
        match name {
            "train_loss" => self.train_loss,
            "score" => self.score,
            "recons_loss" => self.recons_loss,
            "pred_loss" => self.pred_loss,
            "extrap_loss" => self.extrap_loss,
            "residual" => self.residual,
            "velocity_residual" => self.velocity_residual,
            "seconds" => self.seconds,
            symbol => self.parameters.get(symbol).copied(),
        }
    }

    /// `k=3.992 l=5.998`.
    pub(crate) fn parameters_text(&self) -> String {
        self.parameters.iter().map(|(name, value)| format!("{name}={value:.3}")).collect::<Vec<_>>().join(" ")
    }

    /// Writes the record as a line.
    ///
    /// # Errors
    /// A full disk.
    pub fn write(&self, file: &mut impl Write) -> Result<()> {
        // In one piece: a run that is killed leaves a whole line or none.
        let line = serde_json::to_string(self)? + "\n";
        file.write_all(line.as_bytes()).with_context(|| format!("cannot write {METRICS}"))
    }
}

/// All records but the first, in the order in which they were written. A damaged last line without its end is being
/// written, or was when the run was killed: it is left out.
///
/// # Errors
/// A missing file, the number of a line that is no record, a newer form.
pub fn read(path: &Path) -> Result<Vec<Record>> {
    let bytes = storage::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    parse(&bytes).with_context(|| path.display().to_string())
}

/// The same of the bytes of a file.
///
/// # Errors
/// The number of a line that is no record, a newer form.
pub fn parse(bytes: &[u8]) -> Result<Vec<Record>> {
    let mut records: Vec<Record> = Vec::new();
    let lines = bytes.split_inclusive(|byte| *byte == b'\n').enumerate();
    for (number, line) in lines.filter(|(_, line)| !line.trim_ascii().is_empty()) {
        match serde_json::from_slice(line) {
            Ok(record) => records.push(record),
            Err(_) if !line.ends_with(b"\n") => {}
            Err(error) => return Err(error).with_context(|| format!("line {} is damaged", number + 1)),
        }
    }
    let format = records.first().and_then(|record| record.format).unwrap_or_default();
    ensure!(format <= FORMAT, "it has form {format}; this program knows forms up to {FORMAT}: use a newer one");
    records.retain(|record| record.kind != RecordKind::Begin);
    Ok(records)
}

/// (step, value) of the records of a kind (of any, if none is given) that hold a value.
pub fn points(records: &[Record], kind: Option<RecordKind>, name: &str) -> Vec<(f64, f64)> {
    let chosen = records.iter().filter(|record| kind.is_none_or(|kind| kind == record.kind));
    chosen.filter_map(|record| Some((record.step as f64, record.value(name)?))).collect()
}

/// One uninterrupted stretch of a phase.
#[derive(Debug)]
pub struct Stretch {
    pub phase: String,
    /// Where its first and its last record stand among all.
    pub records: std::ops::Range<usize>,
    /// Its first and last step.
    pub steps: (u64, u64),
}

/// The phases in their order.
pub fn stretches(records: &[Record]) -> Vec<Stretch> {
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

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn the_keys_of_a_record_are_known() {
        let full = Record {
            format: Some(1),
            epoch: Some(1),
            iterations: Some(1),
            offsets: Some(Vec::new()),
            recentred: Some(true),
            train_loss: Some(1.0),
            score: Some(1.0),
            recons_loss: Some(1.0),
            pred_loss: Some(1.0),
            extrap_loss: Some(1.0),
            residual: Some(1.0),
            velocity_residual: Some(1.0),
            seconds: Some(1.0),
            ..Record::new(RecordKind::Train, "join", 1)
        };
        let written = serde_json::to_value(full).unwrap();
        let mut keys: Vec<_> = written.as_object().unwrap().keys().map(String::as_str).collect();
        let mut known = KEYS;
        keys.sort_unstable();
        known.sort_unstable();
        assert_eq!(keys, known);
    }

    #[test]
    fn records_of_any_version_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(METRICS);
        let lines = [
            "{\"kind\":\"begin\",\"phase\":\"\",\"step\":0,\"format\":1}",
            "{\"kind\":\"train\",\"phase\":\"join\",\"step\":50,\"train_loss\":null,\"k\":2.5,\"l\":null,\"later\":\"word\"}",
            "{\"kind\":\"of tomorrow\",\"phase\":\"join\",\"step\":60}",
            "{\"kind\":\"train\",\"pha",
        ];
        fs::write(&path, lines.join("\n")).unwrap();
        let records = read(&path).unwrap();
        assert_eq!(
            records.iter().map(|record| record.kind).collect::<Vec<_>>(),
            [RecordKind::Train, RecordKind::Other]
        );
        assert_eq!((records[0].value("k"), records[0].value("l"), records[0].train_loss), (Some(2.5), None, None));
        let newer = lines[0].replace("\"format\":1", "\"format\":2");
        fs::write(&path, newer).unwrap();
        assert!(format!("{:#}", read(&path).unwrap_err()).contains("forms up to 1"));
        fs::write(&path, lines[3].to_string() + "\n" + lines[0]).unwrap();
        assert!(format!("{:#}", read(&path).unwrap_err()).contains("line 1"));
    }
}
