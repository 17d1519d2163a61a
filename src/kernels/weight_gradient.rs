//! The gradients of a 3x3 convolution's weights, on blocks of frames, by minimal filtering.
//!
//! A kernel's nine weights are moved by sums over the result's gradients times what the kernel saw there. A tile of 2 x 4
//! gradients takes 24 products, where plain sums take 72: F(3, 2) along y within F(3, 4) along x, `A^T [(G g) * (B^T d)]` on
//! each axis, with `g` the gradients and `d` the 4 x 6 pixels they depend on. The points, and so `B^T`, are those of the
//! [convolution](super::winograd). Products are summed over all tiles before `A^T`.

use std::ops::Range;

use super::lanes::{Instructions, Lanes, dispatched};
use super::planes::{Planes, Workspace};
use super::threads::side_by_side;
use super::winograd::{A, B, PIXELS, POINTS, PRODUCTS, ROW_POINTS, ROWS, plus, transform_tiles};

/// Input channels whose transformed pixels are at hand together: with the sums they fill a part of the second cache.
const INPUTS: usize = 32;
/// Tiles over which products are summed in registers before they go to memory.
const STRETCH: usize = 16;

/// `G g` along x.
#[inline(always)]
unsafe fn transform_gradient<L: Lanes>([g0, g1, g2, g3]: [L; PIXELS]) -> [L; POINTS] {
    unsafe {
        let (even_a, odd_a) = (plus(g0, 0.5, g2).mul(L::splat(-2.0 / 3.0)), plus(g1, 0.5, g3));
        let (even_b, odd_b) = (plus(g0, 2.0, g2).mul(L::splat(1.0 / 6.0)), plus(g1, 2.0, g3));
        let (slope_a, slope_b) = (-2.0 / 3.0 * A, 1.0 / 6.0 * B);
        [
            g0,
            plus(even_a, slope_a, odd_a),
            plus(even_a, -slope_a, odd_a),
            plus(even_b, slope_b, odd_b),
            plus(even_b, -slope_b, odd_b),
            g3,
        ]
    }
}

/// `A^T m` along x.
#[inline(always)]
unsafe fn transform_sums<L: Lanes>([m0, m1, m2, m3, m4, m5]: [L; POINTS]) -> [L; 3] {
    unsafe {
        let (even_a, odd_a) = (m1.add(m2), m1.sub(m2));
        let (even_b, odd_b) = (m3.add(m4), m3.sub(m4));
        [m0.add(even_a).add(even_b), plus(odd_a.mul(L::splat(A)), B, odd_b), plus(plus(m5, 0.5, even_a), 2.0, even_b)]
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
    let each = sums.len() / gradient.channels;
    let channels = (gradient.channels / instructions.tile()).div_ceil(workspaces.len()) * instructions.tile();
    let parts = sums.chunks_mut(channels * each).enumerate();
    let parts = parts.map(|(part, sums)| (gradient.part(part * channels, sums.len() / each), sums));
    side_by_side(workspaces, parts.collect(), |workspace, (gradient, sums)| {
        add_some(instructions, input, gradient, sums, workspace);
    });
}

dispatched! {
    fn add_some(
        input: Planes,
        gradient: Planes,
        sums: &mut [f32],
        workspace: &mut Workspace,
    ) = add_weight_gradient_lanes
}

#[inline(always)]
fn add_weight_gradient_lanes<L: Lanes>(input: Planes, gradient: Planes, sums: &mut [f32], workspace: &mut Workspace) {
    match L::OUTPUTS {
        8 => add_weight_gradient_tiles::<L, 8>(input, gradient, sums, workspace),
        _ => add_weight_gradient_tiles::<L, 4>(input, gradient, sums, workspace),
    }
}

#[inline(always)]
fn add_weight_gradient_tiles<L: Lanes, const O: usize>(
    input: Planes,
    gradient: Planes,
    sums: &mut [f32],
    workspace: &mut Workspace,
) {
    let (side, all) = (input.side, input.channels);
    input.check::<L>();
    gradient.check::<L>();
    assert!(gradient.side == side && gradient.channels.is_multiple_of(O));
    assert!(sums.len() == gradient.channels * input.channels * 9);
    let (tiles, pairs) = (side.div_ceil(PIXELS), side.div_ceil(ROWS));
    let most = (STRETCH / tiles).clamp(1, pairs);
    let group = INPUTS.min(input.channels);
    let of_seen = POINTS * group * most * tiles * L::LANES;
    let of_moved = POINTS * O * most * tiles * L::LANES;
    let of_totals = PRODUCTS * gradient.channels * group * L::LANES;
    let (seen, rest) = workspace.floats(of_seen + of_moved + of_totals).split_at_mut(of_seen);
    let (moved, totals) = rest.split_at_mut(of_moved);
    let (seen, moved, totals) = (seen.as_mut_ptr(), moved.as_mut_ptr(), totals.as_mut_ptr());
    for first in (0..input.channels).step_by(INPUTS) {
        let input = input.part(first, group.min(input.channels - first));
        let inputs = input.channels;
        let point_apart = inputs * O * L::LANES;
        for pair in (0..pairs).step_by(most) {
            for row_point in 0..ROW_POINTS {
                let stretch = Stretch { seen, moved, inputs, row_point, pairs: pair..pairs.min(pair + most), tiles };
                // SAFETY: rows and their neighbours lie within the planes, whose sizes were checked; the workspace has room
                // for all inputs of a group, O outputs, and the sums of all outputs.
                unsafe {
                    stretch.transform_input::<L>(&input);
                    for output in (0..gradient.channels).step_by(O) {
                        stretch.transform_gradient::<L, O>(&gradient, output);
                        let place = output / O * ROW_POINTS + row_point;
                        stretch.add_products::<L, O>(totals.add(place * POINTS * point_apart));
                    }
                }
            }
        }
        for output in (0..gradient.channels).step_by(O) {
            for input in 0..inputs {
                // SAFETY: the sums of O outputs and an input.
                let kernels = unsafe {
                    let totals = totals.add(output / O * PRODUCTS * point_apart + input * O * L::LANES);
                    finish::<L, O>(totals, point_apart)
                };
                for (o, kernel) in kernels.iter().enumerate() {
                    let place = ((output + o) * all + first + input) * 9;
                    sums[place..place + 9].iter_mut().zip(kernel).for_each(|(sum, part)| *sum += part);
                }
            }
        }
    }
}

/// Some pairs of rows at a point along y.
struct Stretch {
    /// The input, transformed: `[x][input][pair][tile]`.
    seen: *mut f32,
    /// The gradient, transformed: `[x][output][pair][tile]`.
    moved: *mut f32,
    inputs: usize,
    row_point: usize,
    pairs: Range<usize>,
    tiles: usize,
}

impl Stretch {
    /// Floats of a channel at a point.
    #[inline(always)]
    fn of_channel<L: Lanes>(&self) -> usize {
        self.pairs.len() * self.tiles * L::LANES
    }

    #[inline(always)]
    unsafe fn transform_input<L: Lanes>(&self, input: &Planes) {
        unsafe {
            let (of_channel, row) = (self.of_channel::<L>(), self.tiles * L::LANES);
            for channel in 0..self.inputs {
                for (place, pair) in self.pairs.clone().enumerate() {
                    let into = self.seen.add(channel * of_channel + place * row);
                    let at = (channel, pair * ROWS);
                    transform_tiles::<L>(input, at, self.row_point, 0..self.tiles, into, self.inputs * of_channel);
                }
            }
        }
    }

    /// `G g` on both axes.
    #[inline(always)]
    unsafe fn transform_gradient<L: Lanes, const O: usize>(&self, gradient: &Planes, output: usize) {
        unsafe {
            let (of_channel, row, side) = (self.of_channel::<L>(), self.tiles * L::LANES, gradient.side);
            let (upper_part, lower_part) = [(1.0, 0.0), (0.5, 0.5), (0.5, -0.5), (0.0, 1.0)][self.row_point];
            for o in 0..O {
                for (place, pair) in self.pairs.clone().enumerate() {
                    let into = self.moved.add(o * of_channel + place * row);
                    let upper = gradient.at::<L>(output + o, pair * ROWS, 0);
                    // Below an odd number of rows lies the border.
                    let lower = upper.add(gradient.row::<L>());
                    for tile in 0..self.tiles {
                        let first = tile * PIXELS;
                        let there = PIXELS.min(side - first);
                        let mut pixels = [L::splat(0.0); PIXELS];
                        for (i, pixel) in pixels.iter_mut().enumerate() {
                            if there == PIXELS || i < there {
                                let x = (first + i) * L::LANES;
                                let above = L::load(upper.add(x)).mul(L::splat(upper_part));
                                *pixel = plus(above, lower_part, L::load(lower.add(x)));
                            }
                        }
                        for (point, value) in transform_gradient::<L>(pixels).into_iter().enumerate() {
                            value.store(into.add(point * O * of_channel + tile * L::LANES));
                        }
                    }
                }
            }
        }
    }

    /// Adds the products of `O` outputs with all inputs to `totals`, `[x][input][O]`, or puts them there if they are the first.
    #[inline(always)]
    unsafe fn add_products<L: Lanes, const O: usize>(&self, totals: *mut f32) {
        unsafe {
            let of_channel = self.of_channel::<L>();
            for point in 0..POINTS {
                let moved = self.moved.add(point * O * of_channel);
                let mut input = 0;
                while input < self.inputs {
                    let place = point * self.inputs + input;
                    let (seen, totals) = (self.seen.add(place * of_channel), totals.add(place * O * L::LANES));
                    input += match self.inputs - input {
                        1 => self.sum::<L, O, 1>(totals, seen, moved),
                        2 | 4 => self.sum::<L, O, 2>(totals, seen, moved),
                        _ => self.sum::<L, O, 3>(totals, seen, moved),
                    }
                }
            }
        }
    }

    /// Sums in registers over all tiles, of `O` outputs and `I` inputs; gives `I`.
    #[inline(always)]
    unsafe fn sum<L: Lanes, const O: usize, const I: usize>(
        &self,
        totals: *mut f32,
        seen: *const f32,
        moved: *const f32,
    ) -> usize {
        unsafe {
            let (of_channel, new) = (self.of_channel::<L>(), self.pairs.start == 0);
            let at = |i: usize, o: usize| totals.add((i * O + o) * L::LANES);
            let start = |i, o| if new { L::splat(0.0) } else { L::load(at(i, o)) };
            let mut sums: [[L; I]; O] = std::array::from_fn(|o| std::array::from_fn(|i| start(i, o)));
            for here in (0..of_channel).step_by(L::LANES) {
                let seen: [L; I] = std::array::from_fn(|i| L::load(seen.add(i * of_channel + here)));
                for (o, sums) in sums.iter_mut().enumerate() {
                    let moved = L::load(moved.add(o * of_channel + here));
                    for (sum, &seen) in sums.iter_mut().zip(&seen) {
                        *sum = sum.add_product(moved, seen);
                    }
                }
            }
            for (o, sums) in sums.iter().enumerate() {
                for (i, sum) in sums.iter().enumerate() {
                    sum.store(at(i, o));
                }
            }
            I
        }
    }
}

/// The gradients of the kernels of an input and `O` outputs from `totals`, `[y][x][input][O]`, which stand `apart` from
/// point to point.
#[inline(always)]
unsafe fn finish<L: Lanes, const O: usize>(totals: *const f32, apart: usize) -> [[f32; 9]; O] {
    unsafe {
        let mut kernels = [[0.0; 9]; O];
        for (four, kernels) in kernels.chunks_exact_mut(4).enumerate() {
            let mut lanes = [[[L::splat(0.0); 4]; 3]; 3];
            for o in 0..4 {
                let mut columns = [[L::splat(0.0); 3]; POINTS];
                for (x, column) in columns.iter_mut().enumerate() {
                    let totals = totals.add((four * 4 + o) * L::LANES + x * apart);
                    let mut m = [L::splat(0.0); ROW_POINTS];
                    m.iter_mut().enumerate().for_each(|(y, m)| *m = L::load(totals.add(y * POINTS * apart)));
                    let sum = m[1].add(m[2]);
                    *column = [m[0].add(sum), m[1].sub(m[2]), sum.sub(m[3])];
                }
                for (ky, lanes) in lanes.iter_mut().enumerate() {
                    let mut row = [L::splat(0.0); POINTS];
                    row.iter_mut().zip(&columns).for_each(|(value, column)| *value = column[ky]);
                    for (lanes, value) in lanes.iter_mut().zip(transform_sums::<L>(row)) {
                        lanes[o] = value;
                    }
                }
            }
            for (tap, lanes) in lanes.as_flattened().iter().enumerate() {
                let sums = L::sums(*lanes);
                kernels.iter_mut().zip(sums).for_each(|(kernel, sum)| kernel[tap] = sum);
            }
        }
        kernels
    }
}
