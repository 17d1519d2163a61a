//! What a run's config says.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use toml::{Table, Value};

use crate::network::cells::PhysicalParameter;
use crate::tasks::{self, Task};
use crate::training::config::{Config, Overrides, leaves};

/// The config of a run, of whatever version of the program: only what the report needs is asked for.
#[derive(Debug)]
pub(super) struct RunConfig {
    pub task: &'static Task,
    pub recipe: String,
    pub seed: u64,
    pub threads: usize,
    pub device: String,
    /// The values that decide what is learned, by their full key in TOML's notation.
    pub choices: BTreeMap<String, String>,
}

impl RunConfig {
    /// Reads a run folder's config.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| format!("config {}", path.display()))?;
        let parse = || {
            let table: Table = text.parse()?;
            let text = |key: &str| table.get(key).and_then(Value::as_str).with_context(|| format!("no {key}"));
            let number = |key: &str| table.get(key).and_then(Value::as_integer).with_context(|| format!("no {key}"));
            Ok::<_, anyhow::Error>(RunConfig {
                task: tasks::find(text("task")?)?,
                recipe: text("recipe")?.into(),
                seed: number("seed")?.try_into()?,
                threads: number("threads")?.try_into()?,
                device: text("device")?.into(),
                choices: choices(&table),
            })
        };
        parse().with_context(|| format!("config {}", path.display()))
    }

    /// What differs from the recipe as this version has it, as `section.key=value`.
    pub(super) fn changes(&self) -> Vec<String> {
        // A recipe of another version may be unknown here: then everything is stated.
        let recipe = self.said(&[]).unwrap_or_default();
        let changed = self.choices.iter().filter(|(key, value)| recipe.get(*key) != Some(value));
        changed.map(|(key, value)| format!("{key}={value}")).collect()
    }

    /// The choices that task, recipe and assignments make in this version.
    pub(super) fn said(&self, set: &[String]) -> Option<BTreeMap<String, String>> {
        let (task, recipe) = (Some(self.task.key.to_string()), Some(self.recipe.clone()));
        let config = Config::load(None, &Overrides { task, recipe, set: set.to_vec(), ..Overrides::default() }).ok()?;
        Some(choices(&Table::try_from(&config).expect("a config is plain data")))
    }

    /// A number among the choices.
    pub(super) fn number(&self, key: &str) -> Option<f64> {
        self.choices.get(key)?.parse().ok()
    }

    /// Whether a parameter is learned, not held.
    pub(super) fn learns(&self, parameter: &PhysicalParameter) -> bool {
        let mut held = self.choices.keys().filter_map(|key| key.strip_prefix("model.hold.")).peekable();
        match held.peek() {
            Some(_) => held.all(|name| name != parameter.name),
            None => parameter.held.is_none(),
        }
    }

    /// Where the files are that a run learned from and was scored on, in TOML's notation.
    pub(super) fn data_files(&self) -> [Option<&String>; 3] {
        ["data.folder", "data.train_file", "data.test_file"].map(|key| self.choices.get(key))
    }
}

/// A config's values without seed, machine and what is written down. Where the data lie counts: other data, other runs.
fn choices(table: &Table) -> BTreeMap<String, String> {
    let mut all = leaves(table);
    let circumstances = ["task", "recipe", "seed", "threads", "device"];
    all.retain(|key, _| !circumstances.contains(&key.as_str()) && !key.starts_with("output."));
    all
}
