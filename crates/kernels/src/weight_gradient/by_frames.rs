//! Sums with a frame in each lane: `[x][y][input][output][frame]`.

use super::super::filtering::{PRODUCTS, Tiles, taps};
use super::super::simd::{Lanes, dispatched};
use super::KernelGradients;

dispatched! {
    /// Adds the products of as many outputs as a convolution computes together with some inputs.
    fn add(tiles: &Tiles, inputs: usize, seen: &[f32], moved: &[f32], totals: &mut [f32]) = add_lanes
}

#[inline(always)]
fn add_lanes<L: Lanes>(tiles: &Tiles, inputs: usize, seen: &[f32], moved: &[f32], totals: &mut [f32]) {
    match L::OUTPUTS {
        8 => add_outputs::<L, 8>(tiles, inputs, seen, moved, totals),
        _ => add_outputs::<L, 4>(tiles, inputs, seen, moved, totals),
    }
}

#[inline(always)]
fn add_outputs<L: Lanes, const O: usize>(
    tiles: &Tiles,
    inputs: usize,
    seen: &[f32],
    moved: &[f32],
    totals: &mut [f32],
) {
    let of_channel = tiles.count() * L::LANES;
    assert!(seen.len() >= tiles.transformed(inputs) * L::LANES && moved.len() >= tiles.transformed(O) * L::LANES);
    assert!(totals.len() >= PRODUCTS * inputs * O * L::LANES);
    for point in 0..PRODUCTS {
        // SAFETY: points, channels and tiles of what was checked.
        unsafe {
            let moved = moved.as_ptr().add(point * tiles.apart(O) * L::LANES);
            let seen = seen.as_ptr().add(point * tiles.apart(inputs) * L::LANES);
            let totals = totals.as_mut_ptr().add(point * inputs * O * L::LANES);
            let mut input = 0;
            while input < inputs {
                let strip = FrameStrip { seen: seen.add(input * of_channel), moved, of_channel };
                let totals = totals.add(input * O * L::LANES);
                input += match inputs - input {
                    1 => strip.add::<L, O, 1>(totals),
                    2 | 4 => strip.add::<L, O, 2>(totals),
                    _ => strip.add::<L, O, 3>(totals),
                }
            }
        }
    }
}

/// Some inputs at a point.
struct FrameStrip {
    /// `[input][tile]`.
    seen: *const f32,
    /// `[output][tile]`.
    moved: *const f32,
    of_channel: usize,
}

impl FrameStrip {
    /// Of `O` outputs and `I` inputs, in registers over all tiles; gives `I`.
    ///
    /// # Safety
    /// As of [`Lanes`]; there are the tiles that the strip names, and `O` times `I` totals.
    #[inline(always)]
    unsafe fn add<L: Lanes, const O: usize, const I: usize>(&self, totals: *mut f32) -> usize {
        unsafe {
            let at = |i: usize, o: usize| totals.add((i * O + o) * L::LANES);
            let mut sums = [[L::splat(0.0); I]; O];
            for (o, sums) in sums.iter_mut().enumerate() {
                sums.iter_mut().enumerate().for_each(|(i, sum)| *sum = L::load(at(i, o)));
            }
            for here in (0..self.of_channel).step_by(L::LANES) {
                let mut seen = [L::splat(0.0); I];
                let input = |i: usize| self.seen.add(i * self.of_channel + here);
                seen.iter_mut().enumerate().for_each(|(i, seen)| *seen = L::load(input(i)));
                for (o, sums) in sums.iter_mut().enumerate() {
                    let moved = L::load(self.moved.add(o * self.of_channel + here));
                    for (sum, &seen) in sums.iter_mut().zip(&seen) {
                        *sum = sum.add_product(moved, seen);
                    }
                }
            }
            for (o, sums) in sums.iter().enumerate() {
                sums.iter().enumerate().for_each(|(i, sum)| sum.store(at(i, o)));
            }
            I
        }
    }
}

dispatched! {
    /// From the sums to the gradients.
    fn finish(totals: &[f32], kernels: KernelGradients) = finish_lanes
}

#[inline(always)]
fn finish_lanes<L: Lanes>(totals: &[f32], mut kernels: KernelGradients) {
    assert!(totals.len() >= PRODUCTS * kernels.inputs * L::OUTPUTS * L::LANES);
    for input in 0..kernels.inputs {
        for first in (0..L::OUTPUTS).step_by(4) {
            // SAFETY: the sums of an input and four outputs at all points.
            unsafe {
                let mut lanes = [[L::splat(0.0); 4]; 9];
                for output in 0..4 {
                    let totals = totals.as_ptr().add((input * L::OUTPUTS + first + output) * L::LANES);
                    let taps = taps::<L>(totals, kernels.inputs * L::OUTPUTS * L::LANES);
                    lanes.iter_mut().zip(taps.as_flattened()).for_each(|(lanes, &tap)| lanes[output] = tap);
                }
                for (tap, lanes) in lanes.into_iter().enumerate() {
                    let parts = L::sums(lanes);
                    parts.into_iter().enumerate().for_each(|(o, part)| kernels.add(first + o, input, tap, part));
                }
            }
        }
    }
}
