//! The 1x1 convolution at the end of the U-Net, forward and backward, on blocks of frames.

use super::planes::{Planes, PlanesMut};
use super::simd::{Lanes, dispatched};

dispatched! {
    /// `output[o] = bias[o] + sum_c weight[o][c] input[c]`; `weight` is `[outputs, inputs]`.
    fn forward(weight: &[f32], bias: &[f32], input: Planes, output: PlanesMut) = forward_lanes
}

#[inline(always)]
fn forward_lanes<L: Lanes>(weight: &[f32], bias: &[f32], input: Planes, mut output: PlanesMut) {
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
    /// The gradient of [`forward`] before the ReLU that gave `input`; adds that of the weights to `sums`,
    /// `[outputs, inputs]`.
    fn backward(weight: &[f32], input: Planes, gradient: Planes, output: PlanesMut, sums: &mut [f32]) = backward_lanes
}

#[inline(always)]
fn backward_lanes<L: Lanes>(weight: &[f32], input: Planes, gradient: Planes, mut output: PlanesMut, sums: &mut [f32]) {
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
