//! VideoLSTM: a convolutional LSTM encoder-forecaster on frames, without objects, positions or physics.
//!
//! Srivastava et al. 2015 in the convolutional form of Shi et al. 2015: a frame is cut into 4 x 4 patches; two layers take
//! in the L input frames; two others begin with the memory of those and predict, each frame from the one before; a 1 x 1
//! convolution of both layers' memories gives the logits of the next frame. Sizes are ours: 64 channels, 3 x 3 kernels.

use tch::Tensor;
use tch::nn::VarStore;

use super::conv_lstm::ConvLstmCell;
use super::frame_model::{Batch, FrameModel};
use crate::kernels::Kernels;
use crate::network::System;
use crate::network::blocks::{Activation, Conv2d, Layers};
use crate::network::cells::Actions;
use crate::network::initial_values::glorot_uniform;
use crate::network::physics_models::losses::frame_error;

/// Side of a patch, pixels.
const PATCH: i64 = 4;
/// Channels of a layer's memory.
const HIDDEN: usize = 64;
const LAYERS: usize = 2;
/// Side of a kernel.
const KERNEL: usize = 3;

type Memory = Vec<[Tensor; 2]>;

/// Encoder, forecaster and read-out.
#[derive(Debug)]
pub struct VideoLstm {
    variables: VarStore,
    encoder: Vec<ConvLstmCell>,
    forecaster: Vec<ConvLstmCell>,
    output: Conv2d,
    input_steps: i64,
}

impl VideoLstm {
    /// A fresh model with initial values drawn from `seed`.
    pub fn new(system: &System, seed: u64) -> Self {
        let variables = VarStore::new(tch::Device::Cpu);
        let patch = system.channels * (PATCH * PATCH) as usize;
        let cells = |scope: &str| {
            let mut layers = Layers::new(variables.root() / scope);
            let inputs = [patch, HIDDEN];
            inputs.map(|inputs| ConvLstmCell::new(&mut layers, inputs, HIDDEN, KERNEL)).into()
        };
        let (encoder, forecaster) = (cells("encoder"), cells("forecaster"));
        let output = Layers::new(variables.root() / "output").conv2d(LAYERS * HIDDEN, patch, 1, Activation::None);
        glorot_uniform(&variables, seed);
        VideoLstm { variables, encoder, forecaster, output, input_steps: system.input_steps as i64 }
    }

    fn step(cells: &[ConvLstmCell], frame: &Tensor, memory: &Memory) -> Memory {
        let mut x = frame.pixel_unshuffle(PATCH);
        let mut after = Memory::new();
        for (cell, before) in cells.iter().zip(memory) {
            after.push(cell.step(&x, before));
            x = after[after.len() - 1][0].shallow_clone();
        }
        after
    }

    fn encoded(&self, input: &Tensor) -> Memory {
        let like = input.select(1, 0).pixel_unshuffle(PATCH);
        let mut memory: Memory = self.encoder.iter().map(|cell| cell.start(&like)).collect();
        for frame in 0..input.size()[1] {
            memory = Self::step(&self.encoder, &input.select(1, frame), &memory);
        }
        memory
    }
}

impl FrameModel for VideoLstm {
    fn variables(&self) -> &VarStore {
        &self.variables
    }

    /// The squared error of all frames after the input.
    fn loss(&self, batch: &Batch, _step: u64) -> Tensor {
        let clips = &batch.frames;
        let after = clips.size()[1] - self.input_steps;
        let truth = clips.narrow(1, self.input_steps, after);
        frame_error(
            Kernels::Own,
            &self.predict(&clips.narrow(1, 0, self.input_steps), &batch.actions, after as usize),
            &truth,
        )
    }

    fn predict(&self, input: &Tensor, _actions: &Actions, frames: usize) -> Tensor {
        let mut memory = self.encoded(input);
        let mut frame = input.select(1, input.size()[1] - 1);
        let mut predicted = Vec::with_capacity(frames);
        for _ in 0..frames {
            memory = Self::step(&self.forecaster, &frame, &memory);
            let states: Vec<&Tensor> = memory.iter().map(|[h, _]| h).collect();
            frame = self.output.forward(&Tensor::cat(&states, 1)).pixel_shuffle(PATCH).sigmoid();
            predicted.push(frame.shallow_clone());
        }
        Tensor::stack(&predicted, 1)
    }
}
