//! Options that programs share: a run and its clips.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use tch::Device;

use paig::datasets::files::Split;
use paig::evaluation::ScoredClips;
use paig::network::physics_models::PhysicsNet;
use paig::runs::checkpoint::SavedWeights;
use paig::support::device;
use paig::training::config::Config;
use paig::training::saved::load_model;

/// A run, a part of a dataset file, and where to compute.
#[derive(Debug, Args)]
pub struct ScoredRun {
    /// Run folder
    pub run: PathBuf,
    /// Dataset file [default: the run's test file]
    #[arg(long)]
    pub file: Option<PathBuf>,
    /// Folder of the datasets; not with --file [default: as the run had it]
    #[arg(long, value_name = "DIR", conflicts_with = "file")]
    data: Option<PathBuf>,
    /// Part of the file
    #[arg(long, default_value = "test", value_parser = Split::ALL.map(Split::name))]
    split: String,
    /// Weights of the last checkpoint, or those with the best validation score of the last phase
    #[arg(long, default_value = "last")]
    checkpoint: WeightsChoice,
    /// cpu, cuda or cuda:n
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Threads to compute with; 0 for one a core
    #[arg(long, default_value_t = 0)]
    threads: usize,
}

/// Which of a run's weights.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum WeightsChoice {
    Last,
    Best,
}

impl From<WeightsChoice> for SavedWeights {
    fn from(weights: WeightsChoice) -> Self {
        match weights {
            WeightsChoice::Last => SavedWeights::Last,
            WeightsChoice::Best => SavedWeights::Best,
        }
    }
}

/// A trained model and where the clips are.
#[derive(Debug)]
pub struct ClipsOfRun {
    pub config: Config,
    pub model: PhysicsNet,
    pub file: PathBuf,
    pub split: Split,
    pub device: Device,
}

impl ScoredRun {
    /// Reads the run's last checkpoint and sets the number of threads.
    ///
    /// # Errors
    /// A GPU that is not there, a folder that holds no run or no checkpoint.
    pub fn open(&self) -> Result<ClipsOfRun> {
        let device = device::parse(&self.device)?;
        device::set_threads(self.threads)?;
        let (mut config, model) = load_model(&self.run, self.checkpoint.into(), device)?;
        device::set_tf32(device, config.model.tf32);
        config.data.folder = self.data.clone().unwrap_or(config.data.folder);
        let own = || config.data.test_path();
        let file = self.file.clone().unwrap_or_else(own);
        let split = Split::ALL.into_iter().find(|split| split.name() == self.split).context("unknown split")?;
        Ok(ClipsOfRun { config, model, file, split, device })
    }

    /// Reads the clips. Those of the run's own test file must be what it was begun with.
    ///
    /// # Errors
    /// As for [`ScoredClips::read`], and a test file that was replaced.
    pub fn read_clips(&self, opened: &ClipsOfRun) -> Result<ScoredClips> {
        let ClipsOfRun { config, file, split, device, .. } = opened;
        let clips = ScoredClips::read(file, &config.task, *split, *device)?;
        if *file == config.data.test_path() && self.file.is_none() && self.data.is_none() {
            let advice = || format!("{}: put it back, or name it by --file to use it nevertheless", file.display());
            clips.ensure_of_run(&self.run).with_context(advice)?;
        }
        Ok(clips)
    }
}
