//! VideoLSTM: a convolutional LSTM encoder-forecaster on frames, without objects, positions or physics.
//!
//! Srivastava et al. 2015 in the convolutional form of Shi et al. 2015: a frame is cut into 8 x 8 patches (or a few
//! more where 8 does not divide its side); two layers take in the L input frames; two others begin with the memory of those
//! and predict, each frame from the one before; a 1 x 1 convolution of both layers' memories gives the logits of the next
//! frame. Sizes are ours: 64 channels, 3 x 3 kernels.

use tch::nn::VarStore;
use tch::{Device, Tensor};

use super::conv_lstm::{ConvLstmCell, PreparedConvLstm};
use super::frame_model::{Batch, FrameModel};
use paig::network::System;
use paig::network::blocks::{Activation, Conv2d, Layers};
use paig::network::cells::Actions;
use paig::network::initial_values::glorot_uniform;
use paig::network::physics_models::losses::frame_error;
use paig_kernels::Kernels;

/// Patches along a frame's side, at least: of 4 x 4 pixels for 32 pixels, of 8 x 8 for 64.
const PATCHES: usize = 8;
/// Channels of a layer's memory.
const HIDDEN: usize = 64;
const LAYERS: usize = 2;
/// Side of a kernel.
const KERNEL: usize = 3;

type LstmMemory = Vec<[Tensor; 2]>;

/// Encoder, forecaster and read-out.
#[derive(Debug)]
pub struct VideoLstm {
    variables: VarStore,
    encoder: Vec<ConvLstmCell>,
    forecaster: Vec<ConvLstmCell>,
    output: Conv2d,
    /// Side of a patch, pixels.
    patch: i64,
    input_steps: i64,
    kernels: Kernels,
}

/// The greatest side of a patch, in pixels, that divides a frame's `side` into [`PATCHES`] or more.
fn side_of_patches(side: usize) -> usize {
    (1..=side / PATCHES).rev().find(|patch| side.is_multiple_of(*patch)).unwrap_or(1)
}

fn prepared(cells: &[ConvLstmCell]) -> Vec<PreparedConvLstm> {
    cells.iter().map(ConvLstmCell::prepared).collect()
}

impl VideoLstm {
    /// A fresh model with initial values drawn from `seed`.
    pub fn new(system: &System, kernels: Kernels, seed: u64, device: Device) -> Self {
        let variables = VarStore::new(device);
        let patch = side_of_patches(system.side);
        let pixels = system.channels * patch * patch;
        let cells = |scope: &str| {
            let mut layers = Layers::new(variables.root() / scope);
            let inputs = [pixels, HIDDEN];
            inputs.map(|inputs| ConvLstmCell::new(&mut layers, inputs, HIDDEN, KERNEL, kernels)).into()
        };
        let (encoder, forecaster) = (cells("encoder"), cells("forecaster"));
        let output = Layers::new(variables.root() / "output").conv2d(LAYERS * HIDDEN, pixels, 1, Activation::None);
        glorot_uniform(&variables, seed);
        VideoLstm {
            variables,
            encoder,
            forecaster,
            output,
            patch: patch as i64,
            input_steps: system.input_steps as i64,
            kernels,
        }
    }

    fn step(&self, cells: &[PreparedConvLstm], frame: &Tensor, memory: &LstmMemory) -> LstmMemory {
        let mut x = frame.pixel_unshuffle(self.patch);
        let mut after = LstmMemory::new();
        for (cell, before) in cells.iter().zip(memory) {
            after.push(cell.step(&x, before));
            x = after[after.len() - 1][0].shallow_clone();
        }
        after
    }

    fn encoded(&self, input: &Tensor) -> LstmMemory {
        let like = input.select(1, 0).pixel_unshuffle(self.patch);
        let mut memory: LstmMemory = self.encoder.iter().map(|cell| cell.start(&like)).collect();
        let encoder = prepared(&self.encoder);
        for frame in 0..input.size()[1] {
            memory = self.step(&encoder, &input.select(1, frame), &memory);
        }
        memory
    }
}

impl FrameModel for VideoLstm {
    fn variables(&self) -> &VarStore {
        &self.variables
    }

    /// The squared error of all frames after the input.
    fn loss(&self, batch: &Batch) -> Tensor {
        let clips = &batch.frames;
        let after = clips.size()[1] - self.input_steps;
        let truth = clips.narrow(1, self.input_steps, after);
        let predicted = self.predict(&clips.narrow(1, 0, self.input_steps), &batch.actions, after as usize);
        frame_error(self.kernels, &predicted, &truth)
    }

    fn predict(&self, input: &Tensor, _actions: &Actions, frames: usize) -> Tensor {
        let mut memory = self.encoded(input);
        let forecaster = prepared(&self.forecaster);
        let mut frame = input.select(1, input.size()[1] - 1);
        let mut predicted = Vec::with_capacity(frames);
        for _ in 0..frames {
            memory = self.step(&forecaster, &frame, &memory);
            let states: Vec<&Tensor> = memory.iter().map(|[h, _]| h).collect();
            frame = self.output.forward(&Tensor::cat(&states, 1)).pixel_shuffle(self.patch).sigmoid();
            predicted.push(frame.shallow_clone());
        }
        Tensor::stack(&predicted, 1)
    }
}

#[cfg(test)]
mod tests {
    use super::side_of_patches;

    /// Frames of every side are cut without a rest into 8 patches a side or a few more.
    #[test]
    fn patches_fill_a_frame() {
        for (side, patch) in [(32, 4), (64, 8), (36, 4), (100, 10), (20, 2), (4, 1)] {
            assert_eq!(side_of_patches(side), patch, "{side} pixels");
        }
    }
}
