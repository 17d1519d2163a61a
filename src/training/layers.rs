//! How a config is put together: the task's values, a recipe, the task's changes to it, a file, the command line, each
//! over the one before. Unknown keys are refused at every layer.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use toml::{Table, Value};

use crate::network::cells::Equations;
use crate::runs::config_file;
use crate::support::storage;
use crate::support::toml_values::quoted;
use crate::tasks::{self, Task};

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

/// All layers in one table.
#[derive(Debug)]
pub struct ConfigLayers {
    pub merged: Table,
    /// Where each layer below the command line comes from, and the table up to it: tells where a wrong value stands.
    pub below: Vec<(String, Table)>,
    /// Those that the task can name.
    pub known: Equations,
}

/// Recipe, task, file and command line; the task is the one that file or command line name.
///
/// # Errors
/// An unreadable file, an unknown task or recipe, an assignment that is no TOML.
pub fn load(file: Option<&Path>, overrides: &Overrides) -> Result<ConfigLayers> {
    let (file_layer, command_line) = (file_layer(file)?, command_line_layer(overrides)?);
    let task = task_table(&file_layer, &command_line)?;
    let named = [overrides.task.as_deref(), file_layer.get("task").and_then(Value::as_str)];
    let folder = named.into_iter().flatten().next().and_then(folder_of).map(String::from);
    merged((task, Equations::default()), folder.as_deref(), file_layer, command_line, file)
}

/// The same for a task that is at hand.
///
/// # Errors
/// As for [`load`]; a file that is for another task.
pub fn load_task(task: Task, file: Option<&Path>, overrides: &Overrides) -> Result<ConfigLayers> {
    let (file_layer, command_line) = (file_layer(file)?, command_line_layer(overrides)?);
    check_task(task_name(&file_layer)?, Some(&task.name))?;
    let mut table = task.to_table();
    changes_of_task([&file_layer, &command_line]).for_each(|changes| merge(&mut table, changes.clone()));
    let known = Equations::default().with(&task.system.cell)?;
    merged((table, known), None, file_layer, command_line, file)
}

/// The folder that a task's file lies in; none of the name of a built-in task.
fn folder_of(named: &str) -> Option<&str> {
    let folder = Path::new(named).parent().filter(|_| named.ends_with(".toml"))?.to_str()?;
    Some(if folder.is_empty() { "." } else { folder })
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

fn file_layer(file: Option<&Path>) -> Result<Table> {
    let Some(path) = file else { return Ok(Table::new()) };
    let read = || config_file::parse(&storage::read_to_string(path)?);
    read().with_context(|| format!("config {}", path.display()))
}

/// Name of the task that a layer names, alone or in the table that holds it.
fn task_name(layer: &Table) -> Result<Option<String>> {
    Ok(match layer.get("task") {
        Some(Value::String(task)) => Some(tasks::find(task)?.name),
        Some(task) => task.get("name").and_then(Value::as_str).map(String::from),
        None => None,
    })
}

/// A config file is for one task.
fn check_task(of_file: Option<String>, asked: Option<&str>) -> Result<()> {
    if let (Some(of_file), Some(asked)) = (of_file, asked) {
        ensure!(of_file == asked, "config: the file is for task {of_file}, not for {asked}");
    }
    Ok(())
}

/// What layers change in the task.
fn changes_of_task(layers: [&Table; 2]) -> impl Iterator<Item = &Table> {
    layers.into_iter().filter_map(|layer| layer.get("task")?.as_table())
}

/// The task as the layers have it: the one that is named, or that the file holds, with the tables over it.
fn task_table(file_layer: &Table, command_line: &Table) -> Result<Table> {
    check_task(task_name(file_layer)?, task_name(command_line)?.as_deref())?;
    let named = [command_line, file_layer].into_iter().find_map(|layer| layer.get("task")?.as_str());
    let mut task =
        named.map_or_else(|| Ok(Table::new()), |name| Ok::<_, anyhow::Error>(tasks::find(name)?.to_table()))?;
    changes_of_task([file_layer, command_line]).for_each(|changes| merge(&mut task, changes.clone()));
    ensure!(!task.is_empty(), "no task given; use --task, or `task = \"..\"` in the config");
    Ok(task)
}

/// The task comes with the equations that it can name; `folder` is where its file lies, if it is one.
fn merged(
    (task, known): (Table, Equations),
    folder: Option<&str>,
    mut file_layer: Table,
    mut command_line: Table,
    file: Option<&Path>,
) -> Result<ConfigLayers> {
    let said = |key: &str| command_line.get(key).or(file_layer.get(key)).and_then(Value::as_str).map(String::from);
    let recipe = said("recipe").unwrap_or_else(|| "fast".into());
    let names: Vec<_> = RECIPES.iter().map(|(name, _)| *name).collect();
    let Some((_, recipe_text)) = RECIPES.iter().find(|(name, _)| *name == recipe) else {
        bail!("unknown recipe {recipe:?}; the recipes are {}", names.join(", "));
    };
    let task = Task::from_table(task, &known).context("config: task")?;
    if let Some(changed) = task.changed_recipes().find(|name| !names.contains(name)) {
        bail!("task {}: [recipe.{changed}]: unknown recipe; the recipes are {}", task.name, names.join(", "));
    }
    let mut merged = task_layer(&task, folder);
    let mut recipe_layer = config_file::parse(recipe_text).expect("the recipes that come with the program are sound");
    shorten_horizons(&mut recipe_layer, task.train_frames);
    merge(&mut merged, recipe_layer);
    merge(&mut merged, task.recipe_changes(&recipe));
    let mut below = vec![(format!("task {}: [recipe.{recipe}]", task.name), merged.clone())];
    for layer in [&mut file_layer, &mut command_line] {
        layer.remove("task");
    }
    merge(&mut merged, file_layer);
    below.extend(file.map(|path| (format!("config {}", path.display()), merged.clone())));
    merge(&mut merged, command_line);
    Ok(ConfigLayers { merged, below, known })
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
        match (layer.get(key), value) {
            // `--set task.system.dt=0.2` changes the task that --task names.
            (Some(Value::Table(changes)), Value::String(task)) if key == "task" => {
                let mut table = tasks::find(&task)?.to_table();
                merge(&mut table, changes.clone());
                layer.insert(key.into(), Value::Table(table));
            }
            (Some(other), value) if *other != value => {
                bail!("--set {key}={other} contradicts {key} {value}, which is given, too")
            }
            (_, value) => drop(layer.insert(key.into(), value)),
        }
    }
    if let Some(folder) = &overrides.data {
        let folder = folder.to_str().with_context(|| format!("data folder {}: not UTF-8", folder.display()))?;
        let data = Table::from_iter([("folder".to_string(), Value::from(folder))]);
        merge(&mut layer, Table::from_iter([("data".to_string(), Value::Table(data))]));
    }
    Ok(layer)
}

/// What a task contributes: itself, its files and the paper's rates, below the recipe.
fn task_layer(task: &Task, folder: Option<&str>) -> Table {
    let data = data_folder(task, folder);
    let text = format!(
        "seed = 0\ndevice = \"cpu\"\nthreads = 0\n\
         [data]\nfolder = {}\ntrain_file = {}\ntest_file = {}\n\
         [join]\nlearning_rate = {lr}\nphysics_learning_rate = {lr}\nalpha = {:?}\n",
        quoted(data),
        quoted(&task.train_file),
        quoted(&task.test_file),
        task.alpha,
        lr = Value::from(task.base_lr),
    );
    let mut layer = config_file::parse(&text).expect("a task makes a sound layer");
    layer.insert("task".into(), Value::Table(task.to_table()));
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
pub fn decides(key: &str) -> bool {
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
        let task: Task = Value::Table(table).try_into().unwrap();
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
