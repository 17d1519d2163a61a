//! Convolutions 3x3 with zero padding, stride 1, on blocks of frames, by Winograd's minimal filtering.
//!
//! A tile of 2 x 4 pixels takes 24 products, where plain sums take 72: F(2, 3) along y within F(4, 3) along x of Lavin and Gray
//! (2016, section 4), `A^T [(G w) * (B^T d)]` on each axis, with `d` the 4 x 6 pixels that the tile depends on, `w` the
//! kernel, and products summed over input channels before `A^T`. The points along y are 0, 1, -1 and infinity; along x 0, ±a,
//! ±1/a and infinity with `a = 1/√2`, which keep all constants between 1/6 and 3: the rounding is not three times that of
//! plain sums.

use std::ops::Range;

use super::lanes::{Instructions, Lanes, dispatched};
use super::planes::{Planes, PlanesMut, Workspace};
use super::threads::side_by_side;

/// Pixels of a tile along x and y.
pub(super) const PIXELS: usize = 4;
pub(super) const ROWS: usize = 2;
/// Pixels that a tile depends on along x and y, and its products.
pub(super) const POINTS: usize = PIXELS + 2;
pub(super) const ROW_POINTS: usize = ROWS + 2;
/// Tiles side by side whose products are summed in registers, and those that are transformed together, at most.
const STRIP: usize = 3;
const CHUNK: usize = 6 * STRIP;
pub(super) const PRODUCTS: usize = POINTS * ROW_POINTS;

pub(super) const A: f32 = std::f32::consts::FRAC_1_SQRT_2;
pub(super) const B: f32 = std::f32::consts::SQRT_2;

/// `G w` along x.
fn transform_row([w0, w1, w2]: [f32; 3]) -> [f32; POINTS] {
    let (even_a, odd_a) = (-2.0 / 3.0 * w0 - 1.0 / 3.0 * w2, -2.0 / 3.0 * A * w1);
    let (even_b, odd_b) = (1.0 / 6.0 * w0 + 1.0 / 3.0 * w2, 1.0 / 6.0 * B * w1);
    [w0, even_a + odd_a, even_a - odd_a, even_b + odd_b, even_b - odd_b, w2]
}

/// `G w` along both axes, `[x][y]`.
fn transform_kernel(rows: [[f32; 3]; 3]) -> [[f32; ROW_POINTS]; POINTS] {
    let [above, middle, below] = rows.map(transform_row);
    std::array::from_fn(|x| {
        let (even, odd) = (0.5 * (above[x] + below[x]), 0.5 * middle[x]);
        [above[x], even + odd, even - odd, below[x]]
    })
}

/// `B^T d` along x.
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

/// `B^T d` along both axes at a point along y, of tiles of a channel beside each other; `y` is that of the uppermost pixel and
/// counts the border. The points along x stand `apart`. Pixels beyond the border are 0.
#[inline(always)]
pub(super) unsafe fn transform_tiles<L: Lanes>(
    input: &Planes,
    (channel, y): (usize, usize),
    row_point: usize,
    tiles: Range<usize>,
    into: *mut f32,
    apart: usize,
) {
    unsafe {
        let rows = input.side + 2;
        let start = input.data.as_ptr().add(channel * input.plane::<L>());
        // The border above is as what lies below the one below.
        let row = |i: usize| start.add(if y + i < rows { y + i } else { 0 } * input.row::<L>());
        let (one, sign, other) = match row_point {
            0 => (row(0), -1.0, row(2)),
            1 => (row(1), 1.0, row(2)),
            2 => (row(2), -1.0, row(1)),
            _ => (row(1), -1.0, row(3)),
        };
        for (place, tile) in tiles.enumerate() {
            let first = tile * PIXELS;
            let there = POINTS.min(rows - first);
            let mut pixels = [L::splat(0.0); POINTS];
            for (i, pixel) in pixels.iter_mut().enumerate() {
                // Compared for the last tile only, where a side is no multiple of a tile's.
                if there == POINTS || i < there {
                    let x = (first + i) * L::LANES;
                    *pixel = plus(L::load(one.add(x)), sign, L::load(other.add(x)));
                }
            }
            for (point, value) in transform_input::<L>(pixels).into_iter().enumerate() {
                value.store(into.add(point * apart + place * L::LANES));
            }
        }
    }
}

/// `A^T m` along x.
#[inline(always)]
unsafe fn transform_output<L: Lanes>([m0, m1, m2, m3, m4, m5]: [L; POINTS]) -> [L; PIXELS] {
    unsafe {
        let (even_a, odd_a) = (m1.add(m2), m1.sub(m2));
        let (even_b, odd_b) = (m3.add(m4), m3.sub(m4));
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

/// Transformed weights in the order in which the kernel reads them: `[outputs / tile][x][y][inputs][tile]`.
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
        let mut transformed = vec![0.0; outputs * inputs * PRODUCTS];
        for output in 0..outputs {
            for input in 0..inputs {
                let rows = [0, 3, 6].map(|row| std::array::from_fn(|kx| weight(output, input, row + kx)));
                for (point, value) in transform_kernel(rows).as_flattened().iter().enumerate() {
                    let place = (output / tile * PRODUCTS + point) * inputs + input;
                    transformed[place * tile + output % tile] = *value;
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
    assert!(weights.transformed.len() == channels * input.channels * PRODUCTS);
    if let Finish::WherePositive(gate) = finish {
        gate.check::<L>();
        assert!(gate.side == side && gate.channels == channels);
    }
    let tiles = side.div_ceil(PIXELS);
    let seen = PRODUCTS * input.channels * CHUNK.min(tiles) * L::LANES;
    let sums = POINTS * ROWS * L::OUTPUTS * STRIP * L::LANES;
    let (seen, sums) = workspace.floats(seen + sums).split_at_mut(seen);
    let (seen, sums, to) = (seen.as_mut_ptr(), sums.as_mut_ptr(), output.data.as_mut_ptr());
    let layer = Layer { weights, input, finish, seen, sums, to };
    // SAFETY: tiles of the planes, whose sizes were checked, and a workspace for all of them.
    unsafe {
        match L::OUTPUTS {
            8 => layer.convolve::<L, 8>(channels, tiles),
            _ => layer.convolve::<L, 4>(channels, tiles),
        }
    }
}

/// What a convolution reads and writes.
struct Layer<'a> {
    weights: SomeWeights<'a>,
    input: Planes<'a>,
    finish: Finish<'a>,
    /// Some tiles of the input, transformed: `[x][y][input][tile]`.
    seen: *mut f32,
    /// Of a strip of tiles, their products after `A^T` along y: `[output][tile][row][x]`.
    sums: *mut f32,
    to: *mut f32,
}

impl Layer<'_> {
    #[inline(always)]
    unsafe fn convolve<L: Lanes, const O: usize>(&self, outputs: usize, tiles: usize) {
        unsafe {
            for first in (0..tiles).step_by(CHUNK) {
                let chunk = CHUNK.min(tiles - first);
                for y in (0..self.input.side).step_by(ROWS) {
                    self.transform::<L>(y, first..first + chunk);
                    for output in (0..outputs).step_by(O) {
                        let mut done = 0;
                        while done < chunk {
                            let strip = Strip { output, y, tile: first + done, place: done, chunk };
                            done += match chunk - done {
                                1 => self.compute::<L, O, 1>(strip),
                                2 | 4 => self.compute::<L, O, 2>(strip),
                                _ => self.compute::<L, O, STRIP>(strip),
                            }
                        }
                    }
                }
            }
        }
    }

    /// Of all channels.
    #[inline(always)]
    unsafe fn transform<L: Lanes>(&self, y: usize, tiles: Range<usize>) {
        unsafe {
            let (inputs, of_channel) = (self.input.channels, tiles.len() * L::LANES);
            for channel in 0..inputs {
                for point in 0..ROW_POINTS {
                    let seen = self.seen.add((point * inputs + channel) * of_channel);
                    let apart = ROW_POINTS * inputs * of_channel;
                    transform_tiles::<L>(&self.input, (channel, y), point, tiles.clone(), seen, apart);
                }
            }
        }
    }

    /// `O` output channels of `P` tiles; gives `P`.
    #[inline(always)]
    unsafe fn compute<L: Lanes, const O: usize, const P: usize>(&self, strip: Strip) -> usize {
        unsafe {
            self.multiply::<L, O, P>(strip);
            for o in 0..O {
                for p in 0..P {
                    let sums = self.sums.add((o * P + p) * ROWS * POINTS * L::LANES);
                    self.finish::<L>((strip.output + o, strip.y, strip.tile + p), sums);
                }
            }
            P
        }
    }

    #[inline(always)]
    unsafe fn multiply<L: Lanes, const O: usize, const P: usize>(&self, strip: Strip) {
        unsafe {
            let inputs = self.input.channels;
            let mut weights = self.weights.transformed.as_ptr().add(strip.output * inputs * PRODUCTS);
            let mut seen = self.seen.add(strip.place * L::LANES).cast_const();
            for point in 0..POINTS {
                let sums = self.sums.add(point * L::LANES);
                self.multiply_at::<L, O, P, 0>(strip, &mut weights, &mut seen, sums);
                self.multiply_at::<L, O, P, 1>(strip, &mut weights, &mut seen, sums);
                self.multiply_at::<L, O, P, 2>(strip, &mut weights, &mut seen, sums);
                self.multiply_at::<L, O, P, 3>(strip, &mut weights, &mut seen, sums);
            }
        }
    }

    /// At a point along x and the point `Y` along y. The point is known to the compiler, so that the products stay in
    /// registers.
    #[inline(always)]
    unsafe fn multiply_at<L: Lanes, const O: usize, const P: usize, const Y: usize>(
        &self,
        strip: Strip,
        weights: &mut *const f32,
        seen: &mut *const f32,
        sums: *mut f32,
    ) {
        unsafe {
            let mut products = [[L::splat(0.0); P]; O];
            for _ in 0..self.input.channels {
                let pixels: [L; P] = std::array::from_fn(|p| L::load(seen.add(p * L::LANES)));
                for (o, products) in products.iter_mut().enumerate() {
                    let weight = L::splat(*weights.add(o));
                    for (product, &pixel) in products.iter_mut().zip(&pixels) {
                        *product = product.add_product(weight, pixel);
                    }
                }
                *seen = seen.add(strip.chunk * L::LANES);
                *weights = weights.add(O);
            }
            for (place, product) in products.as_flattened().iter().enumerate() {
                let upper = sums.add(place * ROWS * POINTS * L::LANES);
                fold::<L, Y>(*product, upper, upper.add(POINTS * L::LANES));
            }
        }
    }

    /// From a tile's sums to the result.
    #[inline(always)]
    unsafe fn finish<L: Lanes>(&self, (output, y, tile): (usize, usize, usize), sums: *const f32) {
        unsafe {
            let input = &self.input;
            let x = tile * PIXELS;
            let bias = L::splat(self.weights.bias[output]);
            for row in 0..ROWS.min(input.side - y) {
                let place = output * input.plane::<L>() + (y + row + 1) * input.row::<L>() + (x + 1) * L::LANES;
                let sums = sums.add(row * POINTS * L::LANES);
                let results = transform_output::<L>(std::array::from_fn(|point| L::load(sums.add(point * L::LANES))));
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
}

/// Some output channels of some tiles.
#[derive(Clone, Copy)]
struct Strip {
    output: usize,
    y: usize,
    tile: usize,
    /// The tile's place among those that are transformed, and how many these are.
    place: usize,
    chunk: usize,
}

/// Adds a product at the point `Y` along y to the sums of the upper and the lower row: `A^T m`, a point after the other.
#[inline(always)]
unsafe fn fold<L: Lanes, const Y: usize>(product: L, upper: *mut f32, lower: *mut f32) {
    unsafe {
        match Y {
            0 => product.store(upper),
            1 => {
                L::load(upper).add(product).store(upper);
                product.store(lower);
            }
            2 => {
                L::load(upper).add(product).store(upper);
                L::load(lower).sub(product).store(lower);
            }
            _ => L::load(lower).sub(product).store(lower),
        }
    }
}
