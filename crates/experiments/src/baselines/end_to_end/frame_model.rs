//! End-to-end baselines: what they have in common, and what they are scored by.

use anyhow::Result;
use tch::nn::VarStore;
use tch::{Device, Kind, Tensor};

use paig::datasets::iterators::Clips;
use paig::evaluation;
use paig::evaluation::frame_scores::FrameScores;
use paig::network::System;
use paig::network::cells::Actions;
use paig::network::physics_models::losses::MeanLosses;
use paig::runs::scores::{PredictedFrame, Scores};

/// A model that predicts frames from frames and knows neither equation nor the encoder and decoder of this program.
pub trait FrameModel {
    fn variables(&self) -> &VarStore;

    /// Before the first step: what is taken from the training clips without learning.
    fn begin(&self, _train: &Clips) {}

    /// Random numbers that a step takes on so many clips of so many frames.
    fn draws(&self, _clips: usize, _time: usize) -> usize {
        0
    }

    /// What a step descends. On a GPU it is recorded and repeated: it must not look at a number.
    fn loss(&self, batch: &Batch) -> Tensor;

    /// The next `frames` frames, `[batch, frames, channels, S, S]` in \[0, 1\], after the input `[batch, L, channels, S, S]`.
    /// `actions` begin at the first input frame.
    fn predict(&self, input: &Tensor, actions: &Actions, frames: usize) -> Tensor;
}

/// Clips that are learned from.
#[derive(Debug)]
pub struct Batch {
    /// `[batch, time, channels, S, S]`
    pub frames: Tensor,
    pub actions: Actions,
    /// What each frame is worth, `[batch, time]`; only where a model learns it.
    pub rewards: Option<Tensor>,
    /// Standard normal numbers, `[draws]`, where the model draws its latents.
    pub noise: Option<Tensor>,
}

impl Batch {
    /// All tensors of it.
    pub fn parts(&self) -> Vec<Tensor> {
        let others = [self.actions.values(), self.rewards.as_ref(), self.noise.as_ref()];
        std::iter::once(&self.frames).chain(others.into_iter().flatten()).map(Tensor::shallow_clone).collect()
    }

    /// Another batch of the same kind, of these [`parts`](Self::parts).
    pub fn with(&self, parts: &[Tensor]) -> Self {
        let mut parts = parts.iter().map(Tensor::shallow_clone);
        let mut next = |there: bool| if there { parts.next() } else { None };
        Batch {
            frames: next(true).expect("a batch has frames"),
            actions: Actions::new(next(self.actions.values().is_some())),
            rewards: next(self.rewards.is_some()),
            noise: next(self.noise.is_some()),
        }
    }
}

/// All variables of a model with their names, sorted by name.
pub fn named_variables(model: &dyn FrameModel) -> Vec<(String, Tensor)> {
    let mut named: Vec<_> = model.variables().variables().into_iter().collect();
    named.sort_by(|a, b| a.0.cmp(&b.0));
    named
}

/// Number of weights.
pub fn weights(model: &dyn FrameModel) -> usize {
    named_variables(model).iter().map(|(_, variable)| variable.numel()).sum()
}

/// Passes the first `count` clips (all, if there are fewer) through the model without gradient; `see` is given the clips'
/// frames and those that are predicted after the input.
///
/// # Errors
/// An error of `see`.
pub fn each_prediction(
    model: &dyn FrameModel,
    system: &System,
    clips: &Clips,
    count: usize,
    mut see: impl FnMut(&Tensor, &Tensor) -> Result<()>,
) -> Result<()> {
    let _guard = tch::no_grad_guard();
    let all: Vec<i64> = (0..clips.len().min(count) as i64).collect();
    for chosen in all.chunks(evaluation::batch(clips)) {
        let frames = clips.batch(chosen, clips.time());
        let input = frames.narrow(1, 0, system.input_steps as i64);
        see(&frames, &model.predict(&input, &clips.actions(chosen), clips.time() - system.input_steps))?;
    }
    Ok(())
}

/// Scores on the first `count` clips. There is no reconstruction: `recons_loss` is not a number.
///
/// # Errors
/// Frames that are too small for the structural similarity.
pub fn scores(model: &dyn FrameModel, system: &System, clips: &Clips, count: usize) -> Result<Scores> {
    let mut frames = FrameScores::default();
    each_prediction(model, system, clips, count, |clips, predicted| {
        let truth = clips.narrow(1, system.input_steps as i64, predicted.size()[1]);
        frames.add(predicted, &truth)
    })?;
    let predicted_frames = frames.predicted_frames(system)?;
    let mean = |extrapolated: bool| {
        let errors: Vec<f64> = predicted_frames
            .iter()
            .filter(|frame| frame.extrapolated == extrapolated)
            .map(|frame: &PredictedFrame| frame.squared_error)
            .collect();
        (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64)
    };
    let losses =
        MeanLosses { recons_loss: f64::NAN, pred_loss: mean(false).unwrap_or(f64::NAN), extrap_loss: mean(true) };
    Ok(Scores { clips: clips.len().min(count), losses, predicted_frames, states: None })
}

/// The mean squared error, summed over a frame, of all frames after the input, on the first `count` clips.
///
/// # Errors
/// None that clips of a task could cause.
pub fn prediction_error(model: &dyn FrameModel, system: &System, clips: &Clips, count: usize) -> Result<f64> {
    let (mut sum, mut frames) = (0.0, 0);
    each_prediction(model, system, clips, count, |clips, predicted| {
        let truth = clips.narrow(1, system.input_steps as i64, predicted.size()[1]);
        sum += (predicted - truth).square().sum(Kind::Double).to_device(Device::Cpu).double_value(&[]);
        frames += predicted.size()[0] * predicted.size()[1];
        Ok(())
    })?;
    Ok(sum / frames as f64)
}
