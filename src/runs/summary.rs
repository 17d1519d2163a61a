//! summary.json: what a finished run says of itself. The one writer and the one reader of that file.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use super::scores::Scores;
use super::verdict::Verdict;
use crate::support::run_names::SUMMARY;
use crate::support::{atomic, storage};

/// Version of the file's form; to be raised when a reader of today could misread it. Files of before it have none.
pub const FORMAT: u32 = 1;

/// A finished run. What may be missing was not written by earlier versions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    #[serde(default)]
    pub format: u32,
    /// Name of the task.
    pub task: String,
    pub recipe: String,
    pub seed: u64,
    /// The learned parameters by symbol, lengths in true pixels.
    pub parameters: BTreeMap<String, LearnedParameter>,
    /// Scores on the test file.
    pub test: TestScores,
    /// What the run says of itself, without the truth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    pub training_clips: Option<usize>,
    pub validation_clips: Option<usize>,
    /// What differs from the plain recipe of the task, as `section.key=value`.
    #[serde(default)]
    pub overrides: Vec<String>,
    /// Steps of all phases.
    pub steps: u64,
    pub wall_seconds: f64,
    /// Seconds of each phase by name.
    pub phase_seconds: BTreeMap<String, f64>,
    pub device: String,
    pub threads: usize,
    pub hardware: Option<Hardware>,
    /// Of the program, of libtorch, the commits that trained and scored.
    pub versions: BTreeMap<String, String>,
}

/// A parameter of the equation after the training.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LearnedParameter {
    pub learned: f64,
    /// The value the data were made with, where it is known.
    pub truth: Option<f64>,
}

impl LearnedParameter {
    /// The learned value over the truth; none where that is not known or 0.
    pub fn ratio(&self) -> Option<f64> {
        let truth = self.truth.filter(|truth| *truth != 0.0)?;
        Some(self.learned / truth)
    }

    /// The error in per cent of the truth, with its sign; none as for [`Self::ratio`].
    pub fn error_percent(&self) -> Option<f64> {
        Some(100.0 * (self.ratio()? - 1.0))
    }
}

/// Scores on the test clips, and how these were made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TestScores {
    #[serde(flatten)]
    pub scores: Scores,
    /// The settings of the file's clips as text; none of a file that was not generated here.
    pub made_with: Option<String>,
}

/// The machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hardware {
    /// As the kernel names it.
    pub processor: Option<String>,
    /// Those that the program may use.
    pub cores: usize,
}

impl Summary {
    /// Reads the summary in a run folder; none of a run that has not finished.
    ///
    /// # Errors
    /// A damaged file, or one of a newer form.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(SUMMARY);
        if !path.exists() {
            return Ok(None);
        }
        let text = storage::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let summary: Self = serde_json::from_slice(&text).with_context(|| format!("{} is damaged", path.display()))?;
        ensure!(
            summary.format <= FORMAT,
            "{} has form {}; this program knows forms up to {FORMAT}: use a newer one",
            path.display(),
            summary.format
        );
        Ok(Some(summary))
    }

    /// Writes the summary into a run folder, whole or not at all.
    ///
    /// # Errors
    /// A full disk.
    pub fn write(&self, folder: &Path) -> Result<()> {
        atomic::write_file(&folder.join(SUMMARY), |file| Ok(serde_json::to_writer_pretty(file, self)?))
    }

    /// The error of a learned parameter in per cent, with its sign; none where its truth is not known or 0.
    pub fn error_percent(&self, symbol: &str) -> Option<f64> {
        self.parameters.get(symbol)?.error_percent()
    }
}

#[cfg(test)]
mod tests {
    use super::LearnedParameter;

    #[test]
    fn errors_are_shares_of_the_truth_where_it_has_any() {
        let error = |truth| LearnedParameter { learned: 3.0, truth }.error_percent();
        assert_eq!([error(Some(4.0)), error(Some(0.0)), error(None)], [Some(-25.0), None, None]);
    }
}
