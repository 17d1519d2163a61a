//! What the model makes of the first test clips, gathered in small batches.

use anyhow::Result;
use tch::{Device, Tensor};

use super::passes::{batch, each_pass};
use crate::datasets::iterators::Clips;
use crate::network::physics_models::PhysicsNet;

/// The model's view of clips, on the CPU.
#[derive(Debug)]
pub struct Outputs {
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
    ///
    /// # Errors
    /// Clips shorter than L + T_pred.
    pub fn of(model: &PhysicsNet, clips: &Clips, count: usize) -> Result<Self> {
        let mut parts: [Vec<Tensor>; 5] = Default::default();
        each_pass(model, clips, count, batch(clips), |_, frames, pass| {
            let states = pass.sequence();
            let results = [frames.shallow_clone(), pass.predictions, pass.reconstructions, pass.positions, states];
            for (part, result) in parts.iter_mut().zip(results) {
                part.push(result.to_device(Device::Cpu));
            }
            Ok(())
        })?;
        let [clips, predictions, reconstructions, positions, states] = parts.map(|part| Tensor::cat(&part, 0));
        Ok(Outputs { clips, predictions, reconstructions, positions, states })
    }

    /// Number of clips.
    pub fn count(&self) -> usize {
        self.clips.size()[0] as usize
    }

    /// Frames in a clip.
    pub fn time(&self) -> usize {
        self.clips.size()[1] as usize
    }

    /// The L input frames of a clip and the predicted ones after them, `[T, C, S, S]`.
    pub(crate) fn input_and_prediction(&self, clip: usize) -> Tensor {
        let predicted = self.predictions.get(clip as i64);
        let input = self.time() as i64 - predicted.size()[0];
        Tensor::cat(&[self.clips.get(clip as i64).narrow(0, 0, input), predicted], 0)
    }
}
