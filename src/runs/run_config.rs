//! What a run's config says to readers of later versions.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use serde::Deserialize;
use toml::{Table, Value};

use super::config_file;
use crate::network::cells::PhysicalParameter;
use crate::support::storage;
use crate::support::toml_values::leaves;
use crate::tasks::{self, Task};

/// The config of a run, of whatever version of the program: what every version states, and the rest as text.
#[derive(Debug)]
pub struct RunConfig {
    pub task: Task,
    pub recipe: String,
    pub seed: u64,
    pub threads: usize,
    pub device: String,
    /// The values that decide what is learned, by their full key in TOML's notation.
    pub choices: BTreeMap<String, String>,
}

/// What a config of every version states.
#[derive(Deserialize)]
struct Circumstances {
    task: Value,
    recipe: String,
    seed: u64,
    threads: usize,
    device: String,
}

impl RunConfig {
    /// Reads a run folder's config.
    ///
    /// # Errors
    /// A file that cannot be read or lacks a key that every config has, an unknown task.
    pub fn read(path: &Path) -> Result<Self> {
        let parse = || {
            let table = config_file::parse(&storage::read_to_string(path)?)?;
            let choices = choices(&table);
            let Circumstances { task, recipe, seed, threads, device } = table.try_into()?;
            let task = Task::of_config(task)?;
            Ok::<_, anyhow::Error>(RunConfig { task, recipe, seed, threads, device, choices })
        };
        parse().with_context(|| format!("config {}", path.display()))
    }

    /// A number among the choices.
    pub fn number(&self, key: &str) -> Option<f64> {
        self.choices.get(key)?.parse().ok()
    }

    /// Whether a parameter is learned, not fixed.
    pub fn learns(&self, parameter: &PhysicalParameter) -> bool {
        let mut fixed = self.choices.keys().filter_map(|key| key.strip_prefix("model.fixed.")).peekable();
        match fixed.peek() {
            Some(_) => fixed.all(|name| name != parameter.name),
            None => parameter.fixed.is_none(),
        }
    }

    /// The folder of the datasets that a run learned from.
    pub fn data_folder(&self) -> Option<String> {
        let folder = self.choices.get("data.folder")?.parse::<Value>().ok()?;
        folder.as_str().map(String::from)
    }

    /// Where the files are that a run learned from and was scored on, in TOML's notation.
    pub(crate) fn data_files(&self) -> [Option<&String>; 3] {
        ["data.folder", "data.train_file", "data.test_file"].map(|key| self.choices.get(key))
    }
}

/// A config's values without seed, machine and what is written down. Where the data lie counts: other data, other runs.
/// Of a task only what differs from the built-in one of its name, in its system and its scene.
pub fn choices(table: &Table) -> BTreeMap<String, String> {
    let mut all = leaves(table);
    let circumstances = ["format", "task", "recipe", "seed", "threads", "device"];
    all.retain(|key, _| !circumstances.contains(&key.as_str()) && !key.starts_with("output."));
    let name = table.get("task").and_then(|task| task.get("name")?.as_str());
    let usual = name.and_then(tasks::builtin).map(|task| leaves(&task.to_table())).unwrap_or_default();
    all.retain(|key, value| match key.strip_prefix("task.") {
        Some(key) => (key.starts_with("system.") || key.starts_with("scene.")) && usual.get(key) != Some(value),
        None => true,
    });
    all
}
