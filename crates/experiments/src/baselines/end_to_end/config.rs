//! Which end-to-end baseline is trained, and how.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};
use tch::Device;

use super::ddpae::{self, Ddpae};
use super::frame_model::FrameModel;
use super::planet::{self, Planet};
use super::video_lstm::VideoLstm;
use paig::network::System;
use paig::support::storage;
use paig_kernels::Kernels;

/// The file of a run's folder that holds it.
pub(super) const MODEL: &str = "model.toml";

/// Which model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EndToEndModel {
    VideoLstm,
    Ddpae,
    Planet,
}

impl EndToEndModel {
    /// A fresh model of a system.
    pub fn build(self, system: &System, kernels: Kernels, seed: u64, device: Device) -> Box<dyn FrameModel> {
        match self {
            EndToEndModel::VideoLstm => Box::new(VideoLstm::new(system, kernels, seed, device)),
            EndToEndModel::Ddpae => Box::new(Ddpae::new(system, seed, device)),
            EndToEndModel::Planet => Box::new(Planet::new(system, seed, device)),
        }
    }

    /// Of the frames that it takes in, pixels: smaller ones leave nothing of themselves after its last layer.
    pub(super) fn least_side(self) -> usize {
        match self {
            EndToEndModel::VideoLstm => 1,
            EndToEndModel::Ddpae => ddpae::LEAST_SIDE,
            EndToEndModel::Planet => planet::LEAST_SIDE,
        }
    }

    /// Whether it learns what frames are worth.
    pub fn learns_rewards(self) -> bool {
        self == EndToEndModel::Planet
    }
}

/// What decides the result of a training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EndToEndConfig {
    pub model: EndToEndModel,
    /// Name of the task or its file.
    pub task: String,
    pub data: PathBuf,
    pub seed: u64,
    /// Adam's.
    pub learning_rate: f64,
    /// Clips in a step.
    pub batch: usize,
    pub steps: u64,
    /// Steps from one validation and checkpoint to the next.
    pub checkpoint_every: u64,
    /// What computes the operations that have kernels, the optimizer's step among them.
    #[serde(default, skip_serializing_if = "is_default")]
    pub kernels: Kernels,
}

/// Files without the key stay as they are.
fn is_default(kernels: &Kernels) -> bool {
    *kernels == Kernels::default()
}

impl EndToEndConfig {
    /// # Errors
    /// A number out of range.
    pub fn check(&self) -> Result<()> {
        ensure!(self.learning_rate.is_finite() && self.learning_rate > 0.0, "the learning rate must be positive");
        ensure!(
            self.batch > 0 && self.steps > 0 && self.checkpoint_every > 0,
            "batch, steps and checkpoint-every must be at least 1"
        );
        ensure!(self.seed <= i64::MAX as u64, "seed {}: must be at most {}", self.seed, i64::MAX);
        Ok(())
    }
}

/// The config of the run in a folder; none if there is no such run.
///
/// # Errors
/// A damaged file.
pub fn read(folder: &Path) -> Result<Option<EndToEndConfig>> {
    let path = folder.join(MODEL);
    if !path.exists() {
        return Ok(None);
    }
    let read = || Ok::<_, anyhow::Error>(toml::from_str(&storage::read_to_string(&path)?)?);
    read().with_context(|| format!("config {}", path.display())).map(Some)
}
