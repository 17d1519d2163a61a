//! Configuration of a training: everything that decides what is learned, saved as `config.toml` in the run's folder.
//!
//! [`super::layers`] puts it together from recipe, task, file and command line. The keys of a phase stand beside it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use toml::Table;

use super::discover::Discover;
use super::identify::Identify;
use super::join::Join;
use super::layers::{self, ConfigLayers, Overrides};
use super::phase::Phase;
use super::pretrain::Pretrain;
use super::ranges::at_least_one;
use crate::datasets::iterators::Clips;
use crate::network::dynamics::DynamicsKind;
use crate::network::physics_models::ModelOptions;
use crate::runs::{config_file, metrics};
use crate::support::storage;
use crate::support::toml_values::leaves;
use crate::tasks::{self, Task};

/// Version of the file's form. Files of before it have none, and name their task instead of holding it.
const FORMAT: u32 = 1;
/// Steps of Gauss and Newton on the first state; a handful converge.
const MOST_REFINEMENT_STEPS: usize = 100;
/// Frames that a batch may have of however few clips: they are drawn with repetition.
const LEAST_FRAMES: usize = 1000;

/// A complete run: what, how, where. `T` is `()` while the other values are parsed apart from the task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config<T = Task> {
    /// Version of the file's form.
    #[serde(default)]
    pub format: u32,
    pub recipe: String,
    pub seed: u64,
    /// `cpu`, `cuda` or `cuda:n`.
    pub device: String,
    /// 0: one for each core.
    pub threads: usize,
    /// Physical parameters at the start, by symbol, lengths in true pixels. Where none is given: what an equation of text
    /// says, or 1 in the model's unit.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub start: BTreeMap<String, f64>,
    /// The whole task, so that a run's folder stands alone.
    #[serde(default)]
    pub task: T,
    pub data: Data,
    pub model: ModelOptions,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub discover: Option<Discover>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub identify: Option<Identify>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pretrain: Option<Pretrain>,
    pub join: Join,
    pub output: Output,
}

/// Where the data are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Data {
    pub folder: PathBuf,
    /// Relative to the folder; the task's own by default.
    pub train_file: PathBuf,
    pub test_file: PathBuf,
}

impl Data {
    pub fn train_path(&self) -> PathBuf {
        self.folder.join(&self.train_file)
    }

    pub fn test_path(&self) -> PathBuf {
        self.folder.join(&self.test_file)
    }
}

/// What is written, and how often.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Output {
    /// Steps from one line of the log to the next.
    pub print_every: u64,
    /// Steps from one checkpoint to the next.
    pub checkpoint_every: u64,
    /// Example pictures.
    pub examples: usize,
    /// Whether the course is also written for TensorBoard.
    #[serde(default)]
    pub tensorboard: bool,
}

impl Config {
    /// Merges task, recipe, the task's changes to the recipe, file and command line, in this order.
    ///
    /// # Errors
    /// An unreadable file, an unknown key, task or recipe, a value of the wrong type or out of range.
    pub fn load(file: Option<&Path>, overrides: &Overrides) -> Result<Config> {
        Self::of_layers(layers::load(file, overrides)?)
    }

    /// A config as it was saved in a run folder.
    ///
    /// # Errors
    /// A file that is missing or is not a complete config, a value out of range, a newer form.
    pub fn read(path: &Path) -> Result<Config> {
        let read = || {
            let mut table = config_file::parse(&storage::read_to_string(path)?)?;
            let task = Task::of_config(table.remove("task").context("missing field `task`")?)?;
            let config = parsed(table)?.with_task(task);
            ensure!(
                config.format <= FORMAT,
                "it has form {}; this program knows forms up to {FORMAT}: use a newer one",
                config.format
            );
            config.check()?;
            Ok::<_, anyhow::Error>(config)
        };
        read().with_context(|| format!("config {}", path.display()))
    }

    /// The whole config as TOML.
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(self).expect("a config is plain data")
    }

    /// The phases of the training, in order. Parameters are identified where there is an equation; a black box is trained on
    /// positions instead.
    pub fn phases(&self) -> Vec<&dyn Phase> {
        let discover = self.discover.as_ref().map(|phase| phase as &dyn Phase);
        let second = if self.model.dynamics == DynamicsKind::Physics {
            self.identify.as_ref().map(|phase| phase as &dyn Phase)
        } else {
            self.pretrain.as_ref().map(|phase| phase as &dyn Phase)
        };
        discover.into_iter().chain(second).chain([&self.join as &dyn Phase]).collect()
    }

    /// What differs from the plain recipe of this task, each as `section.key=value`, in the order of the keys. Seed,
    /// device, threads and the data's folder do not count.
    ///
    /// # Errors
    /// An unknown recipe.
    pub fn differences_from_recipe(&self) -> Result<Vec<String>> {
        let task = tasks::builtin(&self.task.name).unwrap_or_else(|| self.task.clone());
        let recipe = Some(self.recipe.clone());
        let plain =
            Config::load_task(task, None, &Overrides { recipe, seed: Some(self.seed), ..Overrides::default() })?;
        Ok(self.differences(&plain))
    }

    /// The config of a task that is at hand.
    ///
    /// # Errors
    /// As for [`Self::load`].
    pub fn load_task(task: Task, file: Option<&Path>, overrides: &Overrides) -> Result<Config> {
        Self::of_layers(layers::load_task(task, file, overrides)?)
    }

    fn of_layers(layers: ConfigLayers) -> Result<Config> {
        let ConfigLayers { task, merged, below } = layers;
        let config = parsed(merged).with_context(|| {
            let wrong = below.into_iter().find(|(_, table)| parsed(table.clone()).is_err());
            wrong.map_or("config, as the command line has it".to_string(), |(place, _)| place)
        })?;
        let config = config.with_task(task);
        config.check()?;
        Ok(Config { format: FORMAT, ..config })
    }

    /// The values that another config has not, each as `section.key=value`, in the order of the keys. Device, threads and
    /// the data's folder do not count, nor what a task says besides its system and its scene.
    pub fn differences(&self, other: &Config) -> Vec<String> {
        let values = |config: &Config| leaves(&Table::try_from(config).expect("a config is plain data"));
        let others = values(other);
        values(self)
            .into_iter()
            .filter(|(key, _)| layers::decides(key))
            .filter(|(key, value)| others.get(key) != Some(value))
            .map(|(key, value)| format!("{key}={value}"))
            .collect()
    }

    fn check(&self) -> Result<()> {
        for (key, count) in
            [("output.print_every", self.output.print_every), ("output.checkpoint_every", self.output.checkpoint_every)]
        {
            at_least_one(key, count)?;
        }
        let steps = self.model.refinement_steps;
        ensure!(
            steps <= MOST_REFINEMENT_STEPS,
            "config: model.refinement_steps = {steps}: at most {MOST_REFINEMENT_STEPS}, each rolls the system out once more"
        );
        self.check_parameters()?;
        self.join.check()?;
        self.discover.as_ref().map_or(Ok(()), Discover::check)?;
        self.pretrain.as_ref().map_or(Ok(()), Pretrain::check)?;
        self.identify.as_ref().map_or(Ok(()), |identify| identify.check(self.task.train_frames))
    }

    /// Whether so many clips suffice.
    ///
    /// # Errors
    /// A batch of more frames than there are.
    pub fn check_clips(&self, train: &Clips) -> Result<()> {
        let frames = train.len() * train.time();
        match &self.discover {
            Some(discover) if discover.frames > frames.max(LEAST_FRAMES) => {
                bail!("config: discover.frames = {}: the training clips have {frames} frames in all", discover.frames)
            }
            _ => Ok(()),
        }
    }

    /// The parameters, and those of them that are fixed or start elsewhere.
    fn check_parameters(&self) -> Result<()> {
        let parameters = self.task.system.cell.parameters;
        metrics::check_parameters(parameters).with_context(|| format!("task {}", self.task.name))?;
        let known: Vec<_> = parameters.iter().map(|p| p.name).collect();
        for (section, symbols) in [("start", &self.start), ("model.fixed", &self.model.fixed)] {
            for (symbol, value) in symbols {
                let parameter = parameters.iter().find(|parameter| parameter.name == symbol);
                let parameter = parameter.with_context(|| {
                    format!(
                        "config: {section}.{symbol}: task {} has no such parameter; it has {known:?}",
                        self.task.name
                    )
                })?;
                ensure!(
                    parameter.bounds.contain(*value),
                    "config: {section}.{symbol} = {value}: must be {}",
                    parameter.bounds
                );
            }
        }
        for parameter in parameters.iter().filter(|p| self.start.contains_key(p.name)) {
            ensure!(
                self.model.fixed_at(parameter).is_none(),
                "config: start.{0}: {0} is not learned but fixed (model.fixed)",
                parameter.name
            );
        }
        Ok(())
    }
}

/// The values of a config's table, which holds no task.
fn parsed(table: Table) -> Result<Config<()>, toml::de::Error> {
    table.try_into()
}

impl Config<()> {
    fn with_task(self, task: Task) -> Config {
        Config {
            format: self.format,
            recipe: self.recipe,
            seed: self.seed,
            device: self.device,
            threads: self.threads,
            start: self.start,
            task,
            data: self.data,
            model: self.model,
            discover: self.discover,
            identify: self.identify,
            pretrain: self.pretrain,
            join: self.join,
            output: self.output,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks;

    #[test]
    fn differences_from_the_recipe_are_what_was_set() {
        let load = |task: &str, recipe: &str, set: &[&str]| {
            let set = set.iter().map(|assignment| assignment.to_string()).collect();
            let (task, recipe) = (Some(task.to_string()), Some(recipe.to_string()));
            let seed = Some(7);
            let (threads, device, data) = (Some(3), Some("cuda".into()), Some("elsewhere".into()));
            Config::load(None, &Overrides { task, recipe, seed, device, threads, data, set }).unwrap()
        };
        // Every task has both recipes; what a task changes in one is part of it.
        for task in tasks::all() {
            for recipe in ["fast", "paper"] {
                assert_eq!(load(&task.name, recipe, &[]).differences_from_recipe().unwrap(), [""; 0]);
            }
        }
        let changed = [
            "data.test_file=\"other.npz\"",
            "discover.start.template_bump=0.0",
            "identify.horizons=[3, 12]",
            "join.learning_rate=0.0003",
            "join.optimizer=\"sgd\"",
            "model.exact_shift=false",
            "start.k=2.0",
            "task.system.pred_steps=5",
        ];
        let config = load("spring_color", "fast", &changed);
        assert_eq!(config.differences_from_recipe().unwrap(), changed);
        // Steps for epochs.
        let config = load("spring_color", "paper", &["join.max_steps=9"]);
        assert_eq!(config.differences_from_recipe().unwrap(), ["join.max_steps=9"]);
    }

    #[test]
    fn a_changed_task_brings_its_own_files() {
        let set = vec!["task.system.dt=0.2".to_string()];
        let task = Some("spring_color".to_string());
        let config = Config::load(None, &Overrides { task, set, ..Overrides::default() }).unwrap();
        assert_eq!(config.task.system.dt, 0.2);
        assert!(config.data.train_file.to_str().unwrap().contains("_dt02"), "{:?}", config.data);
    }
}
