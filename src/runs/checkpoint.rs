//! Checkpoints: everything a run needs to go on to the same bits as if it had never stopped.
//!
//! `checkpoints/step_<n>/` holds `weights.safetensors`, `slots.safetensors` (the optimizer's) and `state.json`;
//! `checkpoints/index.json` says which is the last. Folders and index each appear in one step, so a run killed at any
//! moment finds a complete checkpoint. `checkpoints/best.safetensors` holds the weights with the best validation score of
//! the last phase.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use tch::{Kind, Tensor};

use super::names::{CHECKPOINTS, CONFIG, LOG, METRICS};
use crate::network::physics_models::{PhysicsNet, VariableGroup};
use crate::support::atomic;

/// Version of the form of `state.json` and `index.json`. Files of before it have none.
const FORMAT: u32 = 1;

/// Where a run stands between two steps. What an earlier version wrote besides is not read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunState {
    #[serde(default)]
    pub format: u32,
    /// Name of the task: a checkpoint of another task is refused.
    pub task: String,
    /// Place in the recipe's list of phases.
    pub phase: usize,
    /// Steps taken in this phase, the optimizer's too: its slots belong to the phase.
    pub step: u64,
    /// Steps taken in all phases.
    pub steps: u64,
    /// Validation scores of this phase.
    pub validations: Vec<f64>,
    /// Seconds of computing so far, and those of each finished phase by name.
    pub seconds: f64,
    pub phase_seconds: Vec<(String, f64)>,
    /// The commits whose builds took the steps; none of a run of an earlier version.
    #[serde(default)]
    pub commits: Vec<String>,
    /// Lengths of log.txt and metrics.jsonl at this moment, bytes: what came later is cut off on resuming.
    pub log_bytes: u64,
    pub metrics_bytes: u64,
}

impl RunState {
    /// A run that has not begun.
    pub fn new(task: &str) -> Self {
        RunState {
            format: FORMAT,
            task: task.into(),
            phase: 0,
            step: 0,
            steps: 0,
            validations: Vec::new(),
            seconds: 0.0,
            phase_seconds: Vec::new(),
            commits: Vec::new(),
            log_bytes: 0,
            metrics_bytes: 0,
        }
    }
}

/// Which folder is the last checkpoint.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Index {
    #[serde(default)]
    format: u32,
    pub last: String,
}

/// Which of a run's weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SavedWeights {
    /// Of the last checkpoint.
    #[default]
    Last,
    /// With the best validation score of the last phase.
    Best,
}

/// The optimizer's values by variable and slot.
pub type Slots = Vec<(String, Tensor)>;

/// What a checkpoint holds besides the weights.
#[derive(Debug)]
pub struct Loaded {
    /// The checkpoint's folder.
    pub name: String,
    pub state: RunState,
    pub slots: Slots,
}

/// The checkpoints of a run folder.
#[derive(Debug, Clone)]
pub struct Store {
    run: PathBuf,
}

/// What to do about a checkpoint that cannot be read: there is no other one.
const ADVICE: &str = "put it back from a copy, or begin the run again in another folder";

const INDEX: &str = "index.json";
const WEIGHTS: &str = "weights.safetensors";
const SLOTS: &str = "slots.safetensors";
const STATE: &str = "state.json";
const BEST: &str = "best.safetensors";

impl Store {
    /// Of the run in this folder.
    pub fn new(run: &Path) -> Self {
        Store { run: run.to_path_buf() }
    }

    fn folder(&self) -> PathBuf {
        self.run.join(CHECKPOINTS)
    }

    /// Saves a checkpoint and removes the one before it. The lengths of the logs are written into the state.
    ///
    /// # Errors
    /// A full disk; the earlier checkpoint stays as it is. A variable that is not finite.
    pub fn save(&self, model: &PhysicsNet, slots: &[(String, Tensor)], state: &mut RunState) -> Result<()> {
        let _guard = tch::no_grad_guard();
        [state.log_bytes, state.metrics_bytes] = [self.synced_length(LOG)?, self.synced_length(METRICS)?];
        state.format = FORMAT;
        let weights = finite_weights(model, state.steps)?;
        let folder = self.folder();
        let last = format!("step_{:08}_phase_{}", state.steps, state.phase);
        let path = folder.join(&last);
        fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        // Of a run that was killed between the two steps below.
        if path.exists() {
            fs::remove_dir_all(&path).with_context(|| format!("cannot replace {}", path.display()))?;
        }
        atomic::write_folder(&path, |folder| {
            write_tensors(&weights, &folder.join(WEIGHTS))?;
            write_tensors(slots, &folder.join(SLOTS))?;
            fs::write(folder.join(STATE), serde_json::to_vec_pretty(state)?)?;
            Ok(())
        })?;
        let index = Index { format: FORMAT, last };
        atomic::write_file(&folder.join(INDEX), |file| Ok(serde_json::to_writer_pretty(file, &index)?))?;
        remove_others(&folder, &index)
    }

    /// Keeps the weights beside the checkpoints, in the place of those that were the best before.
    ///
    /// # Errors
    /// A full disk; the earlier ones stay. A variable that is not finite.
    pub fn save_best(&self, model: &PhysicsNet, steps: u64) -> Result<()> {
        let _guard = tch::no_grad_guard();
        let folder = self.folder();
        fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
        let weights = finite_weights(model, steps)?;
        atomic::write_path(&folder.join(BEST), |path| write_tensors(&weights, path))
    }

    /// Loads the last checkpoint, if there is one, and cuts off what was logged after it.
    ///
    /// # Errors
    /// A missing or damaged file, a checkpoint of another task, a name, shape or type that differs from the model's.
    pub fn load(&self, model: &PhysicsNet, task: &str) -> Result<Option<Loaded>> {
        let folder = self.folder();
        let Some(index) = read_index(&folder)? else {
            self.shorten([(LOG, 0), (METRICS, 0)])?;
            return Ok(None);
        };
        let path = folder.join(&index.last);
        let state: RunState = read_json(&path.join(STATE))?;
        ensure!(
            state.format <= FORMAT,
            "checkpoint {} has form {}; this program knows forms up to {FORMAT}: use a newer one",
            path.display(),
            state.format
        );
        ensure!(state.task == task, "checkpoint {} is of task {}, not of {task}", path.display(), state.task);
        load_weights(&path.join(WEIGHTS), model)?;
        let slots = read_tensors(&path.join(SLOTS))?;
        self.shorten([(LOG, state.log_bytes), (METRICS, state.metrics_bytes)])?;
        Ok(Some(Loaded { name: index.last, state, slots }))
    }

    /// Length of a log in bytes, once on the disk.
    fn synced_length(&self, name: &str) -> Result<u64> {
        let path = self.run.join(name);
        let length = || match fs::File::open(&path) {
            Ok(file) => {
                file.sync_data()?;
                Ok(file.metadata()?.len())
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(0),
            Err(error) => Err(error),
        };
        length().with_context(|| format!("cannot write {}", path.display()))
    }

    /// Cuts logs off at these lengths. One that was deleted stays short: what it held is lost, the run is not.
    fn shorten(&self, lengths: [(&str, u64); 2]) -> Result<()> {
        for (name, length) in lengths {
            let path = self.run.join(name);
            let shorten = || match fs::OpenOptions::new().write(true).open(&path) {
                Ok(file) => file.set_len(length.min(file.metadata()?.len())),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
                Err(error) => Err(error),
            };
            shorten().with_context(|| format!("cannot shorten {}", path.display()))?;
        }
        Ok(())
    }
}

/// The model's variables, if all are finite.
fn finite_weights(model: &PhysicsNet, steps: u64) -> Result<Vec<(String, Tensor)>> {
    let weights = model.named_variables();
    for (name, weight) in &weights {
        ensure!(is_finite(weight), "variable {name} is not finite after step {steps}; nothing was saved");
    }
    Ok(weights)
}

/// The index of a checkpoint folder, if it holds any checkpoint.
///
/// # Errors
/// An index that cannot be read.
pub fn read_index(folder: &Path) -> Result<Option<Index>> {
    let path = folder.join(INDEX);
    if path.exists() { read_json(&path).map(Some) } else { Ok(None) }
}

/// Loads a weights file into a model, strictly: the same names, shapes and types.
///
/// # Errors
/// A missing or damaged file, a name, shape or type that differs from the model's.
pub fn load_weights(path: &Path, model: &PhysicsNet) -> Result<()> {
    let _guard = tch::no_grad_guard();
    let saved = read_tensors(path)?;
    let variables = model.named_variables();
    for (name, _) in &saved {
        ensure!(
            variables.iter().any(|(known, _)| known == name),
            "{}: variable {name} is unknown to a model of this task (or fixed there, see model.fixed)",
            path.display()
        );
    }
    copy(&saved, variables, path)
}

/// Loads encoder and decoder alone, from the weights of a model whose other parts may be different ones.
///
/// # Errors
/// A missing or damaged file, a variable of encoder or decoder that is missing or of another shape.
pub fn load_vision(path: &Path, model: &PhysicsNet) -> Result<()> {
    let _guard = tch::no_grad_guard();
    let sees = |name: &str| matches!(model.group(name), VariableGroup::Encoder | VariableGroup::Decoder);
    let variables = model.named_variables().into_iter().filter(|(name, _)| sees(name)).collect();
    copy(&read_tensors(path)?, variables, path)
}

/// Sets variables to the saved values of their names.
fn copy(saved: &[(String, Tensor)], variables: Vec<(String, Tensor)>, path: &Path) -> Result<()> {
    for (name, variable) in variables {
        let (_, value) = saved.iter().find(|(saved, _)| *saved == name).with_context(|| {
            format!("{}: variable {name} is missing (a model of this task needs it)", path.display())
        })?;
        ensure!(
            value.size() == variable.size() && value.kind() == variable.kind(),
            "{}: variable {name}: found {:?} {:?}, expected {:?} {:?}",
            path.display(),
            value.kind(),
            value.size(),
            variable.kind(),
            variable.size()
        );
        variable.shallow_clone().copy_(value);
    }
    Ok(())
}

/// The weights file of a run folder, of a checkpoint folder, or the file itself.
///
/// # Errors
/// A path that is none of these; a run that has not come to its last phase has no best weights.
pub fn find_weights(path: &Path, which: SavedWeights) -> Result<PathBuf> {
    if path.is_file() {
        return Ok(path.to_path_buf());
    }
    if which == SavedWeights::Best {
        let best = path.join(CHECKPOINTS).join(BEST);
        ensure!(best.exists(), "{}: there are no best weights; the last phase has not begun", path.display());
        return Ok(best);
    }
    for folder in [path.to_path_buf(), path.join(CHECKPOINTS)] {
        if folder.join(WEIGHTS).exists() {
            return Ok(folder.join(WEIGHTS));
        }
        if let Some(index) = read_index(&folder)? {
            return Ok(folder.join(index.last).join(WEIGHTS));
        }
    }
    ensure!(
        !path.join(CONFIG).exists(),
        "{}: a run without a checkpoint: it has not saved one yet, or only its records are kept here",
        path.display()
    );
    bail!("{}: neither a run folder, nor a checkpoint, nor a weights file", path.display())
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    serde_json::from_slice(&text).with_context(|| format!("{} is damaged; {ADVICE}", path.display()))
}

fn write_tensors(tensors: &[(String, Tensor)], path: &Path) -> Result<()> {
    let contiguous: Vec<_> = tensors
        .iter()
        .map(|(name, tensor)| (name.as_str(), tensor.detach().to_device(tch::Device::Cpu).contiguous()))
        .collect();
    Tensor::write_safetensors(&contiguous, path).with_context(|| format!("cannot write {}", path.display()))
}

/// Named tensors, sorted by name.
fn read_tensors(path: &Path) -> Result<Vec<(String, Tensor)>> {
    let mut tensors = Tensor::read_safetensors(path).with_context(|| {
        format!("cannot read {} (missing, cut short or no safetensors file); {ADVICE}", path.display())
    })?;
    tensors.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(tensors)
}

fn remove_others(folder: &Path, index: &Index) -> Result<()> {
    for entry in fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name != index.last && name.starts_with("step_") {
            fs::remove_dir_all(entry.path()).with_context(|| format!("cannot remove {}", entry.path().display()))?;
        }
    }
    Ok(())
}

/// Whether every element is a number.
pub fn is_finite(tensor: &Tensor) -> bool {
    tensor.to_kind(Kind::Double).sum(Kind::Double).isfinite().int64_value(&[]) == 1
}
