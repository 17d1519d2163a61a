//! Finding run folders and reading them.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use super::criteria;
use super::reproduce::RunConfig;
use crate::viz::seeds::{Outcome, Trace};

/// One run folder.
#[derive(Debug)]
pub(super) struct Run {
    pub folder: PathBuf,
    pub config: RunConfig,
    /// None for a run that has not finished.
    pub summary: Option<Summary>,
    /// The course of the training, or why it cannot be read.
    pub trace: Result<Trace>,
}

/// What a finished run says of itself.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Summary {
    pub task: String,
    pub parameters: BTreeMap<String, Parameter>,
    pub test: Test,
    pub steps: u64,
    pub wall_seconds: f64,
    pub phase_seconds: BTreeMap<String, f64>,
    pub device: String,
    pub threads: usize,
    pub versions: BTreeMap<String, String>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) struct Parameter {
    pub learned: f64,
    pub truth: Option<f64>,
}

/// Test losses; null in the file where a clip has no such frames.
#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) struct Test {
    recons_loss: Option<f64>,
    pred_loss: Option<f64>,
    extrap_loss: Option<f64>,
    pub clips: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub(super) enum Loss {
    #[serde(rename = "recons_loss")]
    Recons,
    #[serde(rename = "pred_loss")]
    Pred,
    #[serde(rename = "extrap_loss")]
    Extrap,
}

impl Loss {
    pub(super) const ALL: [Loss; 3] = [Loss::Recons, Loss::Pred, Loss::Extrap];

    pub(super) fn symbol(self) -> &'static str {
        match self {
            Loss::Recons => "L_rec",
            Loss::Pred => "L_pred",
            Loss::Extrap => "L_extrap",
        }
    }
}

impl Test {
    pub(super) fn loss(&self, loss: Loss) -> Option<f64> {
        match loss {
            Loss::Recons => self.recons_loss,
            Loss::Pred => self.pred_loss,
            Loss::Extrap => self.extrap_loss,
        }
    }
}

impl Parameter {
    pub(super) fn error_percent(&self) -> Option<f64> {
        self.truth.map(|truth| 100.0 * (self.learned / truth - 1.0))
    }
}

impl Run {
    fn read(folder: &Path) -> Result<Self> {
        let config = RunConfig::read(&folder.join("config.toml"))?;
        let path = folder.join("summary.json");
        let summary = match path.exists() {
            true => {
                let text = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
                Some(serde_json::from_slice(&text).with_context(|| format!("{} is damaged", path.display()))?)
            }
            false => None,
        };
        Ok(Run { folder: folder.into(), config, summary, trace: Trace::read(folder) })
    }

    pub(super) fn outcome(&self) -> Outcome {
        match &self.summary {
            None => Outcome::Unfinished,
            Some(summary) if criteria::succeeded(summary) => Outcome::Succeeded,
            Some(_) => Outcome::Missed,
        }
    }
}

/// All run folders that were found.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub runs: Vec<Run>,
    /// Folders whose config or summary is damaged, and how.
    pub unreadable: Vec<(PathBuf, anyhow::Error)>,
}

/// Searches folders and what lies under them, in the order of their names.
pub(super) fn find(folders: &[PathBuf]) -> Result<Found> {
    let mut places = Vec::new();
    for folder in folders {
        let context = || format!("cannot list {}", folder.display());
        // Overlapping arguments must not count a run twice.
        search(folder, &fs::canonicalize(folder).with_context(context)?, &mut places).with_context(context)?;
    }
    let mut found = Found::default();
    for (place, _) in places {
        match Run::read(&place) {
            Ok(run) => found.runs.push(run),
            Err(error) => found.unreadable.push((place, error)),
        }
    }
    Ok(found)
}

/// `places`: run folders as they were reached, and their true paths.
fn search(folder: &Path, canonical: &Path, places: &mut Vec<(PathBuf, PathBuf)>) -> Result<()> {
    if folder.join("config.toml").exists() && folder.join("metrics.jsonl").exists() {
        if places.iter().all(|(_, known)| known != canonical) {
            places.push((folder.into(), canonical.into()));
        }
        return Ok(());
    }
    let mut below = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))? {
        let entry = entry?;
        // Not through links: they can lead in a circle.
        if entry.file_type()?.is_dir() {
            below.push(entry.file_name());
        }
    }
    below.sort();
    below.iter().try_for_each(|name| search(&folder.join(name), &canonical.join(name), places))
}
