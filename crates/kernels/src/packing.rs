//! Frames into blocks, where they stand side by side in the lanes, and back.

use super::planes::{PixelPlaces, Planes, PlanesMut};
use super::simd::{Lanes, dispatched};

/// Floats of as many vectors as the widest has lanes.
const SQUARE: usize = 16 * 16;

dispatched! {
    /// Frames `[up to a block, channels, S, S]` into a block; lanes without a frame become 0.
    fn pack(frames: &[f32], output: PlanesMut) = pack_lanes
}

#[inline(always)]
fn pack_lanes<L: Lanes>(frames: &[f32], output: PlanesMut) {
    let frame = output.channels * output.side * output.side;
    output.check::<L>();
    assert!(frames.len().is_multiple_of(frame) && frames.len() <= L::LANES * frame);
    let mut places = PixelPlaces::new::<L>(output.side);
    // Some pixels of all frames, `[frame][pixel]`, and turned.
    let (mut rows, mut turned) = ([0.0; SQUARE], [0.0; SQUARE]);
    for first in (0..frame).step_by(L::LANES) {
        let some = L::LANES.min(frame - first);
        for (row, frame) in rows.chunks_exact_mut(L::LANES).zip(frames.chunks_exact(frame)) {
            row[..some].copy_from_slice(&frame[first..first + some]);
        }
        // SAFETY: squares of vectors.
        unsafe { L::transpose(rows.as_ptr(), L::LANES, turned.as_mut_ptr()) };
        for pixel in turned.chunks_exact(L::LANES).take(some) {
            let place = places.advance();
            output.data[place..place + L::LANES].copy_from_slice(pixel);
        }
    }
}

dispatched! {
    /// A block's first frames into `[frames, channels, S, S]`: the inverse of [`pack`].
    fn unpack(input: Planes, frames: &mut [f32]) = unpack_lanes
}

#[inline(always)]
fn unpack_lanes<L: Lanes>(input: Planes, frames: &mut [f32]) {
    let frame = input.channels * input.side * input.side;
    input.check::<L>();
    assert!(frames.len().is_multiple_of(frame) && frames.len() <= L::LANES * frame);
    let mut places = PixelPlaces::new::<L>(input.side);
    let (mut seen, mut turned) = ([0.0; SQUARE], [0.0; SQUARE]);
    for first in (0..frame).step_by(L::LANES) {
        let some = L::LANES.min(frame - first);
        for pixel in seen.chunks_exact_mut(L::LANES).take(some) {
            let place = places.advance();
            pixel.copy_from_slice(&input.data[place..place + L::LANES]);
        }
        // SAFETY: squares of vectors.
        unsafe { L::transpose(seen.as_ptr(), L::LANES, turned.as_mut_ptr()) };
        for (row, frame) in turned.chunks_exact(L::LANES).zip(frames.chunks_exact_mut(frame)) {
            frame[first..first + some].copy_from_slice(&row[..some]);
        }
    }
}
