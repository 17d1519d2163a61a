//! The clips that an end-to-end baseline is trained, validated and scored on.

use tch::Tensor;

use super::frame_model::Batch;
use paig::datasets::iterators::Clips;

/// The clips of a run.
#[derive(Debug, Clone, Copy)]
pub struct EndToEndData<'a> {
    pub train: &'a Clips,
    /// What their frames are worth, `[clips, time]`, for a model that learns it.
    pub rewards: Option<&'a Tensor>,
    pub valid: &'a Clips,
    pub test: &'a Clips,
    /// Checksums of those for training and validation; empty where nobody says them.
    pub checksums: &'a str,
}

impl EndToEndData<'_> {
    /// The chosen training clips, with random numbers where the model takes them.
    pub(super) fn batch(&self, chosen: &[i64], noise: Option<Tensor>) -> Batch {
        let device = self.train.device();
        let of_chosen = |rewards: &Tensor| rewards.index_select(0, &Tensor::from_slice(chosen)).to_device(device);
        Batch {
            frames: self.train.batch(chosen, self.train.time()),
            actions: self.train.actions(chosen),
            rewards: self.rewards.map(of_chosen),
            noise: noise.map(|numbers| numbers.to_device(device)),
        }
    }
}
