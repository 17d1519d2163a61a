//! The gradients of a 3x3 convolution's weights, on blocks of frames.

use super::lanes::{Instructions, Lanes, dispatched};
use super::planes::{Planes, Workspace};
use super::threads::side_by_side;

/// Pixels over which a weight's gradient is summed before it goes to memory.
const STRETCH: usize = 64;

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
    let (side, row, plane) = (input.side, input.row::<L>(), input.plane::<L>());
    input.check::<L>();
    gradient.check::<L>();
    assert!(gradient.side == side && gradient.channels.is_multiple_of(O));
    let weights = input.channels * 9;
    assert!(sums.len() == gradient.channels * weights);
    let rows = (STRETCH / side).clamp(1, side);
    // Of `O` output channels, `[inputs][ky][kx][O]` vectors of lanes.
    let totals = workspace.floats(weights * O * L::LANES);
    for first in (0..gradient.channels).step_by(O) {
        for top in (0..side).step_by(rows) {
            for channel in 0..input.channels {
                for ky in 0..3 {
                    // SAFETY: rows and their neighbours lie within the planes, whose sizes were checked.
                    unsafe {
                        let totals = totals.as_mut_ptr().add((channel * 3 + ky) * 3 * O * L::LANES);
                        let seen = input.data.as_ptr().add(channel * plane + (top + ky) * row);
                        let moved = gradient.data.as_ptr().add(first * plane + (top + 1) * row + L::LANES);
                        let rows = rows.min(side - top);
                        add_products::<L, O>(totals, top == 0, seen, moved, (rows, side), (row, plane));
                    }
                }
            }
        }
        for (i, totals) in totals.chunks_exact(4 * L::LANES).enumerate() {
            let (output, weight) = (first + i * 4 % O, i * 4 / O);
            // SAFETY: the chunk has as many floats as four vectors.
            let four = unsafe { L::sums(std::array::from_fn(|o| L::load(totals.as_ptr().add(o * L::LANES)))) };
            for (o, sum) in four.into_iter().enumerate() {
                sums[(output + o) * weights + weight] += sum;
            }
        }
    }
}

/// Adds to `sums`, `[kx][O]`, or where they are `new` puts there, the products of `O` channels of the gradient with a
/// channel's pixels at the three `kx`.
#[inline(always)]
unsafe fn add_products<L: Lanes, const O: usize>(
    sums: *mut f32,
    new: bool,
    seen: *const f32,
    gradient: *const f32,
    (rows, side): (usize, usize),
    (row, plane): (usize, usize),
) {
    unsafe {
        let at = |kx: usize, o: usize| sums.add((kx * O + o) * L::LANES);
        let start = |kx, o| if new { L::splat(0.0) } else { L::load(at(kx, o)) };
        let mut totals: [[L; 3]; O] = std::array::from_fn(|o| std::array::from_fn(|kx| start(kx, o)));
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
