//! Checkpoints: everything a run needs to go on to the same bits as if it had never stopped.
//!
//! `checkpoints/step_<n>/` holds `weights.safetensors`, `slots.safetensors` (the optimizer's) and `state.json`;
//! `checkpoints/index.json` says which is the last and which the best. Folders and index each appear in one step, so
//! a run killed at any moment finds a complete checkpoint.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use tch::{Kind, Tensor};

use crate::durable;
use crate::physics_models::PhysicsNet;

/// Where a run stands between two steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunState {
    /// Key of the task: a checkpoint of another task is refused.
    pub task: String,
    /// Place in the recipe's list of phases.
    pub phase: usize,
    /// Steps taken in this phase.
    pub step: u64,
    /// Steps taken in all phases.
    pub steps: u64,
    /// Steps of the optimizer; its slots belong to the phase.
    pub optimizer_steps: u64,
    /// Validation scores of this phase.
    pub validations: Vec<f64>,
    /// Best score of the last phase and the number of steps it was reached at.
    pub best: Option<(f64, u64)>,
    /// Seconds of computing so far, and those of each finished phase by name.
    pub seconds: f64,
    pub phase_seconds: Vec<(String, f64)>,
    /// Lengths of log.txt and metrics.jsonl at this moment, bytes: what came later is cut off on resuming.
    pub log_bytes: u64,
    pub metrics_bytes: u64,
}

impl RunState {
    /// A run that has not begun.
    pub fn new(task: &str) -> Self {
        RunState {
            task: task.into(),
            phase: 0,
            step: 0,
            steps: 0,
            optimizer_steps: 0,
            validations: Vec::new(),
            best: None,
            seconds: 0.0,
            phase_seconds: Vec::new(),
            log_bytes: 0,
            metrics_bytes: 0,
        }
    }
}

/// Which folders are the last and the best checkpoint.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Index {
    pub last: String,
    pub best: Option<String>,
}

const INDEX: &str = "index.json";
const WEIGHTS: &str = "weights.safetensors";
const SLOTS: &str = "slots.safetensors";
const STATE: &str = "state.json";

/// Saves a checkpoint as the last (and the best, if it is) and removes those that are neither.
///
/// # Errors
/// A full disk; the earlier checkpoints stay as they are. A variable that is not finite.
pub fn save(folder: &Path, model: &PhysicsNet, slots: &[(String, Tensor)], state: &RunState, best: bool) -> Result<()> {
    let _guard = tch::no_grad_guard();
    let weights = model.named_variables();
    for (name, weight) in &weights {
        ensure!(is_finite(weight), "variable {name} is not finite after step {}; nothing was saved", state.steps);
    }
    fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let name = format!("step_{:08}_phase_{}", state.steps, state.phase);
    let path = folder.join(&name);
    let mut index: Index = read_index(folder)?.unwrap_or_default();
    // The same step of the same run is the same checkpoint: it is not written twice.
    if index.last != name {
        if path.exists() {
            fs::remove_dir_all(&path).with_context(|| format!("cannot replace {}", path.display()))?;
        }
        durable::write_folder(&path, |folder| {
            write_tensors(&weights, &folder.join(WEIGHTS))?;
            write_tensors(slots, &folder.join(SLOTS))?;
            fs::write(folder.join(STATE), serde_json::to_vec_pretty(state)?)?;
            Ok(())
        })?;
    }
    index.last.clone_from(&name);
    if best {
        index.best = Some(name);
    }
    durable::write_file(&folder.join(INDEX), |file| Ok(serde_json::to_writer_pretty(file, &index)?))?;
    remove_others(folder, &index)
}

/// The index of a checkpoint folder, if it holds any checkpoint.
///
/// # Errors
/// An index that cannot be read.
pub fn read_index(folder: &Path) -> Result<Option<Index>> {
    let path = folder.join(INDEX);
    if path.exists() { read_json(&path).map(Some) } else { Ok(None) }
}

/// Loads weights into a model and returns the run's state and the optimizer's slots.
///
/// # Errors
/// A missing or damaged file, a checkpoint of another task, a name, shape or type that differs from the model's.
pub fn load(path: &Path, model: &PhysicsNet) -> Result<(RunState, Vec<(String, Tensor)>)> {
    let state: RunState = read_json(&path.join(STATE))?;
    ensure!(
        state.task == model.task.key,
        "checkpoint {} is of task {}, not of {}",
        path.display(),
        state.task,
        model.task.key
    );
    load_weights(&path.join(WEIGHTS), model)?;
    let slots = read_tensors(&path.join(SLOTS))?;
    Ok((state, slots))
}

/// Loads a weights file into a model, strictly: the same names, shapes and types.
///
/// # Errors
/// As for [`load`].
pub fn load_weights(path: &Path, model: &PhysicsNet) -> Result<()> {
    let _guard = tch::no_grad_guard();
    let saved = read_tensors(path)?;
    let variables = model.named_variables();
    for (name, _) in &saved {
        ensure!(
            variables.iter().any(|(known, _)| known == name),
            "{}: variable {name} is unknown to a model of task {} (or held there, see model.hold)",
            path.display(),
            model.task.key
        );
    }
    for (name, variable) in variables {
        let (_, value) = saved.iter().find(|(saved, _)| *saved == name).with_context(|| {
            format!("{}: variable {name} is missing (a model of task {} needs it)", path.display(), model.task.key)
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

/// The weights file of a run folder's checkpoint, of a checkpoint folder, or the file itself.
///
/// # Errors
/// A path that is none of these.
pub fn find_weights(path: &Path) -> Result<PathBuf> {
    if path.is_file() {
        return Ok(path.to_path_buf());
    }
    for folder in [path.to_path_buf(), path.join("checkpoints")] {
        if folder.join(WEIGHTS).exists() {
            return Ok(folder.join(WEIGHTS));
        }
        if let Some(index) = read_index(&folder)? {
            return Ok(folder.join(index.last).join(WEIGHTS));
        }
    }
    anyhow::bail!("{}: neither a run folder, nor a checkpoint, nor a weights file", path.display())
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    serde_json::from_slice(&text).with_context(|| format!("{} is damaged", path.display()))
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
    let mut tensors = Tensor::read_safetensors(path)
        .with_context(|| format!("cannot read {} (missing, cut short or no safetensors file)", path.display()))?;
    tensors.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(tensors)
}

fn remove_others(folder: &Path, index: &Index) -> Result<()> {
    for entry in fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let kept = name == index.last || Some(&name) == index.best.as_ref() || name == INDEX;
        if !kept && name.starts_with("step_") {
            fs::remove_dir_all(entry.path()).with_context(|| format!("cannot remove {}", entry.path().display()))?;
        }
    }
    Ok(())
}

/// Whether every element is a number.
pub fn is_finite(tensor: &Tensor) -> bool {
    tensor.to_kind(Kind::Double).sum(Kind::Double).isfinite().int64_value(&[]) == 1
}
