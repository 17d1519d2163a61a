//! Checkpoints: everything a run needs to go on to the same bits as if it had never stopped.
//!
//! `checkpoints/step_<n>/` holds `weights.safetensors`, `slots.safetensors` (the optimizer's) and `state.json`;
//! `checkpoints/index.json` says which is the last. Folders and index each appear in one step, so a run killed at any
//! moment finds a complete checkpoint.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use tch::{Kind, Tensor};

use crate::network::physics_models::PhysicsNet;
use crate::runs::folder::CONFIG;
use crate::support::atomic;

/// Where a run stands between two steps. What an earlier version wrote besides is not read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunState {
    /// Key of the task: a checkpoint of another task is refused.
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
    pub last: String,
}

/// What to do about a checkpoint that cannot be read: there is no other one.
const ADVICE: &str = "put it back from a copy, or begin the run again in another folder";

const INDEX: &str = "index.json";
const WEIGHTS: &str = "weights.safetensors";
const SLOTS: &str = "slots.safetensors";
const STATE: &str = "state.json";

/// Saves a checkpoint and removes the one before it.
///
/// # Errors
/// A full disk; the earlier checkpoint stays as it is. A variable that is not finite.
pub fn save(folder: &Path, model: &PhysicsNet, slots: &[(String, Tensor)], state: &RunState) -> Result<()> {
    let _guard = tch::no_grad_guard();
    let weights = model.named_variables();
    for (name, weight) in &weights {
        ensure!(is_finite(weight), "variable {name} is not finite after step {}; nothing was saved", state.steps);
    }
    fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let last = format!("step_{:08}_phase_{}", state.steps, state.phase);
    let path = folder.join(&last);
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
    let index = Index { last };
    atomic::write_file(&folder.join(INDEX), |file| Ok(serde_json::to_writer_pretty(file, &index)?))?;
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
