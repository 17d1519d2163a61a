//! The gradients of a 3x3 convolution's weights, on blocks of frames, by [minimal filtering](super::filtering).
//!
//! A kernel's nine weights are moved by sums over the result's gradients times what the kernel saw there. Both are
//! transformed, tile by tile; their products are summed over all tiles and frames, and the sums transformed back.

use super::filtering::{PIXELS, PRODUCTS, Tiles, transform_gradient, transform_input};
use super::planes::{Planes, Workspace};
use super::simd::Instructions;
use super::threads::side_by_side;

mod by_frames;
mod by_outputs;

/// What stands in the lanes of the sums.
#[derive(Debug, Clone, Copy)]
enum Lane {
    /// A sum for each frame, summed at the end. Where a layer has fewer results than a vector has lanes.
    Frame,
    /// An output channel: a sixteenth of the sums, with AVX-512.
    Output,
}

impl Lane {
    fn of(instructions: Instructions, outputs: usize) -> Self {
        if outputs.is_multiple_of(instructions.lanes()) { Lane::Output } else { Lane::Frame }
    }

    /// Output channels whose products are summed together.
    fn outputs(self, instructions: Instructions) -> usize {
        match self {
            Lane::Frame => instructions.tile(),
            Lane::Output => instructions.lanes(),
        }
    }

    /// Input channels that are transformed together, and tiles over which their products are summed in registers: with both
    /// the transformed pixels fill half of the second cache.
    fn together(self) -> (usize, usize) {
        match self {
            Lane::Frame => (16, 16),
            Lane::Output => (64, 4),
        }
    }
}

/// Adds the gradient of a convolution's weights, `[outputs, inputs, 3, 3]`, to `sums`, on as many threads as there are
/// workspaces: each sums for output channels of its own.
pub fn add_weight_gradient(
    instructions: Instructions,
    input: Planes,
    gradient: Planes,
    sums: &mut [f32],
    workspaces: &mut [Workspace],
) {
    let lane = Lane::of(instructions, gradient.channels);
    let (each, outputs) = (sums.len() / gradient.channels, lane.outputs(instructions));
    let channels = (gradient.channels / outputs).div_ceil(workspaces.len()) * outputs;
    let parts = sums.chunks_mut(channels * each).enumerate();
    let parts = parts.map(|(part, sums)| (gradient.part(part * channels, sums.len() / each), sums));
    side_by_side(workspaces, parts.collect(), |workspace, (gradient, sums)| {
        add_some(instructions, lane, input, gradient, sums, workspace);
    });
}

fn add_some(
    instructions: Instructions,
    lane: Lane,
    input: Planes,
    gradient: Planes,
    sums: &mut [f32],
    workspace: &mut Workspace,
) {
    let (side, all, vector, outputs) = (input.side, input.channels, instructions.lanes(), lane.outputs(instructions));
    assert!(gradient.side == side && gradient.channels.is_multiple_of(outputs));
    assert!(sums.len() == gradient.channels * all * 9);
    let (group, most) = lane.together();
    let group = group.min(all);
    let tiles = side.div_ceil(PIXELS);
    let wide = tiles.div_ceil(tiles.div_ceil(most));
    let high = (most / tiles).clamp(1, tiles);
    let largest = Tiles { rows: 0..high, columns: 0..wide };
    // Floats of an input's sums with the outputs whose products are summed together.
    let of_input = match lane {
        Lane::Frame => PRODUCTS * outputs * vector,
        Lane::Output => PRODUCTS * outputs,
    };
    let [between, seen, moved, turned, totals] = workspace.parts([
        largest.between() * vector,
        largest.transformed(group) * vector,
        largest.transformed(outputs) * vector,
        largest.count() * outputs * vector,
        of_input * group * (gradient.channels / outputs),
    ]);
    for first in (0..all).step_by(group) {
        let input = input.part(first, group.min(all - first));
        let of_outputs = of_input * input.channels;
        totals.fill(0.0);
        for row in (0..tiles).step_by(high) {
            for column in (0..tiles).step_by(wide) {
                let tiles = Tiles { rows: row..tiles.min(row + high), columns: column..tiles.min(column + wide) };
                transform_input(instructions, input, &tiles, between, seen);
                for (place, totals) in (0..gradient.channels).step_by(outputs).zip(totals.chunks_mut(of_outputs)) {
                    transform_gradient(instructions, gradient.part(place, outputs), &tiles, between, moved);
                    match lane {
                        Lane::Frame => by_frames::add(instructions, &tiles, input.channels, seen, moved, totals),
                        Lane::Output => {
                            by_outputs::add(instructions, &tiles, input.channels, seen, moved, turned, totals)
                        }
                    }
                }
            }
        }
        for (totals, sums) in totals.chunks(of_outputs).zip(sums.chunks_mut(outputs * all * 9)) {
            let kernels = KernelGradients { sums, all, first, inputs: input.channels };
            match lane {
                Lane::Frame => by_frames::finish(instructions, totals, kernels),
                Lane::Output => by_outputs::finish(instructions, totals, kernels),
            }
        }
    }
}

/// The gradients of the kernels of some outputs, `[output][input][y][x]`, of which those of some inputs are to be added.
#[derive(Debug)]
struct KernelGradients<'a> {
    sums: &'a mut [f32],
    all: usize,
    first: usize,
    inputs: usize,
}

impl KernelGradients<'_> {
    #[inline(always)]
    fn add(&mut self, output: usize, input: usize, tap: usize, part: f32) {
        self.sums[(output * self.all + self.first + input) * 9 + tap] += part;
    }
}
