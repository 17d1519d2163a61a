//! Convolutions 3x3 with zero padding, stride 1, on blocks of frames, by Winograd's minimal filtering along x.
//!
//! Four pixels of a row take 6 products for each of the kernel's rows, where a plain sum takes 12: F(4, 3) of Lavin and Gray
//! (2016, section 4), `A^T [(G w) * (B^T d)]`, with `d` the six pixels that the four depend on, `w` a row of the kernel, and
//! products summed over input channels and the kernel's rows before `A^T`. The points are 0, ±a, ±1/a and infinity with
//! `a = 1/√2`, which keep all constants between 1/6 and 3: the rounding is not twice that of plain sums. F(2x2, 3x3), on
//! both axes, takes 16 products instead of 18, but writes 4 numbers for each pixel that it reads instead of 1.5, and
//! writing costs as much as multiplying at few channels.

use super::lanes::{Instructions, Lanes, dispatched};
use super::planes::{Planes, PlanesMut, Workspace};
use super::threads::side_by_side;

/// Pixels of a tile.
pub(super) const PIXELS: usize = 4;
/// Pixels that a tile depends on, and its products.
pub(super) const POINTS: usize = PIXELS + 2;
/// Tiles side by side whose products are summed in registers, at most.
const STRIP: usize = 3;

pub(super) const A: f32 = std::f32::consts::FRAC_1_SQRT_2;
pub(super) const B: f32 = std::f32::consts::SQRT_2;

/// `G w`.
fn transform_kernel([w0, w1, w2]: [f32; 3]) -> [f32; POINTS] {
    let (even_a, odd_a) = (-2.0 / 3.0 * w0 - 1.0 / 3.0 * w2, -2.0 / 3.0 * A * w1);
    let (even_b, odd_b) = (1.0 / 6.0 * w0 + 1.0 / 3.0 * w2, 1.0 / 6.0 * B * w1);
    [w0, even_a + odd_a, even_a - odd_a, even_b + odd_b, even_b - odd_b, w2]
}

/// `B^T d`.
#[inline(always)]
unsafe fn transform_input<L: Lanes>([d0, d1, d2, d3, d4, d5]: [L; POINTS]) -> [L; POINTS] {
    unsafe {
        let (even_a, odd_a) = (plus(d4, -2.0, d2), plus(d3, -2.0, d1));
        let (even_b, odd_b) = (plus(d4, -0.5, d2), plus(d3, -0.5, d1));
        [
            plus(d0.add(d4), -2.5, d2),
            plus(even_a, A, odd_a),
            plus(even_a, -A, odd_a),
            plus(even_b, B, odd_b),
            plus(even_b, -B, odd_b),
            plus(d1.add(d5), -2.5, d3),
        ]
    }
}

/// Transforms a row of a channel; `row` counts the border, and pixels beyond the right border are 0. The points stand `apart`.
#[inline(always)]
pub(super) unsafe fn transform_pixels<L: Lanes>(
    input: &Planes,
    channel: usize,
    row: usize,
    into: *mut f32,
    apart: usize,
) {
    unsafe {
        let from = input.data.as_ptr().add(channel * input.plane::<L>() + row * input.row::<L>());
        for tile in 0..input.side.div_ceil(PIXELS) {
            let first = tile * PIXELS;
            let pixels = if first + POINTS <= input.side + 2 {
                std::array::from_fn(|i| L::load(from.add((first + i) * L::LANES)))
            } else {
                std::array::from_fn(|i| {
                    let x = first + i;
                    if x < input.side + 2 { L::load(from.add(x * L::LANES)) } else { L::splat(0.0) }
                })
            };
            for (point, value) in transform_input::<L>(pixels).into_iter().enumerate() {
                value.store(into.add(point * apart + tile * L::LANES));
            }
        }
    }
}

/// `A^T m`.
#[inline(always)]
unsafe fn transform_output<L: Lanes>([m0, m1, m2, m3, m4, m5]: [L; POINTS]) -> [L; PIXELS] {
    unsafe {
        let (even_a, odd_a) = (m1.add(m2), plus(m1, -1.0, m2));
        let (even_b, odd_b) = (m3.add(m4), plus(m3, -1.0, m4));
        [
            m0.add(even_a).add(even_b),
            plus(odd_a.mul(L::splat(A)), B, odd_b),
            plus(even_a.mul(L::splat(0.5)), 2.0, even_b),
            plus(plus(m5, 0.5 * A, odd_a), 2.0 * B, odd_b),
        ]
    }
}

/// `x + c y`.
#[inline(always)]
pub(super) unsafe fn plus<L: Lanes>(x: L, c: f32, y: L) -> L {
    unsafe { x.add_product(L::splat(c), y) }
}

/// What becomes of a convolution's result.
#[derive(Debug, Clone, Copy)]
pub enum Finish<'a> {
    Linear,
    Relu,
    /// 0 where these planes are not above 0: the gradient through a ReLU that gave them.
    WherePositive(Planes<'a>),
}

/// Transformed weights in the order in which the kernel reads them: `[outputs / tile][point][ky][inputs][tile]`.
#[derive(Debug, Clone)]
pub struct Weights {
    transformed: Vec<f32>,
    bias: Vec<f32>,
}

impl Weights {
    /// Of a convolution, `weight` being `[outputs, inputs, 3, 3]`; `tile` output channels are computed together.
    pub fn forward(tile: usize, weight: &[f32], bias: &[f32]) -> Self {
        let inputs = weight.len() / (9 * bias.len());
        Self::new(tile, inputs, bias.to_vec(), |o, i, tap| weight[(o * inputs + i) * 9 + tap])
    }

    /// Of the convolution that takes the gradient of the result to that of the input: inputs and outputs exchanged, the
    /// kernel turned.
    pub fn backward(tile: usize, weight: &[f32], outputs: usize) -> Self {
        let inputs = weight.len() / (9 * outputs);
        Self::new(tile, outputs, vec![0.0; inputs], |i, o, tap| weight[(o * inputs + i) * 9 + 8 - tap])
    }

    fn new(tile: usize, inputs: usize, bias: Vec<f32>, weight: impl Fn(usize, usize, usize) -> f32) -> Self {
        let outputs = bias.len();
        assert!(outputs.is_multiple_of(tile), "{outputs} channels do not fill tiles of {tile}");
        let mut transformed = vec![0.0; outputs * inputs * 3 * POINTS];
        for output in 0..outputs {
            for input in 0..inputs {
                for ky in 0..3 {
                    let row = std::array::from_fn(|kx| weight(output, input, ky * 3 + kx));
                    for (point, value) in transform_kernel(row).into_iter().enumerate() {
                        let place = ((output / tile * POINTS + point) * 3 + ky) * inputs + input;
                        transformed[place * tile + output % tile] = value;
                    }
                }
            }
        }
        Weights { transformed, bias }
    }
}

/// Those of some output channels.
#[derive(Debug, Clone, Copy)]
pub struct SomeWeights<'a> {
    transformed: &'a [f32],
    bias: &'a [f32],
}

impl Weights {
    fn part(&self, first: usize, channels: usize) -> SomeWeights<'_> {
        let each = self.transformed.len() / self.bias.len();
        SomeWeights {
            transformed: &self.transformed[first * each..(first + channels) * each],
            bias: &self.bias[first..first + channels],
        }
    }
}

/// `output = finish(weights * input + bias)`, on as many threads as there are workspaces: each computes channels of its own.
pub fn convolve(
    instructions: Instructions,
    weights: &Weights,
    input: Planes,
    output: PlanesMut,
    finish: Finish,
    workspaces: &mut [Workspace],
) {
    let (side, plane) = (output.side, output.data.len() / output.channels);
    let channels = (output.channels / instructions.tile()).div_ceil(workspaces.len()) * instructions.tile();
    let parts = output.data.chunks_mut(channels * plane).enumerate().map(|(part, data)| {
        let (first, channels) = (part * channels, data.len() / plane);
        (weights.part(first, channels), PlanesMut { data, channels, side }, finish.part(first, channels))
    });
    side_by_side(workspaces, parts.collect(), |workspace, (weights, output, finish)| {
        convolve_some(instructions, weights, input, output, finish, workspace);
    });
}

impl Finish<'_> {
    /// Of some output channels.
    fn part(&self, first: usize, channels: usize) -> Self {
        match *self {
            Finish::WherePositive(gate) => Finish::WherePositive(gate.part(first, channels)),
            finish => finish,
        }
    }
}

dispatched! {
    fn convolve_some(
        weights: SomeWeights,
        input: Planes,
        output: PlanesMut,
        finish: Finish,
        workspace: &mut Workspace,
    ) = convolve_lanes
}

#[inline(always)]
fn convolve_lanes<L: Lanes>(
    weights: SomeWeights,
    input: Planes,
    output: PlanesMut,
    finish: Finish,
    workspace: &mut Workspace,
) {
    input.check::<L>();
    output.check::<L>();
    let (side, channels) = (input.side, output.channels);
    assert!(output.side == side && channels == weights.bias.len() && channels.is_multiple_of(L::OUTPUTS));
    assert!(weights.transformed.len() == channels * input.channels * 3 * POINTS);
    if let Finish::WherePositive(gate) = finish {
        gate.check::<L>();
        assert!(gate.side == side && gate.channels == channels);
    }
    let tiles = side.div_ceil(PIXELS);
    let seen = 3 * POINTS * input.channels * tiles * L::LANES;
    let products = POINTS * L::OUTPUTS * STRIP * L::LANES;
    let (seen, products) = workspace.floats(seen + products).split_at_mut(seen);
    let (seen, products, to) = (seen.as_mut_ptr(), products.as_mut_ptr(), output.data.as_mut_ptr());
    let layer = Layer { weights, input, finish, tiles, seen, products, to };
    // SAFETY: tiles of the planes, whose sizes were checked, and a workspace for all of them.
    unsafe {
        match L::OUTPUTS {
            8 => layer.convolve::<L, 8>(channels),
            _ => layer.convolve::<L, 4>(channels),
        }
    }
}

/// What a convolution reads and writes.
struct Layer<'a> {
    weights: SomeWeights<'a>,
    input: Planes<'a>,
    finish: Finish<'a>,
    /// Of a row.
    tiles: usize,
    /// The input's last three rows, transformed: `[row % 3][point][input][tile]`.
    seen: *mut f32,
    /// Of a strip of tiles: `[output][tile][point]`.
    products: *mut f32,
    to: *mut f32,
}

impl Layer<'_> {
    #[inline(always)]
    unsafe fn convolve<L: Lanes, const O: usize>(&self, outputs: usize) {
        unsafe {
            self.transform_row::<L>(0);
            self.transform_row::<L>(1);
            for y in 0..self.input.side {
                self.transform_row::<L>(y + 2);
                for output in (0..outputs).step_by(O) {
                    let mut first = 0;
                    while first < self.tiles {
                        first += match self.tiles - first {
                            1 => self.compute::<L, O, 1>(output, y, first),
                            2 | 4 => self.compute::<L, O, 2>(output, y, first),
                            _ => self.compute::<L, O, STRIP>(output, y, first),
                        }
                    }
                }
            }
        }
    }

    /// Of all channels; `row` counts the border.
    #[inline(always)]
    unsafe fn transform_row<L: Lanes>(&self, row: usize) {
        unsafe {
            let (inputs, of_row) = (self.input.channels, self.tiles * L::LANES);
            for channel in 0..inputs {
                let seen = self.seen.add((row % 3 * POINTS * inputs + channel) * of_row);
                transform_pixels::<L>(&self.input, channel, row, seen, inputs * of_row);
            }
        }
    }

    /// `O` output channels of `P` tiles of a row; gives `P`.
    #[inline(always)]
    unsafe fn compute<L: Lanes, const O: usize, const P: usize>(&self, output: usize, y: usize, first: usize) -> usize {
        unsafe {
            self.multiply::<L, O, P>(output, y, first);
            for o in 0..O {
                for p in 0..P {
                    self.finish::<L>(output + o, y, first + p, self.products.add((o * P + p) * POINTS * L::LANES));
                }
            }
            P
        }
    }

    #[inline(always)]
    unsafe fn multiply<L: Lanes, const O: usize, const P: usize>(&self, output: usize, y: usize, first: usize) {
        unsafe {
            let (inputs, tiles) = (self.input.channels, self.tiles);
            let mut weights = self.weights.transformed.as_ptr().add(output * inputs * 3 * POINTS);
            for point in 0..POINTS {
                let mut sums = [[L::splat(0.0); P]; O];
                for ky in 0..3 {
                    let mut from = self.seen.add((((y + ky) % 3 * POINTS + point) * inputs * tiles + first) * L::LANES);
                    for _ in 0..inputs {
                        let seen: [L; P] = std::array::from_fn(|p| L::load(from.add(p * L::LANES)));
                        for (o, sums) in sums.iter_mut().enumerate() {
                            let weight = L::splat(*weights.add(o));
                            for (sum, &seen) in sums.iter_mut().zip(&seen) {
                                *sum = sum.add_product(weight, seen);
                            }
                        }
                        from = from.add(tiles * L::LANES);
                        weights = weights.add(O);
                    }
                }
                for (place, sum) in sums.as_flattened().iter().enumerate() {
                    sum.store(self.products.add((place * POINTS + point) * L::LANES));
                }
            }
        }
    }

    /// From a tile's products to the result.
    #[inline(always)]
    unsafe fn finish<L: Lanes>(&self, output: usize, y: usize, tile: usize, products: *const f32) {
        unsafe {
            let input = &self.input;
            let x = tile * PIXELS;
            let place = output * input.plane::<L>() + (y + 1) * input.row::<L>() + (x + 1) * L::LANES;
            let bias = L::splat(self.weights.bias[output]);
            let results = transform_output::<L>(std::array::from_fn(|point| L::load(products.add(point * L::LANES))));
            for (i, result) in results.into_iter().enumerate().take(input.side - x) {
                let (result, place) = (result.add(bias), place + i * L::LANES);
                let result = match self.finish {
                    Finish::Linear => result,
                    Finish::Relu => result.max(L::splat(0.0)),
                    Finish::WherePositive(gate) => result.where_positive(L::load(gate.data.as_ptr().add(place))),
                };
                result.store(self.to.add(place));
            }
        }
    }
}
