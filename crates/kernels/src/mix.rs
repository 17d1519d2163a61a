//! The convolution 1x1 at a network's end, sums over pixels, and the way of frames into and out of blocks.

use super::lanes::{Lanes, dispatched};
use super::planes::{Pixels, Planes, PlanesMut};

dispatched! {
    /// `output[o] = bias[o] + sum_c weight[o][c] input[c]`; `weight` is `[outputs, inputs]`.
    fn mix(weight: &[f32], bias: &[f32], input: Planes, output: PlanesMut) = mix_lanes
}

#[inline(always)]
fn mix_lanes<L: Lanes>(weight: &[f32], bias: &[f32], input: Planes, mut output: PlanesMut) {
    input.check::<L>();
    output.check::<L>();
    assert!(bias.len() == output.channels && weight.len() == bias.len() * input.channels);
    assert_eq!(output.side, input.side);
    for (o, (weights, &bias)) in weight.chunks_exact(input.channels).zip(bias).enumerate() {
        for y in 0..input.side {
            for x in 0..input.side {
                // SAFETY: pixels of planes whose sizes were checked.
                unsafe {
                    let mut sum = L::splat(bias);
                    for (c, &weight) in weights.iter().enumerate() {
                        sum = sum.add_product(L::splat(weight), L::load(input.at::<L>(c, y, x)));
                    }
                    sum.store(output.at_mut::<L>(o, y, x));
                }
            }
        }
    }
}

dispatched! {
    /// The gradient of [`mix`] before the ReLU that gave `input`; adds that of the weights to `sums`,
    /// `[outputs, inputs]`.
    fn mix_backward(weight: &[f32], input: Planes, gradient: Planes, output: PlanesMut, sums: &mut [f32]) = mix_backward_lanes
}

#[inline(always)]
fn mix_backward_lanes<L: Lanes>(
    weight: &[f32],
    input: Planes,
    gradient: Planes,
    mut output: PlanesMut,
    sums: &mut [f32],
) {
    input.check::<L>();
    gradient.check::<L>();
    output.check::<L>();
    assert!(output.channels == input.channels && weight.len() == gradient.channels * input.channels);
    assert!(output.side == input.side && gradient.side == input.side && sums.len() == weight.len());
    let side = input.side;
    for y in 0..side {
        for c in 0..input.channels {
            // SAFETY: pixels of planes whose sizes were checked.
            unsafe {
                for o in 0..gradient.channels {
                    let mut total = L::splat(0.0);
                    for x in 0..side {
                        let product = (L::load(input.at::<L>(c, y, x)), L::load(gradient.at::<L>(o, y, x)));
                        total = total.add_product(product.0, product.1);
                    }
                    sums[o * input.channels + c] += total.sum();
                }
                for x in 0..side {
                    let mut back = L::splat(0.0);
                    for o in 0..gradient.channels {
                        let weight = L::splat(weight[o * input.channels + c]);
                        back = back.add_product(weight, L::load(gradient.at::<L>(o, y, x)));
                    }
                    back.where_positive(L::load(input.at::<L>(c, y, x))).store(output.at_mut::<L>(c, y, x));
                }
            }
        }
    }
}

dispatched! {
    /// Adds the sum over each channel's pixels to `sums`: a bias's gradient.
    fn add_pixels(planes: Planes, sums: &mut [f32]) = add_pixels_lanes
}

#[inline(always)]
fn add_pixels_lanes<L: Lanes>(planes: Planes, sums: &mut [f32]) {
    planes.check::<L>();
    assert_eq!(sums.len(), planes.channels);
    for (channel, sum) in sums.iter_mut().enumerate() {
        // SAFETY: pixels of planes whose sizes were checked.
        unsafe {
            let mut total = L::splat(0.0);
            for y in 0..planes.side {
                let mut of_row = L::splat(0.0);
                for x in 0..planes.side {
                    of_row = of_row.add(L::load(planes.at::<L>(channel, y, x)));
                }
                total = total.add(of_row);
            }
            *sum += total.sum();
        }
    }
}

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
    let mut places = Pixels::new::<L>(output.side);
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
    let mut places = Pixels::new::<L>(input.side);
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
