//! Convolutions 3x3 with zero padding, stride 1, on blocks of frames, and their gradients.

use super::lanes::{Lanes, dispatched};
use super::planes::{Planes, PlanesMut};

/// Pixels in a tile of a convolution along x.
const PIXELS: usize = 3;
/// Pixels over which a weight's gradient is summed before it goes to memory.
const STRETCH: usize = 64;

/// What becomes of a convolution's result.
#[derive(Debug, Clone, Copy)]
pub enum Finish<'a> {
    Linear,
    Relu,
    /// 0 where these planes are not above 0: the gradient through a ReLU that gave them.
    WherePositive(Planes<'a>),
}

/// Weights in the order in which the kernel reads them: `[outputs / tile][inputs][ky][kx][tile]`.
#[derive(Debug, Clone)]
pub struct Weights {
    packed: Vec<f32>,
    bias: Vec<f32>,
}

impl Weights {
    /// Of a convolution, `weight` being `[outputs, inputs, 3, 3]`.
    pub fn forward(tile: usize, weight: &[f32], bias: &[f32]) -> Self {
        let (outputs, inputs) = (bias.len(), weight.len() / (9 * bias.len()));
        let packed = pack(tile, outputs, inputs, |o, i, tap| weight[(o * inputs + i) * 9 + tap]);
        Weights { packed, bias: bias.to_vec() }
    }

    /// Of the convolution that takes the gradient of the result to that of the input: inputs and outputs exchanged, the
    /// kernel turned.
    pub fn backward(tile: usize, weight: &[f32], outputs: usize) -> Self {
        let inputs = weight.len() / (9 * outputs);
        let packed = pack(tile, inputs, outputs, |i, o, tap| weight[(o * inputs + i) * 9 + 8 - tap]);
        Weights { packed, bias: vec![0.0; inputs] }
    }
}

fn pack(tile: usize, outputs: usize, inputs: usize, weight: impl Fn(usize, usize, usize) -> f32) -> Vec<f32> {
    assert!(outputs.is_multiple_of(tile), "{outputs} channels do not fill tiles of {tile}");
    let mut packed = Vec::with_capacity(outputs * inputs * 9);
    for first in (0..outputs).step_by(tile) {
        for input in 0..inputs {
            for tap in 0..9 {
                packed.extend((first..first + tile).map(|output| weight(output, input, tap)));
            }
        }
    }
    packed
}

/// Numbers in the order of [`pack`] back into that of libtorch, `[outputs, inputs, 3, 3]`.
pub fn unpack(tile: usize, inputs: usize, packed: &[f32]) -> Vec<f32> {
    let mut weight = vec![0.0; packed.len()];
    for (first, channels) in packed.chunks_exact(tile * inputs * 9).enumerate() {
        for (place, taps) in channels.chunks_exact(tile).enumerate() {
            for (o, &value) in taps.iter().enumerate() {
                weight[(first * tile + o) * inputs * 9 + place] = value;
            }
        }
    }
    weight
}

dispatched! {
    /// `output = finish(weights * input + bias)`.
    fn convolve(weights: &Weights, input: Planes, output: PlanesMut, finish: Finish) = convolve_lanes
}

#[inline(always)]
fn convolve_lanes<L: Lanes>(weights: &Weights, input: Planes, output: PlanesMut, finish: Finish) {
    match L::OUTPUTS {
        8 => convolve_tiles::<L, 8>(weights, input, output, finish),
        _ => convolve_tiles::<L, 4>(weights, input, output, finish),
    }
}

#[inline(always)]
fn convolve_tiles<L: Lanes, const O: usize>(weights: &Weights, input: Planes, output: PlanesMut, finish: Finish) {
    let (side, row, plane) = (input.side, input.row::<L>(), input.plane::<L>());
    input.check::<L>();
    output.check::<L>();
    assert!(output.side == side && output.channels == weights.bias.len());
    assert!(weights.packed.len() == output.channels * input.channels * 9 && output.channels.is_multiple_of(O));
    if let Finish::WherePositive(gate) = finish {
        gate.check::<L>();
        assert!(gate.side == side && gate.channels == output.channels);
    }
    let (from, to) = (input.data.as_ptr(), output.data.as_mut_ptr());
    for y in 0..side {
        let mut x = 0;
        while x < side {
            let pixels = PIXELS.min(side - x);
            for first in (0..output.channels).step_by(O) {
                // SAFETY: the tile's pixels and their neighbours lie within the planes, whose sizes were checked.
                unsafe {
                    let weights =
                        (weights.packed.as_ptr().add(first * input.channels * 9), weights.bias.as_ptr().add(first));
                    let from = from.add(y * row + x * L::LANES);
                    let place = first * plane + (y + 1) * row + (x + 1) * L::LANES;
                    let tile = Tile { from, weights, inputs: input.channels, row, plane, place, to };
                    match pixels {
                        1 => tile.compute::<L, O, 1>(finish),
                        2 => tile.compute::<L, O, 2>(finish),
                        _ => tile.compute::<L, O, PIXELS>(finish),
                    }
                }
            }
            x += pixels;
        }
    }
}

/// `O` output channels of `P` pixels of a row.
struct Tile {
    /// The upper left neighbour of the first pixel, in the first input channel.
    from: *const f32,
    /// Weights and biases of the first output channel.
    weights: (*const f32, *const f32),
    inputs: usize,
    /// Floats from one row, and from one channel, to the next.
    row: usize,
    plane: usize,
    /// Where the first pixel stands in the result.
    place: usize,
    to: *mut f32,
}

impl Tile {
    #[inline(always)]
    unsafe fn compute<L: Lanes, const O: usize, const P: usize>(&self, finish: Finish) {
        unsafe {
            let mut sums: [[L; P]; O] = std::array::from_fn(|o| [L::splat(*self.weights.1.add(o)); P]);
            let mut weights = self.weights.0;
            for input in 0..self.inputs {
                for ky in 0..3 {
                    let from = self.from.add(input * self.plane + ky * self.row);
                    let mut seen = [L::splat(0.0); PIXELS + 2];
                    for (i, seen) in seen.iter_mut().enumerate().take(P + 2) {
                        *seen = L::load(from.add(i * L::LANES));
                    }
                    for kx in 0..3 {
                        for (o, sums) in sums.iter_mut().enumerate() {
                            let weight = L::splat(*weights.add(kx * O + o));
                            for (p, sum) in sums.iter_mut().enumerate() {
                                *sum = sum.add_product(weight, seen[p + kx]);
                            }
                        }
                    }
                    weights = weights.add(3 * O);
                }
            }
            for (o, sums) in sums.iter().enumerate() {
                for (p, &sum) in sums.iter().enumerate() {
                    let place = self.place + o * self.plane + p * L::LANES;
                    let result = match finish {
                        Finish::Linear => sum,
                        Finish::Relu => sum.max(L::splat(0.0)),
                        Finish::WherePositive(gate) => sum.where_positive(L::load(gate.data.as_ptr().add(place))),
                    };
                    result.store(self.to.add(place));
                }
            }
        }
    }
}

dispatched! {
    /// Adds the gradient of a convolution's weights to `sums`, `[outputs / tile][inputs][ky][kx][tile]` vectors of lanes.
    fn add_weight_gradient(input: Planes, gradient: Planes, sums: &mut [f32]) = add_weight_gradient_lanes
}

#[inline(always)]
fn add_weight_gradient_lanes<L: Lanes>(input: Planes, gradient: Planes, sums: &mut [f32]) {
    match L::OUTPUTS {
        8 => add_weight_gradient_tiles::<L, 8>(input, gradient, sums),
        _ => add_weight_gradient_tiles::<L, 4>(input, gradient, sums),
    }
}

#[inline(always)]
fn add_weight_gradient_tiles<L: Lanes, const O: usize>(input: Planes, gradient: Planes, sums: &mut [f32]) {
    let (side, row, plane) = (input.side, input.row::<L>(), input.plane::<L>());
    input.check::<L>();
    gradient.check::<L>();
    assert!(gradient.side == side && gradient.channels.is_multiple_of(O));
    assert!(sums.len() == gradient.channels * input.channels * 9 * L::LANES);
    let rows = (STRETCH / side).clamp(1, side);
    for first in (0..gradient.channels).step_by(O) {
        for top in (0..side).step_by(rows) {
            for channel in 0..input.channels {
                for ky in 0..3 {
                    // SAFETY: rows and their neighbours lie within the planes, whose sizes were checked.
                    unsafe {
                        let sums =
                            sums.as_mut_ptr().add(((first * input.channels + channel * O) * 9 + ky * 3 * O) * L::LANES);
                        let seen = input.data.as_ptr().add(channel * plane + (top + ky) * row);
                        let moved = gradient.data.as_ptr().add(first * plane + (top + 1) * row + L::LANES);
                        let rows = rows.min(side - top);
                        add_products::<L, O>(sums, seen, moved, (rows, side), (row, plane));
                    }
                }
            }
        }
    }
}

/// Adds to `sums`, `[kx][O]`, the products of `O` channels of the gradient with a channel's pixels at the three `kx`.
#[inline(always)]
unsafe fn add_products<L: Lanes, const O: usize>(
    sums: *mut f32,
    seen: *const f32,
    gradient: *const f32,
    (rows, side): (usize, usize),
    (row, plane): (usize, usize),
) {
    unsafe {
        let at = |kx: usize, o: usize| sums.add((kx * O + o) * L::LANES);
        let mut totals: [[L; 3]; O] = std::array::from_fn(|o| std::array::from_fn(|kx| L::load(at(kx, o))));
        for y in 0..rows {
            for x in 0..side {
                let here = y * row + x * L::LANES;
                let seen: [L; 3] = std::array::from_fn(|kx| L::load(seen.add(here + kx * L::LANES)));
                for (o, totals) in totals.iter_mut().enumerate() {
                    let gradient = L::load(gradient.add(here + o * plane));
                    for (total, &seen) in totals.iter_mut().zip(&seen) {
                        *total = total.add_product(gradient, seen);
                    }
                }
            }
        }
        for (o, totals) in totals.iter().enumerate() {
            for (kx, total) in totals.iter().enumerate() {
                total.store(at(kx, o));
            }
        }
    }
}
