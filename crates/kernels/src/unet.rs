//! The U-Net, forward and backward, on blocks of frames.
//!
//! The network is that of [`crate::UNetOperation`]. A block goes through all layers before the next one begins, so that
//! most of what a layer reads is still in the cache. Every layer's result is kept for the gradient, except the doubled
//! pictures, which are made again.

use std::ops::Range;
use std::sync::Arc;

use super::bias_gradient::add_bias_gradient;
use super::conv1x1;
use super::packing;
use super::planes::{OwnedPlanes, Planes, PlanesMut, Workspace};
use super::recycled::Recycled;
use super::resample::{self, Pooled};
use super::simd::Instructions;
use super::threads::{in_parallel, part_of, workers_each};
use super::weight_gradient::add_weight_gradient;
use super::winograd::{self, Finish, WinogradWeights};

/// What frames go through.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Pixels, a multiple of 2 to the number of poolings.
    pub side: usize,
    pub channels: usize,
    pub objects: usize,
    /// Channels of the first level, a multiple of 8; each level below has twice as many.
    pub base: usize,
    pub poolings: usize,
}

impl Shape {
    pub(super) fn width(&self, level: usize) -> usize {
        self.base << level
    }

    fn side_of(&self, level: usize) -> usize {
        self.side >> level
    }

    /// Channels of what comes up from the level below.
    pub(super) fn raised(&self) -> usize {
        2 * self.base
    }

    pub(super) fn levels(&self) -> std::ops::RangeInclusive<usize> {
        0..=self.poolings
    }

    /// `(inputs, outputs)` of the layers in the network's order: two for each level, from the lowest level up three each
    /// (after the doubling, and the two after the concatenation), and the logits.
    pub fn layers(&self) -> Vec<(usize, usize)> {
        let mut layers = Vec::new();
        for level in self.levels() {
            let inputs = if level == 0 { self.channels } else { self.width(level - 1) };
            layers.extend([(inputs, self.width(level)), (self.width(level), self.width(level))]);
        }
        for level in (0..self.poolings).rev() {
            let width = self.width(level);
            layers.push((self.width(level + 1), self.raised()));
            layers.extend([(self.raised() + width, width), (width, width)]);
        }
        layers.push((self.base, self.objects));
        layers
    }

    /// Numbers that a frame leaves in all layers, for each of its pixels.
    pub fn numbers_per_pixel(&self) -> f64 {
        let of_level = |level: usize| {
            let inputs = if level == 0 { self.channels } else { self.width(level - 1) };
            let up = if level < self.poolings { self.raised() + 2 * self.width(level) } else { 0 };
            (inputs + 2 * self.width(level) + up) as f64 / 4f64.powi(level as i32)
        };
        self.levels().map(of_level).sum()
    }

    /// The number of the first layer of a level on the way down.
    pub(super) fn down(&self, level: usize) -> usize {
        2 * level
    }

    /// The number of the first layer of a level on the way up.
    pub(super) fn up(&self, level: usize) -> usize {
        2 * (self.poolings + 1) + 3 * (self.poolings - 1 - level)
    }
}

/// A network's results on a block.
#[derive(Debug)]
struct Activations {
    /// What each level's first layer sees: the frames, and the level above, pooled.
    inputs: Vec<OwnedPlanes>,
    /// Results of the first layers on the way down.
    firsts: Vec<OwnedPlanes>,
    /// What came up from below, and the results of the second layers on the way down. None on the lowest level.
    joined: Vec<OwnedPlanes>,
    /// Results of the first layers on the way up.
    up_firsts: Vec<OwnedPlanes>,
    /// What each level hands up.
    outputs: Vec<OwnedPlanes>,
}

/// Pictures that are not kept.
#[derive(Debug)]
struct Scratch {
    /// What each level hands up, doubled, by the level that takes it.
    doubled: Vec<OwnedPlanes>,
    logits: OwnedPlanes,
    /// One for each thread that works on the block.
    workspaces: Vec<Workspace>,
}

/// Gradients of a block, named as the results are.
#[derive(Debug)]
struct BlockGradients {
    inputs: Vec<OwnedPlanes>,
    firsts: Vec<OwnedPlanes>,
    joined: Vec<OwnedPlanes>,
    doubled: Vec<OwnedPlanes>,
    outputs: Vec<OwnedPlanes>,
    logits: OwnedPlanes,
    /// Of weights and biases.
    sums: Vec<f32>,
}

#[derive(Debug)]
struct UnetMemory {
    activations: Recycled<Activations>,
    scratch: Recycled<Scratch>,
    gradients: Recycled<BlockGradients>,
}

/// The kernels of one network.
#[derive(Debug, Clone)]
pub struct UnetKernel {
    instructions: Instructions,
    shape: Shape,
    memory: Arc<UnetMemory>,
}

/// The weights of a network at one moment, as the kernels read them.
struct Network {
    forward: Vec<WinogradWeights>,
    /// Of all but the first layer.
    backward: Vec<Option<WinogradWeights>>,
    logits: (Vec<f32>, Vec<f32>),
}

/// What a forward pass leaves for the gradient. Its memory goes back when it is dropped.
pub struct UnetPass {
    kernel: UnetKernel,
    network: Network,
    blocks: Vec<Option<Activations>>,
}

impl Drop for UnetPass {
    fn drop(&mut self) {
        for block in self.blocks.drain(..).flatten() {
            self.kernel.memory.activations.give(block);
        }
    }
}

impl UnetKernel {
    pub fn new(instructions: Instructions, shape: Shape) -> Self {
        let memory = UnetMemory { activations: Recycled::new(), scratch: Recycled::new(), gradients: Recycled::new() };
        UnetKernel { instructions, shape, memory: Arc::new(memory) }
    }

    pub fn shape(&self) -> Shape {
        self.shape
    }

    fn picture(&self, channels: usize, level: usize) -> OwnedPlanes {
        OwnedPlanes::zeros(self.instructions, channels, self.shape.side_of(level))
    }

    fn activations(&self) -> Activations {
        let shape = &self.shape;
        let inputs = |level| if level == 0 { shape.channels } else { shape.width(level - 1) };
        let wide = |level| self.picture(shape.width(level), level);
        Activations {
            inputs: shape.levels().map(|level| self.picture(inputs(level), level)).collect(),
            firsts: shape.levels().map(wide).collect(),
            joined: (0..shape.poolings).map(|level| self.picture(shape.raised() + shape.width(level), level)).collect(),
            up_firsts: (0..shape.poolings).map(wide).collect(),
            outputs: shape.levels().map(wide).collect(),
        }
    }

    fn doubled(&self) -> Vec<OwnedPlanes> {
        (0..self.shape.poolings).map(|level| self.picture(self.shape.width(level + 1), level)).collect()
    }

    fn scratch(&self) -> Scratch {
        let logits = self.picture(self.shape.objects, 0);
        Scratch { doubled: self.doubled(), logits, workspaces: Vec::new() }
    }

    /// Memory for so many threads.
    fn scratch_for(&self, workers: usize) -> Scratch {
        let mut scratch = self.memory.scratch.take(|| self.scratch());
        scratch.workspaces.resize_with(workers, Workspace::default);
        scratch
    }

    fn gradients(&self) -> BlockGradients {
        let Activations { inputs, firsts, joined, outputs, .. } = self.activations();
        let numbers: usize = self.places().last().map_or(0, |place| place.end);
        let (logits, sums) = (self.picture(self.shape.objects, 0), vec![0.0; numbers]);
        BlockGradients { inputs, firsts, joined, doubled: self.doubled(), outputs, logits, sums }
    }

    /// Where each layer's weights and biases stand among all numbers of the network: weights, then biases.
    fn places(&self) -> Vec<Range<usize>> {
        let layers = self.shape.layers();
        let last = layers.len() - 1;
        let mut end = 0;
        let place = |(layer, (inputs, outputs)): (usize, (usize, usize))| {
            let start = end;
            end += inputs * outputs * if layer == last { 1 } else { 9 } + outputs;
            start..end
        };
        layers.into_iter().enumerate().map(place).collect()
    }

    fn network(&self, layers: &[(Vec<f32>, Vec<f32>)], backward: bool) -> Network {
        let instructions = self.instructions;
        let (logits, convolutions) = layers.split_last().expect("a network has layers");
        let turned = |(layer, (weight, bias)): (usize, &(Vec<f32>, Vec<f32>))| {
            (backward && layer > 0).then(|| WinogradWeights::backward(instructions, weight, bias.len()))
        };
        Network {
            forward: convolutions
                .iter()
                .map(|(weight, bias)| WinogradWeights::forward(instructions, weight, bias))
                .collect(),
            backward: convolutions.iter().enumerate().map(turned).collect(),
            logits: logits.clone(),
        }
    }

    /// Frames `[frames, channels, S, S]` to logits `[frames, objects, S, S]`; `layers` are weights and biases in the
    /// network's order. Gives what the gradient needs if it is asked for.
    pub fn forward(
        &self,
        layers: &[(Vec<f32>, Vec<f32>)],
        frames: &[f32],
        logits: &mut [f32],
        keep: bool,
    ) -> Option<UnetPass> {
        let network = self.network(layers, keep);
        let (seen, made) = (self.floats(self.shape.channels), self.floats(self.shape.objects));
        assert_eq!(frames.len() / seen, logits.len() / made, "as many logits as frames");
        let blocks: Vec<_> = frames.chunks(seen * self.lanes()).zip(logits.chunks_mut(made * self.lanes())).collect();
        let workers = workers_each(blocks.len());
        let blocks = in_parallel(blocks, |(frames, logits)| {
            let mut results = self.memory.activations.take(|| self.activations());
            let mut scratch = self.scratch_for(workers);
            self.forward_block(&network, frames, &mut results, &mut scratch, logits);
            self.memory.scratch.give(scratch);
            if keep {
                return Some(results);
            }
            self.memory.activations.give(results);
            None
        });
        keep.then(|| UnetPass { kernel: self.clone(), network, blocks })
    }

    fn lanes(&self) -> usize {
        self.instructions.lanes()
    }

    /// Of so many channels of a frame.
    fn floats(&self, channels: usize) -> usize {
        channels * self.shape.side * self.shape.side
    }

    fn forward_block(
        &self,
        network: &Network,
        frames: &[f32],
        results: &mut Activations,
        scratch: &mut Scratch,
        logits: &mut [f32],
    ) {
        let (instructions, shape, layers) = (self.instructions, &self.shape, &network.forward);
        let raised = shape.raised();
        let Activations { inputs, firsts, joined, up_firsts, outputs } = results;
        let Scratch { doubled, logits: made, workspaces } = scratch;
        let mut convolve = |weights: &WinogradWeights, input: Planes, output: PlanesMut, finish: Finish| {
            winograd::convolve(instructions, weights, input, output, finish, workspaces);
        };
        packing::pack(instructions, frames, inputs[0].all_mut());
        for level in shape.levels() {
            if level > 0 {
                let above = joined[level - 1].part(raised, shape.width(level - 1));
                resample::max_pool(instructions, above, inputs[level].all_mut());
            }
            let layer = &layers[shape.down(level)..];
            convolve(&layer[0], inputs[level].all(), firsts[level].all_mut(), Finish::Relu);
            let second = match joined.get_mut(level) {
                Some(joined) => joined.part_mut(raised, shape.width(level)),
                None => outputs[level].all_mut(),
            };
            convolve(&layer[1], firsts[level].all(), second, Finish::Relu);
        }
        for level in (0..shape.poolings).rev() {
            let (layer, doubled) = (&layers[shape.up(level)..], &mut doubled[level]);
            resample::double(instructions, outputs[level + 1].all(), doubled.all_mut());
            let risen = joined[level].part_mut(0, raised);
            convolve(&layer[0], doubled.all(), risen, Finish::Linear);
            convolve(&layer[1], joined[level].all(), up_firsts[level].all_mut(), Finish::Relu);
            convolve(&layer[2], up_firsts[level].all(), outputs[level].all_mut(), Finish::Relu);
        }
        let (weight, bias) = &network.logits;
        conv1x1::forward(instructions, weight, bias, outputs[0].all(), made.all_mut());
        packing::unpack(instructions, made.all(), logits);
    }
}

impl UnetPass {
    /// From the gradient of the logits, `[frames, objects, S, S]`, those of weights and biases in the network's order.
    pub fn backward(&self, logits: &[f32]) -> Vec<(Vec<f32>, Vec<f32>)> {
        let kernel = &self.kernel;
        let block = kernel.floats(kernel.shape.objects) * kernel.lanes();
        let blocks: Vec<_> = self.blocks.iter().flatten().zip(logits.chunks(block)).collect();
        let parts: Vec<_> = blocks.chunks(part_of(blocks.len())).collect();
        let places = kernel.places();
        let numbers = places.last().map_or(0, |place| place.end);
        let workers = workers_each(parts.len());
        let sums = in_parallel(parts, |part| {
            let mut gradients = kernel.memory.gradients.take(|| kernel.gradients());
            let mut scratch = kernel.scratch_for(workers);
            gradients.sums.fill(0.0);
            for (results, logits) in part {
                self.backward_block(results, logits, &mut gradients, &mut scratch, &places);
            }
            let sums = gradients.sums.clone();
            kernel.memory.scratch.give(scratch);
            kernel.memory.gradients.give(gradients);
            sums
        });
        let mut total = vec![0.0; numbers];
        for part in sums {
            total.iter_mut().zip(part).for_each(|(total, part)| *total += part);
        }
        let layers = kernel.shape.layers().into_iter().zip(&places);
        let layer = |((_, outputs), place): ((usize, usize), &Range<usize>)| {
            let (weights, biases) = total[place.clone()].split_at(place.len() - outputs);
            (weights.to_vec(), biases.to_vec())
        };
        layers.map(layer).collect()
    }

    fn backward_block(
        &self,
        results: &Activations,
        logits: &[f32],
        gradients: &mut BlockGradients,
        scratch: &mut Scratch,
        places: &[Range<usize>],
    ) {
        let (instructions, shape) = (self.kernel.instructions, &self.kernel.shape);
        let raised = shape.raised();
        let Activations { inputs, firsts, joined, up_firsts, outputs } = results;
        let Scratch { doubled, workspaces, .. } = scratch;
        let operations = &mut Operations { instructions, places, sums: &mut gradients.sums, workspaces };
        let back = |layer: usize| self.network.backward[layer].as_ref().expect("only the first layer has none");

        packing::pack(instructions, logits, gradients.logits.all_mut());
        operations.add_logits(&self.network.logits.0, &outputs[0], &gradients.logits, &mut gradients.outputs[0]);
        for level in 0..shape.poolings {
            let layer = shape.up(level);
            let (output, first) = (&gradients.outputs[level], &mut gradients.firsts[level]);
            operations.add(layer + 2, up_firsts[level].all(), output.all());
            let gate = Finish::WherePositive(up_firsts[level].all());
            operations.convolve(back(layer + 2), output.all(), first.all_mut(), gate);

            operations.add(layer + 1, joined[level].all(), first.all());
            let both = &mut gradients.joined[level];
            operations.convolve(back(layer + 1), first.all(), both.all_mut(), Finish::Linear);

            let (below, doubled) = (outputs[level + 1].all(), &mut doubled[level]);
            resample::double(instructions, below, doubled.all_mut());
            let risen = both.part(0, raised);
            operations.add(layer, doubled.all(), risen);
            operations.convolve(back(layer), risen, gradients.doubled[level].all_mut(), Finish::Linear);
            let next = gradients.outputs[level + 1].all_mut();
            resample::double_backward(instructions, gradients.doubled[level].all(), below, next);
        }
        for level in shape.levels().rev() {
            let layer = shape.down(level);
            let output = &mut gradients.outputs[level];
            if level < shape.poolings {
                let width = shape.width(level);
                let pooled = Pooled {
                    activation: joined[level].part(raised, width),
                    pooled: inputs[level + 1].all(),
                    pooled_gradient: gradients.inputs[level + 1].all(),
                    other_gradient: gradients.joined[level].part(raised, width),
                };
                resample::max_pool_backward(instructions, pooled, output.all_mut());
            }
            let first = &mut gradients.firsts[level];
            operations.add(layer + 1, firsts[level].all(), output.all());
            let gate = Finish::WherePositive(firsts[level].all());
            operations.convolve(back(layer + 1), output.all(), first.all_mut(), gate);
            operations.add(layer, inputs[level].all(), first.all());
            if level > 0 {
                let input = gradients.inputs[level].all_mut();
                operations.convolve(back(layer), first.all(), input, Finish::Linear);
            }
        }
    }
}

/// The operations of a gradient: where they add those of weights and biases, and their memory.
struct Operations<'a> {
    instructions: Instructions,
    places: &'a [Range<usize>],
    sums: &'a mut [f32],
    workspaces: &'a mut [Workspace],
}

impl Operations<'_> {
    fn convolve(&mut self, weights: &WinogradWeights, input: Planes, output: PlanesMut, finish: Finish) {
        winograd::convolve(self.instructions, weights, input, output, finish, self.workspaces);
    }

    /// Adds the gradients of a layer's weights and biases.
    fn add(&mut self, layer: usize, input: Planes, gradient: Planes) {
        let sums = &mut self.sums[self.places[layer].clone()];
        let (weights, biases) = sums.split_at_mut(sums.len() - gradient.channels);
        add_weight_gradient(self.instructions, input, gradient, weights, self.workspaces);
        add_bias_gradient(self.instructions, gradient, biases);
    }

    /// The last layer's, and the gradient before it.
    fn add_logits(&mut self, weight: &[f32], input: &OwnedPlanes, gradient: &OwnedPlanes, output: &mut OwnedPlanes) {
        let sums = &mut self.sums[self.places[self.places.len() - 1].clone()];
        let (weights, biases) = sums.split_at_mut(sums.len() - gradient.channels);
        conv1x1::backward(self.instructions, weight, input.all(), gradient.all(), output.all_mut(), weights);
        add_bias_gradient(self.instructions, gradient.all(), biases);
    }
}
