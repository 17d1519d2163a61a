//! What `evaluate` and `predict` are given alike: a run, and clips to look at.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use tch::Device;

use crate::cli::run;
use crate::datasets::files::Split;
use crate::network::physics_models::PhysicsNet;
use crate::support::device;
use crate::training::config::Config;

/// A run, a part of a dataset file, and where to compute.
#[derive(Debug, Args)]
pub struct ScoredRun {
    /// Run folder
    pub run: PathBuf,
    /// Dataset file [default: the run's test file]
    #[arg(long)]
    file: Option<PathBuf>,
    /// Part of the file
    #[arg(long, default_value = "test", value_parser = Split::ALL.map(Split::name))]
    split: String,
    /// cpu, cuda or cuda:n
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Threads to compute with; 0 for one a core
    #[arg(long, default_value_t = 0)]
    threads: usize,
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
    /// Reads the run's last checkpoint and sets the number of threads. To be called first: it may start the program
    /// over.
    ///
    /// # Errors
    /// A GPU that is not there, a folder that holds no run or no checkpoint.
    pub fn open(&self) -> Result<ClipsOfRun> {
        device::set_environment();
        let device = device::parse(&self.device)?;
        device::set_threads(self.threads);
        let (config, model) = run::load_model(&self.run, device)?;
        let own = || config.data.folder.join(&config.data.test_file);
        let file = self.file.clone().unwrap_or_else(own);
        let split = Split::ALL.into_iter().find(|split| split.name() == self.split).context("unknown split")?;
        Ok(ClipsOfRun { config, model, file, split, device })
    }
}
