//! What a finished run scores.

use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use super::config::EndToEndConfig;
use paig::runs::scores::Scores;
use paig::support::storage;

/// The file of a run's folder that holds them.
pub(super) const SCORES: &str = "scores.json";

/// What a finished run scores on its test file.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct EndToEndScores {
    pub config: EndToEndConfig,
    pub weights: usize,
    pub training_clips: usize,
    pub seconds: f64,
    /// The validation whose weights are scored; none in files of before, which score those of the last step.
    #[serde(default)]
    pub best: Option<ValidationScore>,
    pub scores: Scores,
}

/// One validation: after which step, and the error on all frames after the input.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct ValidationScore {
    pub step: u64,
    pub error: f64,
}

impl EndToEndScores {
    /// Of the run in a folder; none if it has not finished.
    ///
    /// # Errors
    /// A damaged file.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(SCORES);
        if !path.exists() {
            return Ok(None);
        }
        let read = || Ok::<_, anyhow::Error>(serde_json::from_slice(&storage::read(&path)?)?);
        read().with_context(|| format!("scores {}", path.display())).map(Some)
    }
}
