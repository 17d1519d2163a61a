//! Sums with an output channel in each lane: `[x][y][input][output]`.
//!
//! The transformed gradient is turned from frames in its lanes to outputs in them; what a kernel saw is taken frame by frame.

use super::super::filtering::{PRODUCTS, Tiles, taps};
use super::super::simd::{Lanes, dispatched};
use super::KernelGradients;

dispatched! {
    /// Adds the products of as many outputs as a vector has lanes with some inputs.
    fn add(
        tiles: &Tiles,
        inputs: usize,
        seen: &[f32],
        moved: &[f32],
        turned: &mut [f32],
        totals: &mut [f32],
    ) = add_lanes
}

#[inline(always)]
fn add_lanes<L: Lanes>(
    tiles: &Tiles,
    inputs: usize,
    seen: &[f32],
    moved: &[f32],
    turned: &mut [f32],
    totals: &mut [f32],
) {
    let count = tiles.count();
    assert!(
        seen.len() >= tiles.transformed(inputs) * L::LANES && moved.len() >= tiles.transformed(L::LANES) * L::LANES
    );
    assert!(turned.len() >= count * L::LANES * L::LANES && totals.len() >= PRODUCTS * inputs * L::LANES);
    let (seen, moved) = (seen.as_ptr(), moved.as_ptr());
    let (turned, totals) = (turned.as_mut_ptr(), totals.as_mut_ptr());
    for point in 0..PRODUCTS {
        // SAFETY: points, channels and tiles of what was checked.
        unsafe {
            let moved = moved.add(point * tiles.apart(L::LANES) * L::LANES);
            for tile in 0..count {
                let to = turned.add(tile * L::LANES * L::LANES);
                L::transpose(moved.add(tile * L::LANES), count * L::LANES, to);
            }
            let seen = seen.add(point * tiles.apart(inputs) * L::LANES);
            let totals = totals.add(point * inputs * L::LANES);
            let mut input = 0;
            while input < inputs {
                let strip = OutputStrip { seen: seen.add(input * count * L::LANES), turned, frames: count * L::LANES };
                let totals = totals.add(input * L::LANES);
                input += match inputs - input {
                    1 => strip.add::<L, 1>(totals),
                    2 | 3 => strip.add::<L, 2>(totals),
                    4..8 => strip.add::<L, 4>(totals),
                    16.. if L::LANES == 16 => strip.add::<L, 16>(totals),
                    _ => strip.add::<L, 8>(totals),
                }
            }
        }
    }
}

/// Some inputs at a point.
struct OutputStrip {
    /// `[input][frame]`, the frames being those of all tiles.
    seen: *const f32,
    /// `[frame][output]`.
    turned: *const f32,
    frames: usize,
}

impl OutputStrip {
    /// Of `I` inputs, in registers; gives `I`.
    ///
    /// # Safety
    /// As of [`Lanes`]; there are the frames that the strip names, and `I` totals.
    #[inline(always)]
    unsafe fn add<L: Lanes, const I: usize>(&self, totals: *mut f32) -> usize {
        unsafe {
            let mut sums = [L::splat(0.0); I];
            sums.iter_mut().enumerate().for_each(|(i, sum)| *sum = L::load(totals.add(i * L::LANES)));
            for frame in 0..self.frames {
                let turned = L::load(self.turned.add(frame * L::LANES));
                for (i, sum) in sums.iter_mut().enumerate() {
                    *sum = sum.add_product(L::splat(*self.seen.add(i * self.frames + frame)), turned);
                }
            }
            sums.iter().enumerate().for_each(|(i, sum)| sum.store(totals.add(i * L::LANES)));
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
    assert!(totals.len() >= PRODUCTS * kernels.inputs * L::LANES);
    let mut lanes = [0.0; 16];
    for input in 0..kernels.inputs {
        // SAFETY: the sums of an input at all points; no vector has more lanes than 16.
        unsafe {
            let taps = taps::<L>(totals.as_ptr().add(input * L::LANES), kernels.inputs * L::LANES);
            for (tap, values) in taps.as_flattened().iter().enumerate() {
                values.store(lanes.as_mut_ptr());
                for (output, part) in lanes.iter().enumerate().take(L::LANES) {
                    kernels.add(output, input, tap, *part);
                }
            }
        }
    }
}
