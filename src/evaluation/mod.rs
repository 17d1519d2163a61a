//! Scoring a model on a dataset: losses, every predicted frame, and positions where the truth is known.

pub mod rollout;
pub mod ssim;
mod states;

use std::path::Path;

use anyhow::{Context, Result};
use tch::{Device, Kind, Tensor};

use crate::datasets::files::{ClipShape, DatasetFile, Split};
use crate::datasets::iterators::Clips;
use crate::datasets::states::{SplitStates, States};
use crate::evaluation::ssim::ssim;
use crate::network::cells::State;
use crate::network::physics_models::PhysicsNet;
use crate::network::physics_models::losses::{LossAccumulator, Losses};
use crate::runs::scores::{PredictedFrame, Scores};
use crate::tasks::{Task, TrueParameter};

/// Clips in one pass, which bounds the memory.
const BATCH: usize = 25;

/// The clips of one split, to be scored.
#[derive(Debug)]
pub struct ScoredClips {
    pub clips: Clips,
    /// The true states. None where none lie beside the file.
    pub states: Option<SplitStates>,
    /// What a model of the task should learn from such clips, as far as it is known.
    pub truth: Vec<TrueParameter>,
    /// How the clips were made, as text.
    pub made_with: Option<String>,
    /// What a reader of the scores should know of the file.
    pub notes: Vec<String>,
}

impl ScoredClips {
    /// Reads one split of a dataset file, with clips as long as in its task's training or test file, and the true states
    /// that lie beside it.
    ///
    /// # Errors
    /// As for [`DatasetFile::read`] and [`States::read`].
    pub fn read(path: &Path, task: &Task, split: Split, device: Device) -> Result<Self> {
        let dataset = DatasetFile::read(path, &ClipShape::of_either(task, split))?;
        let states = States::read(path, &dataset)?;
        let truth = truth(path, task, states.as_ref());
        let mut notes = Vec::new();
        if truth.len() < task.truth.len() {
            notes.push(format!("{}: its true parameters are not known, or not those of the model", path.display()));
        }
        if let Some(other) = states.as_ref().and_then(States::task).filter(|other| *other != task.key) {
            notes.push(format!("{} was made for task {other}, not for {}", path.display(), task.key));
        }
        let (states, made_with) = states.map(|states| (states.split(split).clone(), states.settings)).unzip();
        let clips = Clips::new(dataset.split(split), dataset.actions(split), device);
        Ok(ScoredClips { clips, states, truth, made_with, notes })
    }

    /// The true value of a parameter, if it is known.
    pub fn truth_of(&self, name: &str) -> Option<f64> {
        self.truth.iter().find(|truth| truth.name == name).map(|truth| truth.value)
    }
}

/// The true parameters of a dataset file: what was written beside it; else the task's, if it is one of the task's own
/// files (the authors' have the same names).
fn truth(path: &Path, task: &Task, states: Option<&States>) -> Vec<TrueParameter> {
    let own = [task.train_file, task.test_file].iter().any(|file| path.ends_with(file));
    match states.and_then(|states| states.truth.as_ref()) {
        Some(values) => task.truth.iter().zip(values).map(|(p, &value)| TrueParameter { value, ..*p }).collect(),
        None if own => task.truth.to_vec(),
        None => Vec::new(),
    }
}

/// Scores a model on clips, with the true states if there are any.
///
/// # Errors
/// Clips shorter than L + T_pred, states of another number of objects.
pub fn evaluate(model: &PhysicsNet, scored: &ScoredClips) -> Result<Scores> {
    let _guard = tch::no_grad_guard();
    let ScoredClips { clips, states, .. } = scored;
    let task = &model.task;
    let mut means = LossAccumulator::default();
    let mut squared_errors = Vec::new();
    let mut similarities = Vec::new();
    let mut seen: [Vec<Tensor>; 3] = Default::default();
    let all: Vec<i64> = (0..clips.len() as i64).collect();
    for chosen in all.chunks(BATCH) {
        let frames = clips.batch(chosen, clips.time());
        let pass = model.forward(&frames, &clips.actions(chosen))?;
        means.add(&Losses::new(&pass, &frames, task), chosen.len());
        let predicted = pass.predictions.size()[1];
        let truth = frames.narrow(1, task.input_steps as i64, predicted);
        let over_frame = [2i64, 3, 4];
        let errors = (&pass.predictions - &truth).square().sum_dim_intlist(over_frame.as_slice(), false, Kind::Double);
        squared_errors.push(errors.to_device(Device::Cpu));
        let similar = ssim(&pass.predictions.flatten(0, 1), &truth.flatten(0, 1))?;
        similarities.push(similar.reshape([-1, predicted]).to_device(Device::Cpu));
        if states.is_some() {
            let rolled_out: Vec<_> = std::iter::once(&pass.initial).chain(&pass.states).map(State::joined).collect();
            let rolled_out = Tensor::stack(&rolled_out, 1).chunk(2, 2);
            let parts = [&pass.positions, &rolled_out[0], &rolled_out[1]];
            for (part, states) in seen.iter_mut().zip(parts) {
                part.push((states * model.length_per_unit()).to_device(Device::Cpu).to_kind(Kind::Double));
            }
        }
    }
    let per_frame = |parts: &[Tensor]| -> Result<Vec<f64>> {
        Ok(Tensor::cat(parts, 0).mean_dim([0i64].as_slice(), false, Kind::Double).try_into()?)
    };
    let predicted_frames = per_frame(&squared_errors)?
        .into_iter()
        .zip(per_frame(&similarities)?)
        .enumerate()
        .map(|(place, (squared_error, ssim))| PredictedFrame {
            frame: task.input_steps + place,
            extrapolated: place >= task.pred_steps,
            squared_error,
            ssim,
        })
        .collect();
    let states = match states {
        Some(truth) => {
            let [encoded, positions, velocities] = seen.map(|parts| Tensor::cat(&parts, 0));
            let seen = states::Seen { encoded, positions, velocities };
            Some(states::errors(&seen, truth, task).context("true states")?)
        }
        None => None,
    };
    Ok(Scores { clips: clips.len(), losses: means.values(), predicted_frames, states })
}
