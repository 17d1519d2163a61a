//! The one loop over batches: a model's passes over clips.

use anyhow::Result;
use tch::{Device, Tensor};

use crate::datasets::iterators::Clips;
use crate::network::physics_models::{ForwardPass, PhysicsNet};

/// Frames in one pass, which bounds the memory; a GPU takes as long for fewer.
const FRAMES: usize = 300;
const FRAMES_ON_GPU: usize = 2000;

/// So many of these clips make one pass.
pub fn batch(clips: &Clips) -> usize {
    let frames = if clips.device() == Device::Cpu { FRAMES } else { FRAMES_ON_GPU };
    (frames / clips.time().max(1)).max(1)
}

/// Passes the first `count` clips (all, if there are fewer) through the model, `batch` at a time and without gradient.
/// `see` is given the places of a batch's clips, their frames `[batch, time, channels, S, S]`, and the pass.
///
/// # Errors
/// Clips shorter than L + T_pred, an error of `see`.
pub(crate) fn each_pass(
    model: &PhysicsNet,
    clips: &Clips,
    count: usize,
    batch: usize,
    mut see: impl FnMut(&[i64], &Tensor, ForwardPass) -> Result<()>,
) -> Result<()> {
    let _guard = tch::no_grad_guard();
    let all: Vec<i64> = (0..clips.len().min(count) as i64).collect();
    for chosen in all.chunks(batch) {
        let frames = clips.batch(chosen, clips.time());
        let pass = model.forward(&frames, &clips.actions(chosen))?;
        see(chosen, &frames, pass)?;
    }
    Ok(())
}
