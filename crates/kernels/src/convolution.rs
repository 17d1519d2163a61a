//! A convolution 3x3 by itself, forward and backward, on blocks of pictures: for a layer that is applied again and again
//! with the same weights, as a recurrent one is. They are transformed once.

use std::sync::Arc;

use super::bias_gradient::add_bias_gradient;
use super::packing;
use super::planes::{OwnedPlanes, Workspace};
use super::recycled::Recycled;
use super::simd::Instructions;
use super::threads::{in_parallel, part_of, workers_each};
use super::weight_gradient::add_weight_gradient;
use super::winograd::{self, Finish, WinogradWeights};

/// What a layer keeps from step to step.
#[derive(Debug)]
pub struct ConvolutionMemory {
    inputs: Recycled<OwnedPlanes>,
    outputs: Recycled<OwnedPlanes>,
    workspaces: Recycled<Vec<Workspace>>,
}

impl ConvolutionMemory {
    pub fn new() -> Self {
        ConvolutionMemory { inputs: Recycled::new(), outputs: Recycled::new(), workspaces: Recycled::new() }
    }
}

/// A layer with the weights of one moment.
#[derive(Debug)]
pub struct ConvolutionKernel {
    instructions: Instructions,
    inputs: usize,
    outputs: usize,
    forward: WinogradWeights,
    backward: WinogradWeights,
    memory: Arc<ConvolutionMemory>,
}

/// What the gradient needs of some pictures. Its memory goes back when it is dropped.
#[derive(Debug)]
pub struct ConvolutionPass {
    kernel: Arc<ConvolutionKernel>,
    side: usize,
    seen: Vec<OwnedPlanes>,
}

impl Drop for ConvolutionPass {
    fn drop(&mut self) {
        self.seen.drain(..).for_each(|block| self.kernel.memory.inputs.give(block));
    }
}

/// Gradients of the weights, `[outputs, inputs, 3, 3]`, and of the biases.
type Sums = (Vec<f32>, Vec<f32>);

impl ConvolutionKernel {
    /// Of `weight` `[outputs, inputs, 3, 3]`; inputs and outputs fill [tiles](Self::fits).
    pub fn new(instructions: Instructions, weight: &[f32], bias: &[f32], memory: Arc<ConvolutionMemory>) -> Self {
        let outputs = bias.len();
        ConvolutionKernel {
            instructions,
            inputs: weight.len() / (9 * outputs),
            outputs,
            forward: WinogradWeights::forward(instructions, weight, bias),
            backward: WinogradWeights::backward(instructions, weight, outputs),
            memory,
        }
    }

    /// Whether so many channels can be computed with.
    pub fn fits(instructions: Instructions, channels: usize) -> bool {
        channels.is_multiple_of(instructions.tile())
    }

    pub fn outputs(&self) -> usize {
        self.outputs
    }

    fn picture(&self, pool: &Recycled<OwnedPlanes>, channels: usize, side: usize) -> OwnedPlanes {
        let new = || OwnedPlanes::zeros(self.instructions, channels, side);
        let kept = pool.take(new);
        if (kept.channels, kept.side) == (channels, side) { kept } else { new() }
    }

    fn workspaces(&self, workers: usize) -> Vec<Workspace> {
        let mut workspaces = self.memory.workspaces.take(Vec::new);
        workspaces.resize_with(workers, Workspace::default);
        workspaces
    }

    /// Floats of a block of pictures with so many channels.
    fn block(&self, channels: usize, side: usize) -> usize {
        channels * side * side * self.instructions.lanes()
    }

    /// Pictures `[pictures, inputs, side, side]` to `[pictures, outputs, side, side]`.
    pub fn forward(self: &Arc<Self>, side: usize, pictures: &[f32], results: &mut [f32]) -> ConvolutionPass {
        let ConvolutionMemory { inputs, outputs, workspaces } = &*self.memory;
        assert_eq!(pictures.len() * self.outputs, results.len() * self.inputs, "as many results as pictures");
        let blocks = pictures.chunks(self.block(self.inputs, side));
        let blocks: Vec<_> = blocks.zip(results.chunks_mut(self.block(self.outputs, side))).collect();
        let workers = workers_each(blocks.len());
        let seen = in_parallel(blocks, |(pictures, results)| {
            let mut input = self.picture(inputs, self.inputs, side);
            let mut output = self.picture(outputs, self.outputs, side);
            let mut work = self.workspaces(workers);
            packing::pack(self.instructions, pictures, input.all_mut());
            let (weights, finish) = (&self.forward, Finish::Linear);
            winograd::convolve(self.instructions, weights, input.all(), output.all_mut(), finish, &mut work);
            packing::unpack(self.instructions, output.all(), results);
            outputs.give(output);
            workspaces.give(work);
            input
        });
        ConvolutionPass { kernel: Arc::clone(self), side, seen }
    }
}

impl ConvolutionPass {
    /// From the gradient of the results `[pictures, outputs, side, side]` those of the pictures, which are written to
    /// `by_pictures`, and of weights and biases.
    pub fn backward(&self, gradient: &[f32], by_pictures: &mut [f32]) -> Sums {
        let (kernel, side) = (&*self.kernel, self.side);
        let by_pictures = by_pictures.chunks_mut(kernel.block(kernel.inputs, side));
        let blocks = self.seen.iter().zip(gradient.chunks(kernel.block(kernel.outputs, side)));
        let mut blocks: Vec<_> = blocks.zip(by_pictures).collect();
        let part = part_of(blocks.len());
        let parts: Vec<_> = blocks.chunks_mut(part).collect();
        let workers = workers_each(parts.len());
        let sums = in_parallel(parts, |part| {
            let mut sums = (vec![0.0; kernel.outputs * kernel.inputs * 9], vec![0.0; kernel.outputs]);
            for ((seen, gradient), by_pictures) in part {
                kernel.backward_block(seen, gradient, by_pictures, &mut sums, workers);
            }
            sums
        });
        let add = |total: &mut Vec<f32>, part: Vec<f32>| total.iter_mut().zip(part).for_each(|(a, b)| *a += b);
        let total = sums.into_iter().reduce(|mut total, part| {
            add(&mut total.0, part.0);
            add(&mut total.1, part.1);
            total
        });
        total.expect("there is at least one picture")
    }
}

impl ConvolutionKernel {
    fn backward_block(
        &self,
        seen: &OwnedPlanes,
        gradient: &[f32],
        by_pictures: &mut [f32],
        (by_weight, by_bias): &mut Sums,
        workers: usize,
    ) {
        let ConvolutionMemory { inputs, outputs, workspaces } = &*self.memory;
        let instructions = self.instructions;
        let mut pull = self.picture(outputs, self.outputs, seen.side);
        let mut by_input = self.picture(inputs, self.inputs, seen.side);
        let mut work = self.workspaces(workers);
        packing::pack(instructions, gradient, pull.all_mut());
        add_weight_gradient(instructions, seen.all(), pull.all(), by_weight, &mut work);
        add_bias_gradient(instructions, pull.all(), by_bias);
        winograd::convolve(instructions, &self.backward, pull.all(), by_input.all_mut(), Finish::Linear, &mut work);
        packing::unpack(instructions, by_input.all(), by_pictures);
        outputs.give(pull);
        inputs.give(by_input);
        workspaces.give(work);
    }
}
