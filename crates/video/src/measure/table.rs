//! Many measurements in one table, beside what is known of their videos.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use super::results::{Measurement, Outcome};
use paig::support::output::{FileKind, has_keys};
use paig::support::{atomic, storage};

/// References by the video's name (that of a batch, or its file's without the ending) and the quantity.
pub type References = BTreeMap<String, BTreeMap<String, Reference>>;

/// Value that a quantity is held against.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Reference {
    Value(f64),
    /// With its source.
    Sourced {
        value: f64,
        from: String,
    },
}

impl Reference {
    fn value(&self) -> f64 {
        match self {
            Reference::Value(value) | Reference::Sourced { value, .. } => *value,
        }
    }

    fn source(&self) -> Option<String> {
        match self {
            Reference::Value(_) => None,
            Reference::Sourced { from, .. } => Some(from.clone()),
        }
    }
}

/// One quantity of one video.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct QuantityRow {
    pub clip: String,
    /// Empty for a video without a measurement.
    pub quantity: String,
    pub value: Option<f64>,
    /// 95 % interval; none of what has none.
    pub low: Option<f64>,
    pub high: Option<f64>,
    pub unit: String,
    pub reference: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference_from: Option<String>,
    /// Whether the value can be quoted; none of what is no parameter.
    #[serde(default)]
    pub verdict: Option<Outcome>,
    /// The fit to the other observation, with its 95 % interval.
    #[serde(default)]
    pub tracker_value: Option<f64>,
    #[serde(default)]
    pub tracker_low: Option<f64>,
    #[serde(default)]
    pub tracker_high: Option<f64>,
    /// Frames that were fitted.
    #[serde(default)]
    pub frames: usize,
    /// Root mean square distances in the held-out part, pixels of the video (or radians): of the fitted equation and of the
    /// two baselines.
    pub heldout_error: Option<f64>,
    pub heldout_error_constant_velocity: Option<f64>,
    pub heldout_error_tracker_fit: Option<f64>,
    /// Of training and measurement.
    pub seconds: Option<f64>,
    /// Reasons of a verdict that is not `found`, or of a failure.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub reason: String,
}

impl QuantityRow {
    /// QuantityRow of a video that could not be measured.
    pub fn failed(clip: &str, reason: &str) -> Self {
        QuantityRow {
            clip: clip.into(),
            quantity: String::new(),
            value: None,
            low: None,
            high: None,
            unit: String::new(),
            reference: None,
            reference_from: None,
            verdict: None,
            tracker_value: None,
            tracker_low: None,
            tracker_high: None,
            frames: 0,
            heldout_error: None,
            heldout_error_constant_velocity: None,
            heldout_error_tracker_fit: None,
            seconds: None,
            reason: reason.into(),
        }
    }
}

/// # Errors
/// A file that is not one of references.
pub fn read_references(path: &Path) -> Result<References> {
    let read = || Ok::<_, anyhow::Error>(toml::from_str(&storage::read_to_string(path)?)?);
    read().with_context(|| format!("references {}", path.display()))
}

/// Rows of one measurement: its quantities, the prediction, and the criteria of other equations relative to its own. `name` is
/// that of a batch; by default the video's.
pub fn rows(measurement: &Measurement, name: Option<&str>, references: &References) -> Vec<QuantityRow> {
    let video = measurement.videos.first().map_or("", String::as_str);
    let clip = name.unwrap_or_else(|| clip_name(video));
    let held_out = &measurement.held_out;
    let row = |quantity: &str, value: f64, unit: &str| {
        let reference = references.get(clip).and_then(|known| known.get(quantity));
        QuantityRow {
            quantity: quantity.into(),
            value: Some(value),
            unit: unit.into(),
            reference: reference.map(Reference::value),
            reference_from: reference.and_then(Reference::source),
            frames: measurement.frames,
            heldout_error: Some(held_out.error),
            heldout_error_constant_velocity: Some(held_out.constant_velocity),
            heldout_error_tracker_fit: held_out.tracker_fit,
            seconds: Some(measurement.training_seconds.unwrap_or_default() + measurement.seconds),
            ..QuantityRow::failed(clip, "")
        }
    };
    let reasons = measurement.verdict.as_ref().map_or(String::new(), |verdict| verdict.reasons.join("; "));
    let mut rows = Vec::new();
    for it in &measurement.quantities {
        rows.push(QuantityRow {
            low: it.low,
            high: it.high,
            verdict: it.outcome,
            reason: if it.outcome == Some(Outcome::Found) { String::new() } else { reasons.clone() },
            tracker_value: it.by_tracker,
            tracker_low: it.tracker_low,
            tracker_high: it.tracker_high,
            ..row(&it.name, it.value, &it.unit)
        });
    }
    rows.push(row("heldout_percent_of_amplitude", held_out.percent_of_amplitude, "%"));
    if let [own, others @ ..] = &measurement.alternatives[..] {
        for other in others {
            let name = other.equation.rsplit('/').next().unwrap_or(&other.equation);
            let name = name.trim_end_matches(".toml");
            rows.push(row(&format!("bic_of_{name}_minus_own"), other.bic - own.bic, ""));
            rows.push(row(&format!("heldout_error_of_{name}"), other.held_out_error, &held_out.unit));
        }
    }
    rows
}

/// The name of a video's file without its folder and ending; frames that are named behind it, where others are of the same file, do not
/// belong to it.
fn clip_name(video: &str) -> &str {
    let are_frames = |text: &str| {
        text.split_once("..").is_some_and(|(first, end)| first.parse::<usize>().and(end.parse::<usize>()).is_ok())
    };
    let file = video.rsplit_once(' ').filter(|(_, last)| are_frames(last)).map_or(video, |(file, _)| file);
    let file = file.trim_end_matches('/');
    let file = file.rsplit_once('/').map_or(file, |(_, name)| name);
    file.rsplit_once('.').map_or(file, |(stem, _)| stem)
}

/// The rows as a file that the program recognizes.
pub const ROWS: FileKind =
    FileKind { name: "rows of `paig measurements`", recognizes: |json| has_keys(json, &["clip", "quantity", "value"]) };

/// # Errors
/// A full disk.
pub fn write(path: &Path, rows: &[QuantityRow]) -> Result<()> {
    atomic::write_file(path, |file| Ok(serde_json::to_writer_pretty(file, rows)?))
}

#[cfg(test)]
mod tests {
    use super::clip_name;

    #[test]
    fn references_are_found_by_the_name_of_the_file() {
        for (video, clip) in [
            ("throws.mp4", "throws"),
            ("throws.mp4 30..62", "throws"),
            ("my throws.v2.mov", "my throws.v2"),
            ("pictures", "pictures"),
            ("pictures 0..40", "pictures"),
            ("/films/day.1/throws.mp4 30..62", "throws"),
            ("/films/day.1/pictures/", "pictures"),
        ] {
            assert_eq!(clip_name(video), clip);
        }
    }
}
