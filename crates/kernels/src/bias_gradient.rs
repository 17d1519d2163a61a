//! The gradient of biases, on blocks of frames.

use super::planes::Planes;
use super::simd::{Lanes, dispatched};

dispatched! {
    /// Adds the gradient of the biases, the sum over each channel's pixels, to `sums`.
    fn add_bias_gradient(planes: Planes, sums: &mut [f32]) = add_bias_gradient_lanes
}

#[inline(always)]
fn add_bias_gradient_lanes<L: Lanes>(planes: Planes, sums: &mut [f32]) {
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
