//! What is compared, `configs/baselines.toml`.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use serde::Deserialize;

use super::end_to_end::config::EndToEndModel;
use paig::support::storage;
use paig::tasks::{self, Task};

/// Name of the runs that only find objects.
pub(super) const OBJECTS: &str = "objects";

/// The whole list.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Comparison {
    pub recipe: String,
    pub tasks: Vec<String>,
    pub seeds: Vec<u64>,
    pub clips: DatasetClips,
    pub search: RateSearch,
    pub efficiency: Efficiency,
    pub whole: EndToEndLength,
    pub models: Vec<BaselineEntry>,
}

/// Clips of a dataset.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DatasetClips {
    pub train: usize,
    pub valid: usize,
    pub test: usize,
}

/// How learning rates are chosen.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RateSearch {
    pub task: String,
    pub seed: u64,
    pub rates: Vec<f64>,
    /// Steps of an end-to-end baseline in the search.
    pub whole_steps: u64,
}

/// Trainings on fewer clips.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Efficiency {
    pub task: String,
    pub train: Vec<usize>,
    pub models: Vec<String>,
}

/// How long the end-to-end baselines are trained.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EndToEndLength {
    pub steps: u64,
    pub batch: usize,
    pub checkpoint_every: u64,
}

/// One model.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaselineEntry {
    /// In folders and results.
    pub name: String,
    /// In figures.
    pub label: String,
    /// What it changes in the recipe, `section.key=value`.
    #[serde(default)]
    pub set: Vec<String>,
    /// The key of its learning rate, if that is searched.
    #[serde(default)]
    pub rate: Option<String>,
    /// The rates that are tried; those of the search, if it has none of its own.
    #[serde(default)]
    pub rates: Option<Vec<f64>>,
    /// Of an end-to-end baseline, where the search has not found a better one.
    #[serde(default)]
    pub learning_rate: Option<f64>,
    /// Finds objects of its own instead of those that the others share.
    #[serde(default)]
    pub own_objects: bool,
    /// Steps of an end-to-end baseline on these tasks; those of `whole` on the others.
    #[serde(default)]
    pub steps: BTreeMap<String, u64>,
    /// Shown in a table of its own, too, beside the first model.
    #[serde(default)]
    pub ablation: bool,
    #[serde(default)]
    pub whole: Option<EndToEndModel>,
}

/// Refuses a list in which something stands twice.
fn once<T: PartialEq + Display>(what: &str, all: &[T]) -> Result<()> {
    match all.iter().enumerate().find(|(place, one)| all[..*place].contains(one)) {
        Some((_, twice)) => bail!("{what} {twice} stands there twice"),
        None => Ok(()),
    }
}

impl Comparison {
    /// # Errors
    /// A list that cannot be read, an unknown key, task or model, a name that stands twice.
    pub fn read(path: &Path) -> Result<Self> {
        let read = || -> Result<Self> {
            let list: Comparison = toml::from_str(&storage::read_to_string(path)?)?;
            list.check()?;
            Ok(list)
        };
        read().with_context(|| format!("comparison {}", path.display()))
    }

    fn check(&self) -> Result<()> {
        for task in self.tasks.iter().chain([&self.search.task, &self.efficiency.task]) {
            ensure!(!task.ends_with(".toml"), "task {task:?}: only built-in tasks are compared, by their names");
            tasks::find(task)?;
        }
        once("task", &self.tasks)?;
        once("seed", &self.seeds)?;
        let sound = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        once("model", &self.models.iter().map(|entry| &entry.name).collect::<Vec<_>>())?;
        for entry in &self.models {
            let BaselineEntry { name, .. } = entry;
            ensure!(!name.is_empty() && name.chars().all(sound), "model {name:?}: a-z, 0-9 and _ can stand in a name");
            ensure!(*name != OBJECTS, "model {name}: runs that find objects have this name; choose another");
            ensure!(
                entry.whole.is_some() == entry.learning_rate.is_some(),
                "model {name}: an end-to-end baseline has a learning_rate, and only such a one"
            );
            ensure!(
                entry.whole.is_none() || entry.set.is_empty(),
                "model {name}: an end-to-end baseline has no recipe to set"
            );
            ensure!(
                entry.whole.is_some() || entry.steps.is_empty(),
                "model {name}: steps stand in its recipe; they are given here for an end-to-end baseline"
            );
            if let Some(task) = entry.steps.keys().find(|task| !self.tasks.contains(task)) {
                bail!("model {name}: steps for {task:?}, which is not among the tasks");
            }
            ensure!(entry.steps.values().all(|steps| *steps > 0), "model {name}: steps must be at least 1");
            let mut rates = self.rates(entry).iter().chain(&entry.learning_rate);
            ensure!(
                rates.all(|rate| rate.is_finite() && *rate > 0.0),
                "model {name}: the learning rate must be positive, and all that are searched"
            );
        }
        let EndToEndLength { steps, batch, checkpoint_every } = self.whole;
        ensure!(
            steps > 0 && batch > 0 && checkpoint_every > 0 && self.search.whole_steps > 0,
            "whole.steps, whole.batch, whole.checkpoint_every and search.whole_steps must be at least 1"
        );
        self.efficiency.models.iter().try_for_each(|name| self.model(name).map(drop))?;
        let seed = self.search.seed;
        ensure!(!self.seeds.contains(&seed), "search.seed = {seed}: take one that is not among seeds");
        Ok(())
    }

    /// The learning rates that are tried for a model.
    pub fn rates<'a>(&'a self, entry: &'a BaselineEntry) -> &'a [f64] {
        entry.rates.as_ref().unwrap_or(&self.search.rates)
    }

    /// Steps of an end-to-end baseline in a training of the comparison.
    pub fn steps(&self, entry: &BaselineEntry, task: &str) -> u64 {
        entry.steps.get(task).copied().unwrap_or(self.whole.steps)
    }

    /// The list's seeds and these, each once.
    ///
    /// # Errors
    /// The seed of the search, whose runs are not among those that are compared.
    pub fn seeds_with(&self, others: &[u64]) -> Result<Vec<u64>> {
        let seed = self.search.seed;
        ensure!(!others.contains(&seed), "seed {seed} is that of the search of learning rates; take another one");
        let mut seeds = self.seeds.clone();
        seeds.extend(others);
        seeds.sort_unstable();
        seeds.dedup();
        Ok(seeds)
    }

    /// The model of this name.
    ///
    /// # Errors
    /// A name that the list lacks.
    pub fn model(&self, name: &str) -> Result<&BaselineEntry> {
        let known = || self.models.iter().map(|entry| entry.name.as_str()).collect::<Vec<_>>().join(", ");
        let found = self.models.iter().find(|entry| entry.name == name);
        found.with_context(|| format!("no model {name:?}; the models are {}", known()))
    }

    /// The tasks, in their order.
    ///
    /// # Errors
    /// An unknown task.
    pub fn all_tasks(&self) -> Result<Vec<Task>> {
        self.tasks.iter().map(|task| tasks::find(task)).collect()
    }
}
