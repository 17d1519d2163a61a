//! Finding run folders and reading them.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use super::criteria;
use super::records;
use super::run_config::RunConfig;
use crate::runs::folder::{CONFIG, METRICS};
use crate::runs::scores::{PredictedFrame, StateErrors};
use crate::runs::summary::SUMMARY;
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
    /// What the run learned from; of a run that has not finished, as others on the same files say.
    pub data: Option<Data>,
}

/// The clips of a run's files, and how they were made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Data {
    pub training_clips: u64,
    pub validation_clips: u64,
    pub test_clips: u64,
    /// None of files that were not generated here.
    pub made_with: Option<String>,
}

/// What a finished run says of itself. What may be missing was not written by earlier versions.
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
    training_clips: Option<u64>,
    validation_clips: Option<u64>,
    pub hardware: Option<Hardware>,
}

#[derive(Debug, Clone, Deserialize)]
pub(super) struct Hardware {
    pub processor: Option<String>,
    pub cores: usize,
}

#[derive(Debug, Clone, Copy, Deserialize)]
pub(super) struct Parameter {
    pub learned: f64,
    pub truth: Option<f64>,
}

/// Test scores; a loss is null in the file where a clip has no such frames.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Test {
    recons_loss: Option<f64>,
    pred_loss: Option<f64>,
    extrap_loss: Option<f64>,
    clips: u64,
    #[serde(default)]
    pub predicted_frames: Vec<PredictedFrame>,
    pub states: Option<StateErrors>,
    made_with: Option<String>,
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

impl Summary {
    /// The error of a learned parameter in per cent, with its sign; none where its truth is not known.
    pub(super) fn error_percent(&self, name: &str) -> Option<f64> {
        self.parameters.get(name)?.error_percent()
    }

    fn data(&self) -> Option<Data> {
        Some(Data {
            training_clips: self.training_clips?,
            validation_clips: self.validation_clips?,
            test_clips: self.test.clips,
            made_with: self.test.made_with.clone(),
        })
    }
}

impl Run {
    fn read(folder: &Path) -> Result<Self> {
        let config = RunConfig::read(&folder.join(CONFIG))?;
        let path = folder.join(SUMMARY);
        let summary: Option<Summary> = match path.exists() {
            true => {
                let text = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
                Some(serde_json::from_slice(&text).with_context(|| format!("{} is damaged", path.display()))?)
            }
            false => None,
        };
        let data = summary.as_ref().and_then(Summary::data);
        Ok(Run { folder: folder.into(), config, summary, trace: Trace::read(folder), data })
    }

    pub(super) fn outcome(&self) -> Outcome {
        match &self.summary {
            None => Outcome::Unfinished,
            Some(summary) if criteria::succeeded(&self.config, summary) => Outcome::Succeeded,
            Some(_) => Outcome::Missed,
        }
    }

    /// Steps until the end, or until the last record of a run that has not finished.
    pub(super) fn steps(&self) -> Option<u64> {
        let traced = || self.trace.as_ref().ok().map(Trace::steps);
        self.summary.as_ref().map(|summary| summary.steps).or_else(traced)
    }

    /// Passes over the training clips that `join`'s batches make in these steps.
    pub(super) fn epochs(&self) -> Option<f64> {
        let steps_per_epoch = (self.data.as_ref()?.training_clips as f64 / self.config.number("join.batch")?).floor();
        (steps_per_epoch >= 1.0).then_some(self.steps()? as f64 / steps_per_epoch)
    }

    /// `1750 steps`; of a recipe that counts epochs, `1750 steps (35 epochs)`.
    pub(super) fn length(&self) -> String {
        let Some(steps) = self.steps() else { return "an unknown number of steps".into() };
        let in_epochs = self.config.choices.contains_key("join.epochs");
        match self.epochs().filter(|_| in_epochs) {
            Some(epochs) => format!("{steps} steps ({} epochs)", (10.0 * epochs).round() / 10.0),
            None => format!("{steps} steps"),
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

/// Searches folders and what lies under them, in the order of their names. Of a report's folder its records count;
/// those of a report met on the way do not, the runs being somewhere else.
pub(super) fn find(folders: &[PathBuf]) -> Result<Found> {
    let mut places = Vec::new();
    for folder in folders {
        let context = || format!("cannot list {}", folder.display());
        // Overlapping arguments must not count a run twice.
        let folder = &records::searched(folder);
        search(folder, &fs::canonicalize(folder).with_context(context)?, &mut places)?;
    }
    let mut found = Found::default();
    for (place, _) in places {
        match Run::read(&place) {
            Ok(run) => found.runs.push(run),
            Err(error) => found.unreadable.push((place, error)),
        }
    }
    found.runs = without_copies(found.runs)?;
    for place in 0..found.runs.len() {
        let files = |run: &Run| (run.config.task.key, run.config.data_files().map(Option::<&String>::cloned));
        let here = files(&found.runs[place]);
        let known = found.runs.iter().filter(|run| files(run) == here).find_map(|run| run.data.clone());
        let run = &mut found.runs[place];
        run.data = run.data.take().or(known);
    }
    Ok(found)
}

/// Of runs that are one and the same the one that went furthest: a run and its record in an earlier report, which may
/// have been made before the run went on. Their configs are equal, and the course of one begins with that of the other.
fn without_copies(runs: Vec<Run>) -> Result<Vec<Run>> {
    let mut kept: Vec<(Run, [Vec<u8>; 2])> = Vec::new();
    let further = |run: &Run, course: &[u8]| (course.len(), run.summary.is_some());
    for run in runs {
        let read = |name: &str| {
            let path = run.folder.join(name);
            fs::read(&path).with_context(|| format!("cannot read {}", path.display()))
        };
        let files = [read(CONFIG)?, read(METRICS)?];
        let same = |(_, other): &&mut (Run, [Vec<u8>; 2])| {
            other[0] == files[0] && (other[1].starts_with(&files[1]) || files[1].starts_with(&other[1]))
        };
        match kept.iter_mut().find(same) {
            Some(other) if further(&run, &files[1]) > further(&other.0, &other.1[1]) => *other = (run, files),
            Some(_) => {}
            None => kept.push((run, files)),
        }
    }
    Ok(kept.into_iter().map(|(run, _)| run).collect())
}

/// `places`: run folders as they were reached, and their true paths.
fn search(folder: &Path, canonical: &Path, places: &mut Vec<(PathBuf, PathBuf)>) -> Result<()> {
    if folder.join(CONFIG).exists() && folder.join(METRICS).exists() {
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
    let of_report = records::of_report(folder);
    below.retain(|name| of_report.as_ref() != Some(&folder.join(name)));
    below.sort();
    below.iter().try_for_each(|name| search(&folder.join(name), &canonical.join(name), places))
}
