//! What programs are given: a run and clips to look at, seeds.

use std::collections::HashSet;
use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::{Args, ValueEnum};
use tch::Device;

use paig::datasets::files::Split;
use paig::network::physics_models::PhysicsNet;
use paig::runs::checkpoint::SavedWeights;
use paig::support::device;
use paig::training::config::Config;
use paig::training::saved::load_model;

use crate::environment;

/// A run, a part of a dataset file, and where to compute.
#[derive(Debug, Args)]
pub struct ScoredRun {
    /// Run folder
    pub run: PathBuf,
    /// Dataset file [default: the run's test file]
    #[arg(long)]
    file: Option<PathBuf>,
    /// Folder of the datasets; not with --file [default: as the run had it]
    #[arg(long, value_name = "DIR", conflicts_with = "file")]
    data: Option<PathBuf>,
    /// Part of the file
    #[arg(long, default_value = "test", value_parser = Split::ALL.map(Split::name))]
    split: String,
    /// Weights of the last checkpoint, or those with the best validation score of the last phase
    #[arg(long, default_value = "last")]
    checkpoint: Weights,
    /// cpu, cuda or cuda:n
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Threads to compute with; 0 for one a core
    #[arg(long, default_value_t = 0)]
    threads: usize,
}

/// Which of a run's weights.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Weights {
    Last,
    Best,
}

impl From<Weights> for SavedWeights {
    fn from(weights: Weights) -> Self {
        match weights {
            Weights::Last => SavedWeights::Last,
            Weights::Best => SavedWeights::Best,
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
    /// Reads the run's last checkpoint and sets the number of threads. To be called first: it may start the program
    /// over.
    ///
    /// # Errors
    /// A GPU that is not there, a folder that holds no run or no checkpoint.
    pub fn open(&self) -> Result<ClipsOfRun> {
        environment::set();
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
}

/// Most runs of a sweep, and so most seeds.
pub const MOST_RUNS: usize = 100_000;

/// Seeds as people write them: `0-9`, `1,4,7-8`; each once.
///
/// # Errors
/// Anything else, a range that runs backwards, more than [`MOST_RUNS`].
pub fn parse_seeds(text: &str) -> Result<Vec<u64>> {
    let number = |text: &str| {
        let number = text.trim().parse::<u64>().ok();
        number
            .with_context(|| format!("--seeds: {text:?} is not a number from 0 on; seeds are given as 0-9 or 1,4,7-8"))
    };
    let (mut seeds, mut known) = (Vec::new(), HashSet::new());
    let mut add = |seed: u64, seeds: &mut Vec<u64>| seeds.extend(known.insert(seed).then_some(seed));
    for part in text.split(',') {
        match part.split_once('-') {
            None => add(number(part)?, &mut seeds),
            Some((first, last)) => {
                let (first, last) = (number(first)?, number(last)?);
                ensure!(first <= last, "--seeds: {part:?} runs backwards");
                let more = usize::try_from(last - first).unwrap_or(usize::MAX);
                ensure!(
                    more < MOST_RUNS - seeds.len().min(MOST_RUNS),
                    "--seeds {text:?}: more than {MOST_RUNS} seeds; give a part of them"
                );
                (first..=last).for_each(|seed| add(seed, &mut seeds));
            }
        }
    }
    Ok(seeds)
}
