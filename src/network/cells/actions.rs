//! What acts on a system from outside, frame by frame; or the time, for an equation that names it.

use tch::{Device, Kind, Tensor};

/// One number for each frame of each clip, `[batch, frames]`, held until the next frame; or nothing at all.
#[derive(Debug, Default)]
pub struct Actions(Option<Tensor>);

impl Actions {
    pub fn none() -> Self {
        Actions(None)
    }

    /// `[batch, frames]`; number t acts from frame t to frame t + 1.
    pub fn new(values: Option<Tensor>) -> Self {
        Actions(values)
    }

    /// All of them, `[batch, frames]`, if anything acts.
    pub fn values(&self) -> Option<&Tensor> {
        self.0.as_ref()
    }

    /// The same, taken out.
    pub fn into_values(self) -> Option<Tensor> {
        self.0
    }

    /// What acts from a frame to the next, `[batch, 1]`; nothing after the last.
    pub fn at(&self, frame: usize) -> Option<Tensor> {
        self.0
            .as_ref()
            .filter(|values| (frame as i64) < values.size()[1])
            .map(|values| values.narrow(1, frame as i64, 1))
    }

    /// Those from a frame on.
    pub fn since(&self, frame: usize) -> Self {
        Actions(self.0.as_ref().map(|values| values.narrow(1, frame as i64, values.size()[1] - frame as i64)))
    }

    /// Those of some clips, by their places in the batch.
    pub fn of(&self, clips: &Tensor) -> Self {
        Actions(self.0.as_ref().map(|values| values.index_select(0, clips)))
    }

    /// Moved to a device and turned into a kind of number.
    pub fn to(&self, device: Device, kind: Kind) -> Self {
        Actions(self.0.as_ref().map(|values| values.to_device(device).to_kind(kind)))
    }

    /// For a batch in which each clip stands `copies` times, its copies one after the other.
    pub(crate) fn each_repeated(&self, copies: i64) -> Self {
        Actions(self.0.as_ref().map(|values| values.repeat_interleave_self_int(copies, 0, None)))
    }

    /// For a batch that stands as a whole `copies` times.
    pub(crate) fn all_repeated(&self, copies: i64) -> Self {
        Actions(self.0.as_ref().map(|values| values.repeat([copies, 1])))
    }
}
