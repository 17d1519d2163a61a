//! What the model makes of the first test clips, gathered in small batches.

use anyhow::Result;
use tch::{Device, Tensor};

use crate::datasets::iterators::Clips;
use crate::network::cells::State;
use crate::network::physics_models::PhysicsNet;

/// Clips in one pass, which bounds the memory.
pub(super) const BATCH: usize = 25;

/// The model's view of clips, on the CPU.
pub(super) struct Outputs {
    /// `[clips, T, C, S, S]` in \[0, 1\].
    pub clips: Tensor,
    /// `[clips, T - L, C, S, S]`.
    pub predictions: Tensor,
    /// `[clips, L + T_pred, C, S, S]`.
    pub reconstructions: Tensor,
    /// Encoded positions, `[clips, L + T_pred, coordinates * objects]`.
    pub positions: Tensor,
    /// Positions, then velocities, from the last input frame on, `[clips, 1 + T - L, 2 * coordinates * objects]`.
    pub states: Tensor,
}

impl Outputs {
    /// Of the first `count` clips, or of all if there are fewer.
    pub(super) fn of(model: &PhysicsNet, clips: &Clips, count: usize) -> Result<Self> {
        let all: Vec<i64> = (0..clips.len().min(count) as i64).collect();
        let mut parts: [Vec<Tensor>; 5] = Default::default();
        for chosen in all.chunks(BATCH) {
            let frames = clips.batch(chosen, clips.time());
            let pass = model.forward(&frames, &clips.actions(chosen))?;
            let states: Vec<_> = std::iter::once(&pass.initial).chain(&pass.states).map(State::joined).collect();
            let results = [frames, pass.predictions, pass.reconstructions, pass.positions, Tensor::stack(&states, 1)];
            for (part, result) in parts.iter_mut().zip(results) {
                part.push(result.to_device(Device::Cpu));
            }
        }
        let [clips, predictions, reconstructions, positions, states] = parts.map(|part| Tensor::cat(&part, 0));
        Ok(Outputs { clips, predictions, reconstructions, positions, states })
    }

    /// Number of clips.
    pub(super) fn len(&self) -> usize {
        self.clips.size()[0] as usize
    }

    /// Frames in a clip.
    pub(super) fn time(&self) -> usize {
        self.clips.size()[1] as usize
    }

    /// The L input frames of a clip and the predicted ones after them, `[T, C, S, S]`.
    pub(super) fn input_and_prediction(&self, clip: usize) -> Tensor {
        let predicted = self.predictions.get(clip as i64);
        let input = self.time() as i64 - predicted.size()[0];
        Tensor::cat(&[self.clips.get(clip as i64).narrow(0, 0, input), predicted], 0)
    }
}
