//! Configuration: a recipe, under a file, under the command line. Unknown keys are refused at every layer.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::network::physics_models::ModelOptions;
use crate::tasks::{self, Task};
use crate::training::optimizers::Rule;
use crate::training::schedule::Schedule;

/// The recipes that come with the program, by name.
const RECIPES: &[(&str, &str)] =
    &[("fast", include_str!("../../configs/fast.toml")), ("paper", include_str!("../../configs/paper.toml"))];

/// What a task changes in a recipe: task, recipe, text.
const TASK_RECIPES: &[(&str, &str, &str)] = &[
    ("mnist_spring_color", "fast", include_str!("../../configs/mnist_spring_color/fast.toml")),
    ("pendulum", "fast", include_str!("../../configs/pendulum/fast.toml")),
];

/// A complete run: what, how, where. Saved as `config.toml` in the run folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    pub task: String,
    pub recipe: String,
    pub seed: u64,
    /// `cpu`, `cuda` or `cuda:n`.
    pub device: String,
    /// 0: one for each core.
    pub threads: usize,
    pub data: Data,
    pub model: ModelOptions,
    /// Physical parameters at the start, by symbol, lengths in true pixels; 1 in the model's unit where none is given.
    #[serde(default)]
    pub start: BTreeMap<String, f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub discover: Option<Discover>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub identify: Option<Identify>,
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

/// Finding the objects: autoencoder loss on random single frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Discover {
    pub optimizer: Rule,
    pub learning_rate: f64,
    /// Limit of a gradient's elements; 0 is none.
    pub clip: f64,
    /// Frames in a step.
    pub frames: usize,
    pub max_steps: u64,
    pub schedule: Schedule,
    pub start: DiscoverStart,
    pub guide: Guide,
}

/// Initial values that let every object be found. 0 or false switches one off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiscoverStart {
    pub median_background: bool,
    pub template_bump: f64,
    pub localiser_scale: f64,
    pub mask_spread: f64,
}

/// Weights of the guides on the encoder's masks (see [`crate::training::guide`]). 0 switches one off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guide {
    pub temperature: f64,
    pub coverage: f64,
    pub compactness: f64,
    pub balance: f64,
    pub colour: f64,
    pub tie: f64,
    pub full_until: u64,
    pub zero_from: u64,
}

/// Fitting parameters and template offsets to encoded trajectories.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identify {
    pub clips: usize,
    /// Frames of a clip that are fitted, growing.
    pub horizons: Vec<usize>,
    pub max_iterations: usize,
    /// Pixels.
    pub huber: f64,
    /// Re-centre the templates when an offset is larger than this many pixels; 0 never does.
    pub recentre_above: f64,
    /// Steps on the velocity estimator, towards the fitted trajectories' velocities. A config without it means none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub velocity_steps: u64,
}

/// Training everything together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Join {
    pub optimizer: Rule,
    /// Rate of the networks; the task's `base_lr` by default.
    pub learning_rate: f64,
    /// Rate of the physical parameters; that of the networks by default.
    pub physics_learning_rate: f64,
    pub clip: f64,
    /// Weight of L_rec; the task's by default.
    pub alpha: f64,
    /// Clips in a step.
    pub batch: usize,
    /// Either a number of steps or of passes over the training set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_steps: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub epochs: Option<u64>,
    pub schedule: Schedule,
    /// Weight of the smooth-L1 between rolled-out and encoded positions.
    pub latent: f64,
    /// Weight of the smooth-L1 between estimated and refined velocities.
    pub velocity: f64,
    /// Clips of the validation split that are scored; all if there are fewer.
    pub validation_clips: usize,
}

/// What is written, and how often.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Output {
    pub print_every: u64,
    pub checkpoint_every: u64,
    pub examples: usize,
}

/// What the command line says on top of the files.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Overrides {
    pub task: Option<String>,
    pub recipe: Option<String>,
    pub seed: Option<u64>,
    pub device: Option<String>,
    pub threads: Option<usize>,
    pub data: Option<PathBuf>,
    /// `section.key=value` in TOML's notation.
    pub set: Vec<String>,
}

impl Config {
    /// Merges task, recipe, the task's changes to the recipe, file and command line, in this order.
    ///
    /// # Errors
    /// An unreadable file, an unknown key, task or recipe, a value of the wrong type or out of range.
    pub fn load(file: Option<&Path>, overrides: &Overrides) -> Result<Config> {
        let file_layer = match file {
            Some(path) => {
                let text = std::fs::read_to_string(path).with_context(|| format!("config {}", path.display()))?;
                parse_layer(&text).with_context(|| format!("config {}", path.display()))?
            }
            None => Table::new(),
        };
        let command_line = command_line_layer(overrides)?;
        let said = |key: &str| command_line.get(key).or(file_layer.get(key)).and_then(Value::as_str).map(String::from);
        if let (Some(asked), Some(Value::String(of_file))) = (said("task"), file_layer.get("task")) {
            ensure!(asked == *of_file, "config: the file is for task {of_file}, not for {asked}");
        }
        let task = tasks::find(&said("task").context("no task given; use --task, or `task = \"..\"` in the config")?)?;
        let recipe = said("recipe").unwrap_or_else(|| "fast".into());
        let Some((_, recipe_text)) = RECIPES.iter().find(|(name, _)| *name == recipe) else {
            let names: Vec<_> = RECIPES.iter().map(|(name, _)| *name).collect();
            bail!("unknown recipe {recipe:?}; the recipes are {}", names.join(", "));
        };
        let mut merged = task_layer(task);
        merge(&mut merged, parse_layer(recipe_text).expect("the recipes that come with the program are sound"));
        for (_, _, text) in TASK_RECIPES.iter().filter(|(key, name, _)| *key == task.key && *name == recipe) {
            merge(&mut merged, parse_layer(text).expect("the recipes that come with the program are sound"));
        }
        merge(&mut merged, file_layer);
        let of_file = merged.clone();
        merge(&mut merged, command_line);
        let config: Config = Value::Table(merged).try_into().with_context(|| match file {
            Some(path) if Value::Table(of_file).try_into::<Config>().is_err() => format!("config {}", path.display()),
            _ => "config, as the command line has it".to_string(),
        })?;
        config.check(task)?;
        Ok(config)
    }

    /// A config as it was saved in a run folder.
    ///
    /// # Errors
    /// A file that is missing or is not a complete config, a value out of range.
    pub fn read(path: &Path) -> Result<Config> {
        let read = || {
            let config: Config = toml::from_str(&std::fs::read_to_string(path)?)?;
            config.check(config.task()?)?;
            Ok::<_, anyhow::Error>(config)
        };
        read().with_context(|| format!("config {}", path.display()))
    }

    /// The whole config as TOML.
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(self).expect("a config is plain data")
    }

    /// What differs from the plain recipe of this task, each as `section.key=value`, in the order of the keys. Seed,
    /// device, threads and the data's folder do not count.
    ///
    /// # Errors
    /// An unknown task or recipe.
    pub fn differences_from_recipe(&self) -> Result<Vec<String>> {
        let (task, recipe) = (Some(self.task.clone()), Some(self.recipe.clone()));
        let seed = Some(self.seed);
        Ok(self.differences(&Config::load(None, &Overrides { task, recipe, seed, ..Overrides::default() })?))
    }

    /// The values that another config has not, each as `section.key=value`, in the order of the keys. Device, threads and
    /// the data's folder do not count.
    pub fn differences(&self, other: &Config) -> Vec<String> {
        let values = |config: &Config| leaves(&Table::try_from(config).expect("a config is plain data"));
        let others = values(other);
        values(self)
            .into_iter()
            .filter(|(key, _)| !["device", "threads", "data.folder"].contains(&key.as_str()))
            .filter(|(key, value)| others.get(key) != Some(value))
            .map(|(key, value)| format!("{key}={value}"))
            .collect()
    }

    /// The row of the task table.
    ///
    /// # Errors
    /// An unknown key.
    pub fn task(&self) -> Result<&'static Task> {
        tasks::find(&self.task)
    }

    fn check(&self, task: &Task) -> Result<()> {
        let join = &self.join;
        ensure!(
            join.max_steps.is_some() != join.epochs.is_some(),
            "config: join needs either max_steps or epochs, not both and not neither"
        );
        for (key, count) in [
            ("join.batch", join.batch as u64),
            ("join.validation_clips", join.validation_clips as u64),
            ("output.print_every", self.output.print_every),
            ("output.checkpoint_every", self.output.checkpoint_every),
        ] {
            at_least_one(key, count)?;
        }
        for (key, number) in [
            ("join.learning_rate", join.learning_rate),
            ("join.physics_learning_rate", join.physics_learning_rate),
            ("join.clip", join.clip),
            ("join.alpha", join.alpha),
            ("join.latent", join.latent),
            ("join.velocity", join.velocity),
        ] {
            not_negative(key, number)?;
        }
        join.schedule.check().context("config: join.schedule")?;
        self.check_parameters(task)?;
        if let Some(discover) = &self.discover {
            discover.check()?;
        }
        if let Some(identify) = &self.identify {
            identify.check(task)?;
        }
        Ok(())
    }

    /// The parameters that are held or start elsewhere.
    fn check_parameters(&self, task: &Task) -> Result<()> {
        let known: Vec<_> = task.cell.parameters.iter().map(|p| p.name).collect();
        for (section, symbols) in [("start", &self.start), ("model.hold", &self.model.hold)] {
            for (symbol, value) in symbols {
                ensure!(
                    known.contains(&symbol.as_str()),
                    "config: {section}.{symbol}: task {} has no such parameter; it has {known:?}",
                    task.key
                );
                ensure!(
                    value.is_finite() && *value > 0.0,
                    "config: {section}.{symbol} = {value}: must be a positive number"
                );
            }
        }
        for parameter in task.cell.parameters.iter().filter(|p| self.start.contains_key(p.name)) {
            ensure!(
                self.model.held(parameter).is_none(),
                "config: start.{0}: {0} is not learned but held (model.hold)",
                parameter.name
            );
        }
        Ok(())
    }
}

impl Discover {
    fn check(&self) -> Result<()> {
        at_least_one("discover.frames", self.frames as u64)?;
        let Guide { temperature, coverage, compactness, balance, colour, tie, full_until, zero_from } = self.guide;
        for (key, number) in [
            ("discover.learning_rate", self.learning_rate),
            ("discover.clip", self.clip),
            ("discover.start.template_bump", self.start.template_bump),
            ("discover.start.localiser_scale", self.start.localiser_scale),
            ("discover.start.mask_spread", self.start.mask_spread),
            ("discover.guide.coverage", coverage),
            ("discover.guide.compactness", compactness),
            ("discover.guide.balance", balance),
            ("discover.guide.colour", colour),
            ("discover.guide.tie", tie),
        ] {
            not_negative(key, number)?;
        }
        ensure!(temperature > 0.0, "config: discover.guide.temperature = {temperature}: must be positive");
        ensure!(
            full_until <= zero_from,
            "config: discover.guide.full_until = {full_until} must not come after zero_from = {zero_from}"
        );
        self.schedule.check().context("config: discover.schedule")
    }
}

impl Identify {
    fn check(&self, task: &Task) -> Result<()> {
        at_least_one("identify.clips", self.clips as u64)?;
        ensure!(self.huber > 0.0, "config: identify.huber = {}: must be positive", self.huber);
        not_negative("identify.recentre_above", self.recentre_above)?;
        ensure!(
            !self.horizons.is_empty() && self.horizons.iter().all(|&h| h >= 3 && h <= task.train_frames),
            "config: identify.horizons = {:?}: there must be at least one, and each between 3 and the clip length {}",
            self.horizons,
            task.train_frames
        );
        Ok(())
    }
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

fn at_least_one(key: &str, count: u64) -> Result<()> {
    ensure!(count > 0, "config: {key} must be at least 1");
    Ok(())
}

fn not_negative(key: &str, number: f64) -> Result<()> {
    ensure!(number.is_finite() && number >= 0.0, "config: {key} = {number}: must be 0 or a positive number");
    Ok(())
}

/// What the command line says, its options above its `--set`.
fn command_line_layer(overrides: &Overrides) -> Result<Table> {
    let mut layer = Table::new();
    for assignment in &overrides.set {
        merge(&mut layer, parse_assignment(assignment)?);
    }
    let integer = |name: &str, value: u64| {
        i64::try_from(value).with_context(|| format!("--{name} {value}: must be at most {}", i64::MAX))
    };
    let options = [
        ("task", overrides.task.clone().map(Value::from)),
        ("recipe", overrides.recipe.clone().map(Value::from)),
        ("seed", overrides.seed.map(|seed| integer("seed", seed)).transpose()?.map(Value::from)),
        ("device", overrides.device.clone().map(Value::from)),
        ("threads", overrides.threads.map(|n| integer("threads", n as u64)).transpose()?.map(Value::from)),
    ];
    for (key, value) in options.into_iter().filter_map(|(key, value)| Some((key, value?))) {
        if let Some(other) = layer.get(key).filter(|other| **other != value) {
            bail!("--set {key}={other} contradicts {key} {value}, which is given, too");
        }
        layer.insert(key.into(), value);
    }
    if let Some(folder) = &overrides.data {
        let folder = folder.to_str().with_context(|| format!("data folder {}: not UTF-8", folder.display()))?;
        let data = Table::from_iter([("folder".to_string(), Value::from(folder))]);
        merge(&mut layer, Table::from_iter([("data".to_string(), Value::Table(data))]));
    }
    Ok(layer)
}

/// What a task contributes: its files and the paper's rates, below the recipe.
fn task_layer(task: &Task) -> Table {
    let text = format!(
        "task = {:?}\nseed = 0\ndevice = \"cpu\"\nthreads = 0\n\
         [data]\nfolder = \"data/datasets\"\ntrain_file = {:?}\ntest_file = {:?}\n\
         [join]\nlearning_rate = {lr}\nphysics_learning_rate = {lr}\nalpha = {:?}\n",
        task.key,
        task.train_file,
        task.test_file,
        task.alpha,
        lr = toml::Value::from(task.base_lr),
    );
    parse_layer(&text).expect("the task table makes a sound layer")
}

fn parse_layer(text: &str) -> Result<Table> {
    Ok(text.parse::<Table>()?)
}

/// `a.b=value` as a layer; a value that is no TOML is taken as a string.
fn parse_assignment(assignment: &str) -> Result<Table> {
    let (key, value) = assignment
        .split_once('=')
        .with_context(|| format!("--set {assignment:?}: expected key=value, for example join.batch=50"))?;
    let (key, value) = (key.trim(), value.trim());
    format!("{key} = {value}")
        .parse::<Table>()
        .or_else(|_| format!("{key} = {value:?}").parse::<Table>())
        .with_context(|| format!("--set {assignment:?}"))
}

/// All values by their full key, in TOML's notation.
pub(crate) fn leaves(table: &Table) -> BTreeMap<String, String> {
    fn walk(table: &Table, prefix: &str, leaves: &mut BTreeMap<String, String>) {
        for (key, value) in table {
            let key = format!("{prefix}{key}");
            match value {
                Value::Table(below) => walk(below, &format!("{key}."), leaves),
                value => drop(leaves.insert(key, value.to_string())),
            }
        }
    }
    let mut all = BTreeMap::new();
    walk(table, "", &mut all);
    all
}

/// Lays `over` on `base`: tables are merged, everything else is replaced.
fn merge(base: &mut Table, over: Table) {
    // A length in steps replaces one in epochs and the other way round.
    for (given, other) in [("max_steps", "epochs"), ("epochs", "max_steps")] {
        if let (Some(Value::Table(join)), Some(Value::Table(above))) = (base.get_mut("join"), over.get("join"))
            && above.contains_key(given)
        {
            join.remove(other);
        }
    }
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => merge(below, above),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        for task in tasks::TASKS {
            for (recipe, _) in RECIPES {
                assert_eq!(load(task.key, recipe, &[]).differences_from_recipe().unwrap(), [""; 0]);
            }
        }
        let changed = [
            "data.test_file=\"other.npz\"",
            "discover.start.template_bump=0.0",
            "identify.horizons=[3, 12]",
            "join.learning_rate=0.0001",
            "join.optimizer=\"sgd\"",
            "model.exact_shift=false",
            "start.k=2.0",
        ];
        let config = load("spring_color", "fast", &changed);
        assert_eq!(config.differences_from_recipe().unwrap(), changed);
        // Steps for epochs.
        let config = load("spring_color", "paper", &["join.max_steps=9"]);
        assert_eq!(config.differences_from_recipe().unwrap(), ["join.max_steps=9"]);
    }
}
