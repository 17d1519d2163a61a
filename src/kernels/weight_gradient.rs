//! The gradients of a 3x3 convolution's weights, on blocks of frames, by minimal filtering along x.
//!
//! Three neighbouring weights of a kernel's row are moved by sums of four pixels' gradients times what the kernel saw there:
//! F(3, 4), `A^T [(G g) * (B^T d)]` with `g` the four gradients and `d` the six pixels they depend on. That takes 6 products
//! where plain sums take 12. The points, and so `B^T`, are those of the [convolution](super::winograd). Products are summed
//! over all pixels before `A^T`.

use super::lanes::{Instructions, Lanes, dispatched};
use super::planes::{Planes, Workspace};
use super::threads::side_by_side;
use super::winograd::{A, B, PIXELS, POINTS, plus, transform_pixels};

/// Input channels whose transformed pixels are at hand together: with the sums they fill a part of the second cache.
const INPUTS: usize = 16;
/// Tiles over which products are summed in registers before they go to memory.
const STRETCH: usize = 32;

/// `G g`.
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

/// `A^T m`.
#[inline(always)]
unsafe fn transform_sums<L: Lanes>([m0, m1, m2, m3, m4, m5]: [L; POINTS]) -> [L; 3] {
    unsafe {
        let (even_a, odd_a) = (m1.add(m2), plus(m1, -1.0, m2));
        let (even_b, odd_b) = (m3.add(m4), plus(m3, -1.0, m4));
        [
            m0.add(even_a).add(even_b),
            plus(odd_a.mul(L::splat(A)), B, odd_b),
            plus(plus(m5, 0.5, even_a), 2.0, even_b),
        ]
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
    let tiles = side.div_ceil(PIXELS);
    let most_rows = (STRETCH / tiles).clamp(1, side);
    let group = INPUTS.min(input.channels);
    let of_seen = POINTS * group * (most_rows + 2) * tiles * L::LANES;
    let of_moved = POINTS * O * most_rows * tiles * L::LANES;
    let of_totals = 3 * POINTS * gradient.channels * group * L::LANES;
    let (seen, rest) = workspace.floats(of_seen + of_moved + of_totals).split_at_mut(of_seen);
    let (moved, totals) = rest.split_at_mut(of_moved);
    let (seen, moved, totals) = (seen.as_mut_ptr(), moved.as_mut_ptr(), totals.as_mut_ptr());
    for first in (0..input.channels).step_by(INPUTS) {
        let input = input.part(first, group.min(input.channels - first));
        let inputs = input.channels;
        for top in (0..side).step_by(most_rows) {
            let rows = most_rows.min(side - top);
            let stretch = Stretch { seen, moved, inputs, rows, tiles, new: top == 0 };
            // SAFETY: rows and their neighbours lie within the planes, whose sizes were checked; the workspace has room for
            // all inputs of a group, O outputs, and the sums of all outputs.
            unsafe {
                stretch.transform_input::<L>(&input, top);
                for output in (0..gradient.channels).step_by(O) {
                    stretch.transform_gradient::<L, O>(&gradient, output, top);
                    stretch.add_products::<L, O>(totals.add(output * inputs * 3 * POINTS * L::LANES));
                }
            }
        }
        for output in (0..gradient.channels).step_by(O) {
            for input in 0..inputs {
                for ky in 0..3 {
                    // SAFETY: the sums of O outputs, an input and a row of the kernel.
                    let rows = unsafe {
                        let apart = inputs * 3 * O * L::LANES;
                        let totals = totals.add((output * 3 * POINTS + ky * O) * inputs * L::LANES);
                        finish::<L, O>(totals.add(input * O * L::LANES), apart)
                    };
                    for (o, row) in rows.into_iter().enumerate() {
                        let place = ((output + o) * all + first + input) * 9 + ky * 3;
                        sums[place..place + 3].iter_mut().zip(row).for_each(|(sum, part)| *sum += part);
                    }
                }
            }
        }
    }
}

/// Some rows of a picture, transformed: of the input with the row above and the one below.
struct Stretch {
    /// `[point][input][row][tile]`.
    seen: *mut f32,
    /// `[point][output][row][tile]`.
    moved: *mut f32,
    inputs: usize,
    rows: usize,
    tiles: usize,
    /// Whether nothing was summed before.
    new: bool,
}

impl Stretch {
    #[inline(always)]
    unsafe fn transform_input<L: Lanes>(&self, input: &Planes, top: usize) {
        unsafe {
            let row = self.tiles * L::LANES;
            let channel_rows = self.rows + 2;
            for channel in 0..self.inputs {
                for y in 0..channel_rows {
                    let into = self.seen.add((channel * channel_rows + y) * row);
                    transform_pixels::<L>(input, channel, top + y, into, self.inputs * channel_rows * row);
                }
            }
        }
    }

    #[inline(always)]
    unsafe fn transform_gradient<L: Lanes, const O: usize>(&self, gradient: &Planes, output: usize, top: usize) {
        unsafe {
            let (row, side) = (self.tiles * L::LANES, gradient.side);
            for o in 0..O {
                for y in 0..self.rows {
                    let into = self.moved.add((o * self.rows + y) * row);
                    let from = gradient.at::<L>(output + o, top + y, 0);
                    for tile in 0..self.tiles {
                        let first = tile * PIXELS;
                        let pixels = if first + PIXELS <= side {
                            std::array::from_fn(|i| L::load(from.add((first + i) * L::LANES)))
                        } else {
                            std::array::from_fn(|i| {
                                let x = first + i;
                                if x < side { L::load(from.add(x * L::LANES)) } else { L::splat(0.0) }
                            })
                        };
                        for (point, value) in transform_gradient::<L>(pixels).into_iter().enumerate() {
                            value.store(into.add(point * O * self.rows * row + tile * L::LANES));
                        }
                    }
                }
            }
        }
    }

    /// Adds the products of `O` outputs with all inputs to `totals`, `[point][ky][input][O]`, or puts them there.
    #[inline(always)]
    unsafe fn add_products<L: Lanes, const O: usize>(&self, totals: *mut f32) {
        unsafe {
            let row = self.tiles * L::LANES;
            for point in 0..POINTS {
                let moved = self.moved.add(point * O * self.rows * row);
                for ky in 0..3 {
                    let seen = self.seen.add((point * self.inputs * (self.rows + 2) + ky) * row);
                    let totals = totals.add((point * 3 + ky) * self.inputs * O * L::LANES);
                    let mut input = 0;
                    while input < self.inputs {
                        let (seen, totals) = (seen.add(input * (self.rows + 2) * row), totals.add(input * O * L::LANES));
                        input += match self.inputs - input {
                            1 => self.sum::<L, O, 1>(totals, seen, moved),
                            2 | 4 => self.sum::<L, O, 2>(totals, seen, moved),
                            _ => self.sum::<L, O, 3>(totals, seen, moved),
                        }
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
            let row = self.tiles * L::LANES;
            let (of_input, of_output) = ((self.rows + 2) * row, self.rows * row);
            let at = |i: usize, o: usize| totals.add((i * O + o) * L::LANES);
            let start = |i, o| if self.new { L::splat(0.0) } else { L::load(at(i, o)) };
            let mut sums: [[L; I]; O] = std::array::from_fn(|o| std::array::from_fn(|i| start(i, o)));
            for tile in 0..self.rows * self.tiles {
                let here = tile * L::LANES;
                let seen: [L; I] = std::array::from_fn(|i| L::load(seen.add(i * of_input + here)));
                for (o, sums) in sums.iter_mut().enumerate() {
                    let moved = L::load(moved.add(o * of_output + here));
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

/// The gradient of a kernel's row of each of `O` outputs; `totals` stand `apart` from point to point.
#[inline(always)]
unsafe fn finish<L: Lanes, const O: usize>(totals: *const f32, apart: usize) -> [[f32; 3]; O] {
    unsafe {
        let mut rows = [[0.0; 3]; O];
        for (four, rows) in rows.chunks_exact_mut(4).enumerate() {
            let of_output = |o: usize| {
                let totals = totals.add((four * 4 + o) * L::LANES);
                transform_sums::<L>(std::array::from_fn(|point| L::load(totals.add(point * apart))))
            };
            let lanes: [[L; 3]; 4] = std::array::from_fn(of_output);
            for kx in 0..3 {
                let sums = L::sums(std::array::from_fn(|o| lanes[o][kx]));
                rows.iter_mut().zip(sums).for_each(|(row, sum)| row[kx] = sum);
            }
        }
        rows
    }
}
