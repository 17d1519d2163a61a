//! How a config is put together: the task's values, a recipe, the task's changes to it, a file, the command line, each
//! over the one before. Unknown keys are refused at every layer.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use toml::{Table, Value};

use crate::network::cells::Equations;
use crate::runs::config_file;
use crate::support::storage;
use crate::support::toml_values::quoted;
use crate::tasks::{self, Task, TaskSource, folder_of};

/// The recipes that come with the program, by name.
const RECIPES: &[(&str, &str)] =
    &[("fast", include_str!("../../configs/fast.toml")), ("paper", include_str!("../../configs/paper.toml"))];

/// What the command line says on top of the files.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Overrides {
    /// Name of a built-in task, or a task file.
    pub task: Option<String>,
    pub recipe: Option<String>,
    pub seed: Option<u64>,
    pub device: Option<String>,
    pub threads: Option<usize>,
    pub data: Option<PathBuf>,
    /// `section.key=value` in TOML's notation.
    pub set: Vec<String>,
}

/// All layers in one table, apart from the task, which is parsed.
#[derive(Debug)]
pub struct ConfigLayers {
    pub task: Task,
    pub merged: Table,
    /// Where each layer below the command line comes from, and the table up to it: tells where a wrong value stands.
    pub below: Vec<(String, Table)>,
}

/// Recipe, task, file and command line; the task is the one that file or command line name.
///
/// # Errors
/// An unreadable file, an unknown task or recipe, an assignment that is no TOML.
pub(crate) fn load(file: Option<&Path>, overrides: &Overrides) -> Result<ConfigLayers> {
    let GivenLayers { file: file_layer, command_line } = GivenLayers::read(file, overrides)?;
    check_task(&file_layer.task, || command_line.task.name())?;
    let changes = [file_layer.task.changes, command_line.task.changes];
    let source = command_line.task.named.or(file_layer.task.named);
    let task = task(source.as_ref(), changes)?;
    let folder = source.as_ref().and_then(|source| folder_of(source.named()));
    merged(task, folder, [file_layer.values, command_line.values], file)
}

/// The same for a task that is at hand.
///
/// # Errors
/// As for [`load`]; a file that is for another task.
pub(crate) fn load_task(task: Task, file: Option<&Path>, overrides: &Overrides) -> Result<ConfigLayers> {
    let GivenLayers { file: file_layer, command_line } = GivenLayers::read(file, overrides)?;
    check_task(&file_layer.task, || Ok(Some(task.name.clone())))?;
    let changes = [file_layer.task.changes, command_line.task.changes];
    let task = if changes.iter().all(Table::is_empty) {
        task
    } else {
        changed(task.to_table(), changes, &Equations::default().with(&task.system.cell)?)?
    };
    merged(task, None, [file_layer.values, command_line.values], file)
}

/// What is given on top of recipe and task.
struct GivenLayers {
    file: ConfigLayer,
    command_line: ConfigLayer,
}

impl GivenLayers {
    fn read(file: Option<&Path>, overrides: &Overrides) -> Result<Self> {
        let mut command_line = ConfigLayer::of(command_line_values(overrides)?)?;
        if let Some(task) = &overrides.task {
            command_line.task.name_by_option(task)?;
        }
        Ok(GivenLayers { file: ConfigLayer::of(file_values(file)?)?, command_line })
    }
}

/// A config file or the command line: what it says of the task, and the other values.
struct ConfigLayer {
    task: TaskLayer,
    values: Table,
}

impl ConfigLayer {
    fn of(mut values: Table) -> Result<Self> {
        let task = match values.remove("task") {
            None => TaskLayer::default(),
            Some(Value::String(named)) => TaskLayer { named: Some(TaskSource::find(&named)?), changes: Table::new() },
            Some(Value::Table(changes)) => TaskLayer { named: None, changes },
            Some(other) => bail!("config: task = {other}: expected the name of a task, its file, or a table"),
        };
        Ok(ConfigLayer { task, values })
    }
}

/// What a layer says of the task: which it is, or what is changed in it. A config file may hold a whole task.
#[derive(Default)]
struct TaskLayer {
    named: Option<TaskSource>,
    changes: Table,
}

impl TaskLayer {
    /// `--task`, beside what `--set` says.
    fn name_by_option(&mut self, task: &str) -> Result<()> {
        if let Some(other) = self.named.as_ref().map(TaskSource::named).filter(|other| *other != task) {
            bail!("--set task={} contradicts task {}, which is given, too", quoted(other), quoted(task));
        }
        self.named = Some(TaskSource::find(task)?);
        Ok(())
    }

    /// The task's name, as far as this layer says it.
    fn name(&self) -> Result<Option<String>> {
        let named = || self.named.as_ref().map_or(Ok(None), TaskSource::name);
        tasks::name_in(&self.changes).map_or_else(named, |name| Ok(Some(name.into())))
    }
}

/// A config file is for one task.
fn check_task(file: &TaskLayer, asked: impl FnOnce() -> Result<Option<String>>) -> Result<()> {
    let Some(of_file) = file.name()? else { return Ok(()) };
    let asked = asked()?.unwrap_or_else(|| of_file.clone());
    ensure!(of_file == asked, "config: the file is for task {of_file}, not for {asked}");
    Ok(())
}

/// The task that is named, or that the file holds, with what the layers change in it.
fn task(source: Option<&TaskSource>, changes: [Table; 2]) -> Result<Task> {
    let unchanged = changes.iter().all(Table::is_empty);
    match source {
        None if unchanged => bail!("no task given; use --task, or `task = \"..\"` in the config"),
        None => changed(Table::new(), changes, &Equations::default()),
        Some(source) if unchanged => source.task(),
        Some(source) => changed(source.table()?, changes, &Equations::default()).or_else(|error| {
            // What is wrong in the task's own file is reported with its line.
            source.task()?;
            Err(error)
        }),
    }
}

/// `known` are the equations that have names.
fn changed(mut task: Table, changes: [Table; 2], known: &Equations) -> Result<Task> {
    changes.into_iter().for_each(|changes| merge(&mut task, changes));
    Task::from_table(task, known).context("config: task")
}

/// Where datasets lie if nothing is said of it.
pub const USUAL_DATA: &str = "data/datasets";

/// The folder of a task's datasets where nobody names another. `named`: the task's name or its file.
pub fn usual_data_folder<'a>(task: &Task, named: &'a str) -> &'a str {
    data_folder(task, folder_of(named))
}

/// The same; `folder` is where the task's file lies, if it is one.
fn data_folder<'a>(task: &Task, folder: Option<&'a str>) -> &'a str {
    folder.filter(|_| task.data_lie_beside()).unwrap_or(USUAL_DATA)
}

fn file_values(file: Option<&Path>) -> Result<Table> {
    let Some(path) = file else { return Ok(Table::new()) };
    let read = || config_file::parse(&storage::read_to_string(path)?);
    read().with_context(|| format!("config {}", path.display()))
}

/// `folder` is where the task's file lies, if it is one; `given` are config file and command line.
fn merged(task: Task, folder: Option<&str>, given: [Table; 2], file: Option<&Path>) -> Result<ConfigLayers> {
    let recipe = given.iter().rev().find_map(|layer| layer.get("recipe")).and_then(Value::as_str);
    let recipe = recipe.unwrap_or("fast").to_string();
    let names: Vec<_> = RECIPES.iter().map(|(name, _)| *name).collect();
    let Some((_, recipe_text)) = RECIPES.iter().find(|(name, _)| *name == recipe) else {
        bail!("unknown recipe {recipe:?}; the recipes are {}", names.join(", "));
    };
    if let Some(changed) = task.changed_recipes().find(|name| !names.contains(name)) {
        bail!("task {}: [recipe.{changed}]: unknown recipe; the recipes are {}", task.name, names.join(", "));
    }
    let mut merged = task_layer(&task, folder);
    let mut recipe_layer = config_file::parse(recipe_text).expect("the recipes that come with the program are sound");
    shorten_horizons(&mut recipe_layer, task.train_frames);
    merge(&mut merged, recipe_layer);
    merge(&mut merged, task.recipe_changes(&recipe));
    let mut below = vec![(format!("task {}: [recipe.{recipe}]", task.name), merged.clone())];
    let [file_layer, command_line] = given;
    merge(&mut merged, file_layer);
    below.extend(file.map(|path| (format!("config {}", path.display()), merged.clone())));
    merge(&mut merged, command_line);
    Ok(ConfigLayers { task, merged, below })
}

/// Cuts a recipe's horizons off at the length of the clips.
fn shorten_horizons(recipe: &mut Table, clip_frames: usize) {
    let identify = recipe.get_mut("identify").and_then(Value::as_table_mut);
    if let Some(Value::Array(horizons)) = identify.and_then(|identify| identify.get_mut("horizons")) {
        let longest = Value::Integer(clip_frames as i64);
        horizons.iter_mut().filter(|horizon| horizon.as_integer() > longest.as_integer()).for_each(|horizon| {
            *horizon = longest.clone();
        });
        horizons.dedup();
    }
}

/// What the command line says, its options above its `--set`. `--task` is not among them.
fn command_line_values(overrides: &Overrides) -> Result<Table> {
    let mut layer = Table::new();
    for assignment in &overrides.set {
        merge(&mut layer, parse_assignment(assignment)?);
    }
    let integer = |name: &str, value: u64| {
        i64::try_from(value).with_context(|| format!("--{name} {value}: must be at most {}", i64::MAX))
    };
    let options = [
        ("recipe", overrides.recipe.clone().map(Value::from)),
        ("seed", overrides.seed.map(|seed| integer("seed", seed)).transpose()?.map(Value::from)),
        ("device", overrides.device.clone().map(Value::from)),
        ("threads", overrides.threads.map(|n| integer("threads", n as u64)).transpose()?.map(Value::from)),
    ];
    for (key, value) in options.into_iter().filter_map(|(key, value)| Some((key, value?))) {
        match layer.get(key) {
            Some(other) if *other != value => {
                bail!("--set {key}={other} contradicts {key} {value}, which is given, too")
            }
            _ => drop(layer.insert(key.into(), value)),
        }
    }
    if let Some(folder) = &overrides.data {
        let folder = folder.to_str().with_context(|| format!("data folder {}: not UTF-8", folder.display()))?;
        merge(&mut layer, section("data", [("folder", folder.into())]));
    }
    Ok(layer)
}

/// A layer with one section.
fn section<const N: usize>(name: &str, values: [(&str, Value); N]) -> Table {
    let values = values.into_iter().map(|(key, value)| (key.to_string(), value)).collect();
    Table::from_iter([(name.to_string(), Value::Table(values))])
}

/// What a task contributes beside itself, below the recipe: its files and the paper's rates.
fn task_layer(task: &Task, folder: Option<&str>) -> Table {
    let values: [(&str, Value); 3] = [("seed", 0.into()), ("device", "cpu".into()), ("threads", 0.into())];
    let mut layer: Table = values.into_iter().map(|(key, value)| (key.to_string(), value)).collect();
    let files = [
        ("folder", data_folder(task, folder).into()),
        ("train_file", task.train_file.as_str().into()),
        ("test_file", task.test_file.as_str().into()),
    ];
    let rate = task.base_lr;
    let rates = [("learning_rate", rate), ("physics_learning_rate", rate), ("alpha", task.alpha)];
    merge(&mut layer, section("data", files));
    merge(&mut layer, section("join", rates.map(|(key, value)| (key, value.into()))));
    layer
}

/// `a.b=value` as a layer; a value that is no TOML is taken as a string.
fn parse_assignment(assignment: &str) -> Result<Table> {
    let (key, value) = assignment
        .split_once('=')
        .with_context(|| format!("--set {assignment:?}: expected key=value, for example join.batch=50"))?;
    let (key, value) = (key.trim(), value.trim());
    config_file::parse(&format!("{key} = {value}"))
        .or_else(|_| config_file::parse(&format!("{key} = {}", quoted(value))))
        .with_context(|| format!("--set {assignment:?}"))
}

/// Whether the value of this key decides what is learned and from what. Of a task only its system and its scene do: the
/// rest is resolved in the other keys, or scores a run.
pub(crate) fn decides(key: &str) -> bool {
    let of_task = |key: &str| key.starts_with("system.") || key.starts_with("scene.");
    !["format", "device", "threads", "data.folder"].contains(&key) && key.strip_prefix("task.").is_none_or(of_task)
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

    /// An umlaut as macOS writes it, spaces that do not break, quotes and a backslash.
    const FOLDER: &str = "Mu\u{308}ller/a\u{a0}b\u{202f}c \"d\" 'e' \\f";

    #[test]
    fn a_task_may_lie_in_a_folder_of_any_name() {
        let mut table = tasks::builtin("spring_color").unwrap().to_table();
        let data = table.get_mut("data").and_then(Value::as_table_mut).unwrap();
        data.insert("folder".into(), Value::from("."));
        let task = Task::from_table(table, &Equations::default()).unwrap();
        let layer = task_layer(&task, Some(FOLDER));
        assert_eq!(layer["data"]["folder"].as_str(), Some(FOLDER));
        assert_eq!(layer["data"]["test_file"].as_str(), Some(task.test_file.as_str()));
    }

    #[test]
    fn a_value_that_is_no_toml_is_taken_as_it_stands() {
        let layer = parse_assignment(&format!("discover.from={FOLDER}")).unwrap();
        assert_eq!(layer["discover"]["from"].as_str(), Some(FOLDER));
        let layer = parse_assignment(&format!("discover.from={}", quoted(FOLDER))).unwrap();
        assert_eq!(layer["discover"]["from"].as_str(), Some(FOLDER));
        assert_eq!(parse_assignment("join.batch = 5").unwrap()["join"]["batch"].as_integer(), Some(5));
    }
}
