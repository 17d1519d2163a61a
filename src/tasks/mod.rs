//! Tasks: a system, the files with its clips, and what a recipe changes for it, read from TOML.
//!
//! The built-in tasks stand in `configs/tasks`, one file each, and are compiled in; `--task my.toml` reads another one.
//! Lengths are in pixels (the pendulum's in rods), times in the paper's time unit (one frame is `dt` of it), positions are
//! `(x, y)` with x to the right and y down, or angles. Where the original has the system, key and file names are its own,
//! so its files and ours are interchangeable.
//! Original: the `datasets` and `--task` tables of `run_physics.py`, README; paper: section 4.1.
//!
//! A built-in task:
//!
//! ```
//! let task = paig::tasks::find("3bp_color")?;
//! assert_eq!((task.system.objects, task.system.side, task.train_frames), (3, 36, 20));
//! assert_eq!(task.truth_of("g"), Some(60.0));
//!
//! let error = paig::tasks::find("four_bodies").unwrap_err();
//! assert!(error.to_string().contains("four_bodies"));
//! # Ok::<(), anyhow::Error>(())
//! ```

mod builtin;
pub mod camera;
pub mod equation_file;
pub mod gallery;
pub mod looks;
pub mod published;
pub mod scene;
mod source;
mod success;
pub mod video;

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use self::scene::{Motion, Scene};
use self::video::Video;
use crate::network::System;
use crate::network::cells::{CellKind, Equations, PhysicalParameter};
use crate::network::system::SystemTable;

pub use builtin::{all, builtin, names};
pub(crate) use source::{TaskSource, folder_of, name_in};
pub use success::Success;

/// As `data.folder`: the files lie beside the task's own file.
pub const BESIDE_THE_TASK: &str = ".";

/// Ending of the file with the true states of a dataset file, in the place of `.npz`.
pub const STATES_ENDING: &str = "_states.npz";
/// Most frames of a clip: with the largest frames its bytes are still counted without an overflow.
const MOST_FRAMES: usize = 1_000_000;
/// Rates of the paper's protocol where a task file says nothing: those of the paper's spring.
const BASE_LR: f64 = 6e-4;
const ALPHA: f64 = 3.0;

/// A physical parameter with the value the data were made with. The value scores a run; training never sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueParameter {
    /// Symbol of the paper: `k`, `l`, `g`, `m`, `a`.
    pub name: String,
    pub value: f64,
}

/// One task: a system, its files, and what else belongs to it.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(into = "TaskTable")]
pub struct Task {
    /// On the command line, in run folders and in `summary.json`.
    pub name: String,
    pub system: System,
    /// Frames of a training clip.
    pub train_frames: usize,
    /// Frames of a test clip.
    pub test_frames: usize,
    /// The dataset file of the training clips, relative to the datasets folder.
    pub train_file: String,
    /// That of the test clips.
    pub test_file: String,
    /// How `generate` makes the clips; none of videos that were filmed.
    pub scene: Option<Scene>,
    /// In the order of the equation's parameters, as far as they are known.
    pub truth: Vec<TrueParameter>,
    /// When the report counts a run as a success.
    pub success: Success,
    /// Learning rate and weight alpha of the reconstruction loss in the paper's protocol.
    pub base_lr: f64,
    pub alpha: f64,
    /// The file as it was read.
    table: TaskTable,
}

/// A task as it stands in its file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TaskTable {
    name: String,
    /// One line for `--help`.
    #[serde(default)]
    summary: String,
    system: SystemTable,
    data: DataTable,
    #[serde(skip_serializing_if = "Option::is_none")]
    scene: Option<Scene>,
    /// Where the clips were filmed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    video: Option<Video>,
    /// True parameters by symbol, where no scene tells them.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    truth: BTreeMap<String, f64>,
    #[serde(default, skip_serializing_if = "Success::is_empty")]
    success: Success,
    #[serde(default)]
    training: PaperRates,
    /// By recipe: what the task changes in it.
    #[serde(default, skip_serializing_if = "Table::is_empty")]
    recipe: Table,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DataTable {
    train_frames: usize,
    test_frames: usize,
    /// Below the datasets folder; the task's name by default. `.`: beside the task's file.
    #[serde(skip_serializing_if = "Option::is_none")]
    folder: Option<String>,
    /// In that folder; the authors' naming by default where there is a scene, otherwise `train.npz` and `test.npz`.
    #[serde(skip_serializing_if = "Option::is_none")]
    train_file: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    test_file: Option<String>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct PaperRates {
    base_lr: f64,
    alpha: f64,
}

impl Default for PaperRates {
    fn default() -> Self {
        PaperRates { base_lr: BASE_LR, alpha: ALPHA }
    }
}

impl Task {
    /// Reads a task from the text of its file.
    ///
    /// # Errors
    /// An unknown key, a value of the wrong type or out of range; the message names it.
    pub fn from_toml(text: &str) -> Result<Self> {
        toml::from_str::<TaskTable>(text)?.task(&Equations::default())
    }

    /// Reads a task from the table of its file, whose equation may have one of these names.
    ///
    /// # Errors
    /// As for [`Self::from_toml`].
    pub fn from_table(table: Table, known: &Equations) -> Result<Self> {
        table.try_into::<TaskTable>()?.task(known)
    }

    /// Reads the task of a saved config: its table, or its name in those of the first version.
    ///
    /// # Errors
    /// As for [`find`] and [`Self::from_toml`].
    pub fn of_config(task: Value, known: &Equations) -> Result<Self> {
        match task {
            Value::String(name) => find(&name),
            Value::Table(table) => Self::from_table(table, known).context("task"),
            other => bail!("task = {other}: expected a table"),
        }
    }

    /// A task around a system, with clips of these lengths, without scene or truth: what a program builds that brings its
    /// own data.
    ///
    /// # Errors
    /// As for [`Self::from_toml`].
    pub fn of_system(name: &str, system: &System, train_frames: usize, test_frames: usize) -> Result<Self> {
        let table = TaskTable {
            name: name.into(),
            summary: String::new(),
            system: SystemTable::from(system),
            data: DataTable { train_frames, test_frames, folder: None, train_file: None, test_file: None },
            scene: None,
            video: None,
            truth: BTreeMap::new(),
            success: Success::default(),
            training: PaperRates::default(),
            recipe: Table::new(),
        };
        table.task(&Equations::default().with(&system.cell)?)
    }

    /// One line for `--help`.
    pub fn summary(&self) -> &str {
        &self.table.summary
    }

    /// Where the clips were filmed, if `import` made them.
    pub fn video(&self) -> Option<&Video> {
        self.table.video.as_ref()
    }

    /// Whether the dataset files lie beside the task's file, and not in a folder of the datasets folder.
    pub(crate) fn data_lie_beside(&self) -> bool {
        self.table.data.folder.as_deref() == Some(BESIDE_THE_TASK)
    }

    /// The whole task as a table of TOML.
    pub fn to_table(&self) -> Table {
        Table::try_from(&self.table).expect("a task is plain data")
    }

    /// What the task changes in a recipe.
    pub fn recipe_changes(&self, recipe: &str) -> Table {
        self.table.recipe.get(recipe).and_then(Value::as_table).cloned().unwrap_or_default()
    }

    /// The recipes in which the task changes something.
    pub(crate) fn changed_recipes(&self) -> impl Iterator<Item = &str> {
        self.table.recipe.keys().map(String::as_str)
    }

    /// The true value of a parameter in the task's own clips, if it is known.
    pub fn truth_of(&self, symbol: &str) -> Option<f64> {
        self.truth.iter().find(|truth| truth.name == symbol).map(|truth| truth.value)
    }

    /// Below the datasets folder, where the task's files are.
    pub fn data_folder(&self) -> &str {
        self.table.data.folder.as_deref().unwrap_or(&self.name)
    }
}

impl From<Task> for TaskTable {
    fn from(task: Task) -> Self {
        task.table
    }
}

impl TaskTable {
    /// The task, where these equations have names.
    ///
    /// # Errors
    /// As for [`Task::from_toml`].
    fn task(self, known: &Equations) -> Result<Task> {
        let table = self;
        let of_task = || format!("task {:?}", table.name);
        check_name(&table.name)?;
        let wall_margin = table.scene.as_ref().map_or(0.0, Scene::wall_margin);
        let system = table.system.system(wall_margin, known).context("system").with_context(of_task)?;
        if let Some(scene) = &table.scene {
            scene.check(&system).context("scene").with_context(of_task)?;
        }
        table.check(&system).with_context(of_task)?;
        let PaperRates { base_lr, alpha } = table.training;
        let DataTable { train_frames, test_frames, .. } = table.data;
        let train_file = table.file(&table.data.train_file, train_frames, "train");
        let test_file = table.file(&table.data.test_file, test_frames, "test");
        ensure!(
            train_file != test_file,
            "task {:?}: training and test file are both {train_file:?}; name them with data.train_file and data.test_file",
            table.name
        );
        Ok(Task {
            name: table.name.clone(),
            train_frames,
            test_frames,
            train_file,
            test_file,
            scene: table.scene.clone(),
            truth: table.true_parameters(&system),
            success: table.success.clone(),
            base_lr,
            alpha,
            system,
            table,
        })
    }

    /// A dataset file, relative to the datasets folder.
    fn file(&self, named: &Option<String>, frames: usize, plain: &str) -> String {
        let folder = self.data.folder.as_ref().unwrap_or(&self.name);
        let by_scene = || self.scene.as_ref().map(|scene| scene.file_stem(self.system.dt, frames));
        let default = || by_scene().unwrap_or_else(|| plain.to_string()) + ".npz";
        let name = named.clone().unwrap_or_else(default);
        if folder == BESIDE_THE_TASK { name } else { format!("{folder}/{name}") }
    }

    fn true_parameters(&self, system: &System) -> Vec<TrueParameter> {
        let value = |symbol: &str| match &self.scene {
            Some(scene) => scene.truth(&system.cell, symbol).or(self.truth.get(symbol).copied()),
            None => self.truth.get(symbol).copied(),
        };
        let symbols = system.cell.parameters.iter().map(|parameter| &*parameter.name);
        symbols.filter_map(|name| Some(TrueParameter { name: name.into(), value: value(name)? })).collect()
    }

    fn check(&self, system: &System) -> Result<()> {
        let DataTable { train_frames, test_frames, folder, train_file, test_file } = &self.data;
        let least = system.input_steps + system.pred_steps;
        for (key, frames) in [("train_frames", *train_frames), ("test_frames", *test_frames)] {
            ensure!(
                frames >= least,
                "data.{key} = {frames}: clips must hold at least input_steps + pred_steps = {least} frames"
            );
            ensure!(frames <= MOST_FRAMES, "data.{key} = {frames}: a clip has at most {MOST_FRAMES} frames");
        }
        for (key, path) in [("folder", folder), ("train_file", train_file), ("test_file", test_file)] {
            let Some(path) = path else { continue };
            if key == "folder" && path == BESIDE_THE_TASK {
                continue;
            }
            // The sample picture and the true states have its name with another ending.
            ensure!(
                key == "folder" || (path.ends_with(".npz") && !path.ends_with(STATES_ENDING)),
                "data.{key} = {path:?}: must end in .npz, and not in {STATES_ENDING}, which is for true states"
            );
            let inside = Path::new(path).components().all(|part| matches!(part, std::path::Component::Normal(_)));
            ensure!(inside && !path.is_empty(), "data.{key} = {path:?}: must lie in the datasets folder");
        }
        for (symbol, value) in &self.truth {
            let bounds = parameter(&system.cell, "truth", symbol)?.bounds;
            // Errors are in per cent of the truth.
            ensure!(bounds.contain(*value) && *value != 0.0, "truth.{symbol} = {value}: must be {bounds}, and not 0");
        }
        for (symbol, percent) in &self.success.parameters {
            parameter(&system.cell, "success.parameters", symbol)?;
            ensure!(
                percent.is_finite() && *percent > 0.0,
                "success.parameters.{symbol} = {percent}: must be a positive number"
            );
        }
        for (loss, limit) in &self.success.losses {
            ensure!(
                limit.is_finite() && *limit > 0.0,
                "success.losses.{} = {limit}: must be a positive number",
                loss.key()
            );
        }
        for (recipe, changes) in &self.recipe {
            ensure!(changes.is_table(), "recipe.{recipe} = {changes}: must be a table of the recipe's sections");
        }
        if self.scene.as_ref().is_some_and(|scene| scene.motion == Motion::Equation {}) {
            let known = |it: &&PhysicalParameter| self.truth.contains_key(&*it.name) || it.fixed.is_some();
            let unknown = system.cell.parameters.iter().find(|parameter| !known(parameter));
            ensure!(
                unknown.is_none(),
                "truth: the scene's motion is the equation, so all its parameters must be known; {} is missing",
                unknown.map_or("none", |parameter| &*parameter.name)
            );
        }
        if let Some(video) = &self.video {
            video.check(self.system.dt)?;
        }
        for symbol in self.truth.keys() {
            let of_scene = self.scene.as_ref().and_then(|scene| scene.truth(&system.cell, symbol));
            ensure!(of_scene.is_none(), "truth.{symbol}: the scene says it already; leave it out here");
        }
        for (key, rate) in [("base_lr", self.training.base_lr), ("alpha", self.training.alpha)] {
            ensure!(rate.is_finite() && rate >= 0.0, "training.{key} = {rate}: must be 0 or a positive number");
        }
        Ok(())
    }
}

/// The parameter of an equation that a section names.
fn parameter<'a>(equation: &'a CellKind, section: &str, symbol: &str) -> Result<&'a PhysicalParameter> {
    equation.parameters.iter().find(|parameter| parameter.name == symbol).with_context(|| {
        let symbols: Vec<_> = equation.parameters.iter().map(|parameter| &*parameter.name).collect();
        format!("{section}.{symbol}: the equation {:?} has no such parameter; it has {symbols:?}", equation.name)
    })
}

/// Refuses a name that no task can have.
///
/// # Errors
/// What may stand in one.
pub fn check_name(name: &str) -> Result<()> {
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_' || c == '-';
    ensure!(
        !name.is_empty() && name.len() <= 64 && name.chars().all(plain) && !name.starts_with('-'),
        "task name {name:?}: 1 to 64 of a-z, 0-9, _ and -"
    );
    Ok(())
}

/// A task by what stands behind `--task`: the name of a built-in one, or the path of a file that ends in `.toml`.
///
/// # Errors
/// An unknown name, with the list of those there are; a file that cannot be read, is no task, or takes the name of a
/// built-in one.
pub fn find(name_or_file: &str) -> Result<Task> {
    TaskSource::find(name_or_file)?.task()
}
