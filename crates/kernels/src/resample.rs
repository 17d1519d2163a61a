//! 2x2 max-pooling and the doubling of a picture's sides, with their gradients through the ReLU before them.

use super::planes::{Planes, PlanesMut};
use super::simd::{Lanes, dispatched};

/// The pixels of a window of 2x2, in the order in which the first of equal ones counts as the largest.
const WINDOW: [(usize, usize); 4] = [(0, 0), (0, 1), (1, 0), (1, 1)];

dispatched! {
    /// Half the side, the largest of each 2x2 pixels.
    fn max_pool(input: Planes, output: PlanesMut) = max_pool_lanes
}

#[inline(always)]
fn max_pool_lanes<L: Lanes>(input: Planes, mut output: PlanesMut) {
    input.check::<L>();
    output.check::<L>();
    assert!(input.side == 2 * output.side && input.channels == output.channels);
    for channel in 0..output.channels {
        for y in 0..output.side {
            for x in 0..output.side {
                // SAFETY: pixels of planes whose sizes were checked.
                unsafe {
                    let largest = WINDOW.map(|(dy, dx)| L::load(input.at::<L>(channel, 2 * y + dy, 2 * x + dx)));
                    let [a, b, c, d] = largest;
                    a.max(b).max(c.max(d)).store(output.at_mut::<L>(channel, y, x));
                }
            }
        }
    }
}

/// What [`max_pool_backward`] needs: of the pooled layer's ReLU the result, that pooled, and the gradients of what was
/// pooled and of the layer's other reader, which took it as it was.
#[derive(Debug, Clone, Copy)]
pub struct Pooled<'a> {
    pub activation: Planes<'a>,
    pub pooled: Planes<'a>,
    pub pooled_gradient: Planes<'a>,
    pub other_gradient: Planes<'a>,
}

dispatched! {
    /// The gradient before the ReLU.
    fn max_pool_backward(pooled: Pooled, output: PlanesMut) = max_pool_backward_lanes
}

#[inline(always)]
fn max_pool_backward_lanes<L: Lanes>(given: Pooled, mut output: PlanesMut) {
    let Pooled { activation, pooled, pooled_gradient, other_gradient } = given;
    for planes in [activation, pooled, pooled_gradient, other_gradient] {
        planes.check::<L>();
        assert_eq!(planes.channels, output.channels);
    }
    output.check::<L>();
    assert!(activation.side == output.side && other_gradient.side == output.side && output.side == 2 * pooled.side);
    assert!(pooled_gradient.side == pooled.side);
    for channel in 0..pooled.channels {
        for y in 0..pooled.side {
            for x in 0..pooled.side {
                // SAFETY: pixels of planes whose sizes were checked.
                unsafe {
                    let largest = L::load(pooled.at::<L>(channel, y, x));
                    let mut rest = L::load(pooled_gradient.at::<L>(channel, y, x));
                    for (dy, dx) in WINDOW {
                        let (y, x) = (2 * y + dy, 2 * x + dx);
                        let value = L::load(activation.at::<L>(channel, y, x));
                        let (here, left) = rest.split_equal(value, largest);
                        rest = left;
                        let gradient = here.add(L::load(other_gradient.at::<L>(channel, y, x)));
                        gradient.where_positive(value).store(output.at_mut::<L>(channel, y, x));
                    }
                }
            }
        }
    }
}

dispatched! {
    /// Twice the side: `out[2i] = in[i]`, `out[2i+1] = (in[i] + in[min(i+1, n-1)]) / 2` on each axis.
    fn double(input: Planes, output: PlanesMut) = double_lanes
}

#[inline(always)]
fn double_lanes<L: Lanes>(input: Planes, mut output: PlanesMut) {
    input.check::<L>();
    output.check::<L>();
    assert!(output.side == 2 * input.side && input.channels == output.channels);
    let last = input.side - 1;
    for channel in 0..input.channels {
        for y in 0..input.side {
            for x in 0..input.side {
                let (below, right) = ((y + 1).min(last), (x + 1).min(last));
                // SAFETY: pixels of planes whose sizes were checked.
                unsafe {
                    let half = L::splat(0.5);
                    let [a, b, c, d] = [(y, x), (y, right), (below, x), (below, right)]
                        .map(|(y, x)| L::load(input.at::<L>(channel, y, x)));
                    let (left, middle) = (a.add(c).mul(half), a.add(b).mul(half));
                    let lower = c.add(d).mul(half);
                    a.store(output.at_mut::<L>(channel, 2 * y, 2 * x));
                    middle.store(output.at_mut::<L>(channel, 2 * y, 2 * x + 1));
                    left.store(output.at_mut::<L>(channel, 2 * y + 1, 2 * x));
                    middle.add(lower).mul(half).store(output.at_mut::<L>(channel, 2 * y + 1, 2 * x + 1));
                }
            }
        }
    }
}

dispatched! {
    /// From the gradient of the doubled picture that before the ReLU which gave `activation`.
    fn double_backward(gradient: Planes, activation: Planes, output: PlanesMut) = double_backward_lanes
}

#[inline(always)]
fn double_backward_lanes<L: Lanes>(gradient: Planes, activation: Planes, mut output: PlanesMut) {
    gradient.check::<L>();
    activation.check::<L>();
    output.check::<L>();
    let side = output.side;
    assert!(gradient.side == 2 * side && activation.side == side);
    assert!(gradient.channels == output.channels && activation.channels == output.channels);
    let row = gradient.row::<L>();
    // Of the pixel before, the pixel, and the one after, which at the end repeats the last element.
    let weights = |i: usize| [0.5, 1.0, if i + 1 == side { 1.0 } else { 0.5 }];
    for channel in 0..output.channels {
        for y in 0..side {
            for x in 0..side {
                // SAFETY: pixels of planes whose sizes were checked, and their border.
                unsafe {
                    let from = gradient.at::<L>(channel, 2 * y, 2 * x).sub(row + L::LANES);
                    let mut sum = L::splat(0.0);
                    for (dy, wy) in weights(y).into_iter().enumerate() {
                        for (dx, wx) in weights(x).into_iter().enumerate() {
                            sum = sum.add_product(L::splat(wy * wx), L::load(from.add(dy * row + dx * L::LANES)));
                        }
                    }
                    sum.where_positive(L::load(activation.at::<L>(channel, y, x)))
                        .store(output.at_mut::<L>(channel, y, x));
                }
            }
        }
    }
}
