//! The scenes of the suite, `configs/stress.toml`, and the runs that are made of them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde::Deserialize;
use toml::Table;

use crate::sweep::SweepPlan;
use paig::datasets::settings::Counts;
use paig::generators::DatasetJob;
use paig::generators::source_images::SourceImages;
use paig::generators::variant::Variant;
use paig::runs::run::StoredRun;
use paig::support::storage;
use paig::tasks::{self, Task};

/// The recipe of every run; no key is changed for a scene.
const RECIPE: &str = "fast";

/// Clips of a dataset where a scene says nothing else.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct ClipCounts {
    train: usize,
    valid: usize,
    test: usize,
}

/// One line of the list.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct SuiteEntry {
    plain: String,
    train: Option<usize>,
    valid: Option<usize>,
    #[serde(default)]
    nine: bool,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SuiteFile {
    clips: ClipCounts,
    scenes: Table,
}

/// A scene of the suite.
#[derive(Debug, Clone)]
pub struct SuiteScene {
    pub name: String,
    /// The task with the same motion on a plain scene, whose limits of success count.
    pub plain: Task,
    /// The task, and its file.
    pub task: Task,
    pub file: PathBuf,
    pub clips: Counts,
    /// Whether each dataset is learned with three seeds.
    pub nine: bool,
}

/// All scenes, in the order of their names.
#[derive(Debug)]
pub struct StressList {
    pub scenes: Vec<SuiteScene>,
}

/// Seed of a dataset.
pub type DataSeed = u64;

impl StressList {
    /// Reads the list; the scenes' files lie in a folder of its name beside it.
    ///
    /// # Errors
    /// A list that cannot be read, an unknown key or task, a plain task without limits of success.
    pub fn read(path: &Path) -> Result<Self> {
        let read = || -> Result<Self> {
            let SuiteFile { clips, scenes } = toml::from_str(&storage::read_to_string(path)?)?;
            let scene = |(name, entry): (String, toml::Value)| -> Result<SuiteScene> {
                let SuiteEntry { plain, train, valid, nine } = entry.try_into().with_context(|| name.clone())?;
                let file = path.with_extension("").join(format!("{name}.toml"));
                ensure!(file.exists(), "{name}: {} is missing", file.display());
                let clips = Counts {
                    train: train.unwrap_or(clips.train),
                    valid: valid.unwrap_or(clips.valid),
                    test: clips.test,
                };
                let task = tasks::find(&file.to_string_lossy())?;
                let plain = tasks::find(&plain)?;
                ensure!(
                    !plain.success.is_empty(),
                    "{name}: its plain task {:?} has no [success] to judge by",
                    plain.name
                );
                Ok(SuiteScene { plain, name, task, file, clips, nine })
            };
            Ok(StressList { scenes: scenes.into_iter().map(scene).collect::<Result<_>>()? })
        };
        read().with_context(|| format!("list of scenes {}", path.display()))
    }

    /// The scenes of these names; all for none.
    ///
    /// # Errors
    /// A name that the list lacks.
    pub fn of_names(&self, names: &[String]) -> Result<Vec<&SuiteScene>> {
        let known: Vec<&str> = self.scenes.iter().map(|scene| scene.name.as_str()).collect();
        for name in names {
            ensure!(known.contains(&name.as_str()), "no scene {name:?}; the scenes are {}", known.join(", "));
        }
        Ok(self.scenes.iter().filter(|scene| names.is_empty() || names.contains(&scene.name)).collect())
    }

    /// How many scenes there are of each plain task.
    pub fn systems(&self) -> BTreeMap<&str, usize> {
        let mut systems = BTreeMap::new();
        self.scenes.iter().for_each(|scene| *systems.entry(scene.plain.name.as_str()).or_default() += 1);
        systems
    }
}

impl SuiteScene {
    /// How its dataset of a seed is made, in `data/seed=N`.
    ///
    /// # Errors
    /// A scene that cannot be drawn.
    pub fn dataset(&self, data: &Path, seed: DataSeed) -> Result<DatasetJob> {
        let variant = Variant::new(&self.task, seed)?;
        let images = SourceImages::of(&variant)?;
        Ok(DatasetJob { images, variant, counts: self.clips, folder: data_folder(data, seed), force: false })
    }

    /// The training seeds of a dataset: its own, and for some scenes two more.
    pub fn seeds(&self, data_seed: DataSeed) -> Vec<u64> {
        if self.nine { vec![data_seed, data_seed + 100, data_seed + 200] } else { vec![data_seed] }
    }

    /// Its runs on the dataset of a seed, in `runs/seed=N`.
    pub fn plan(&self, data: &Path, runs: &Path, data_seed: DataSeed, threads: usize) -> SweepPlan {
        SweepPlan {
            tasks: vec![self.file.to_string_lossy().into_owned()],
            seeds: self.seeds(data_seed),
            recipe: RECIPE.into(),
            name: None,
            config: None,
            set: Vec::new(),
            data: Some(data_folder(data, data_seed)),
            device: None,
            threads,
            out: run_folder(runs, data_seed),
        }
    }

    /// The runs that were begun on the dataset of a seed, each with its own seed: what its folder tells, or why it cannot
    /// be read.
    ///
    /// # Errors
    /// A scene file that is no task any more.
    pub fn runs(&self, data: &Path, runs: &Path, data_seed: DataSeed) -> Result<Vec<(u64, Result<StoredRun>)>> {
        let jobs = self.plan(data, runs, data_seed, 1).jobs()?;
        let begun = jobs.into_iter().filter(|job| job.folder.exists());
        Ok(begun.map(|job| (job.seed, StoredRun::read(&job.folder))).collect())
    }
}

fn data_folder(data: &Path, seed: DataSeed) -> PathBuf {
    data.join(format!("seed={seed}"))
}

/// Where the runs on the datasets of a seed are.
fn run_folder(runs: &Path, seed: DataSeed) -> PathBuf {
    runs.join(format!("data={seed}"))
}
