//! The encoder's two U-Nets. Original: `shallow_unet`, `unet` of `blocks.py`; paper: section 3.1.

use tch::Tensor;

use super::{Activation, Conv2d, Layers};
use paig_kernels::{Kernels, Shape, UNetOperation};

/// A U-Net: `levels` times two convolutions and a 2x2 max pooling with the width doubling, and the way back up with
/// skip connections. Gives one mask logit per object and pixel.
#[derive(Debug)]
pub struct UNet {
    /// In the order of [`Shape::layers`].
    layers: Vec<Conv2d>,
    operation: UNetOperation,
}

/// Base width and poolings of the two networks (original: `shallow_unet`, `unet`).
const SHALLOW: (usize, usize) = (8, 2);
const DEEP: (usize, usize) = (16, 3);
/// Frames smaller than this go through the shallow network.
const DEEP_FROM_SIDE: usize = 40;

/// Whether frames of this side go through the deep U-Net (and its masked frames are halved before the dense layers).
pub fn uses_deep_unet(side: usize) -> bool {
    side >= DEEP_FROM_SIDE
}

/// What the side of a frame must be a multiple of, so that every pooling halves it: 4, or 8 in the deep U-Net.
pub fn side_multiple(side: usize) -> usize {
    let (_, poolings) = if uses_deep_unet(side) { DEEP } else { SHALLOW };
    1 << poolings
}

impl UNet {
    /// The shape of the U-Net the original uses for frames of this side.
    pub fn shape(side: usize, channels: usize, objects: usize) -> Shape {
        let (base, poolings) = if uses_deep_unet(side) { DEEP } else { SHALLOW };
        Shape { side, channels, objects, base, poolings }
    }

    /// The U-Net the original uses for frames of this side.
    pub fn for_side(layers: &mut Layers, side: usize, channels: usize, objects: usize, kernels: Kernels) -> Self {
        Self::of_shape(layers, Self::shape(side, channels, objects), kernels)
    }

    pub(crate) fn of_shape(layers: &mut Layers, shape: Shape, kernels: Kernels) -> Self {
        let sizes = shape.layers();
        let logits = sizes.len() - 1;
        // Only the operation applies them: it knows what follows each.
        let layer = |(place, (inputs, outputs)): (usize, (usize, usize))| {
            layers.conv2d(inputs, outputs, if place == logits { 1 } else { 3 }, Activation::None)
        };
        let layers = sizes.into_iter().enumerate().map(layer).collect();
        UNet { layers, operation: UNetOperation::new(kernels, shape) }
    }

    /// Weights and biases of all layers, in their order.
    fn variables(&self) -> Vec<(&Tensor, &Tensor)> {
        self.layers.iter().map(|layer| (&layer.weight, &layer.bias)).collect()
    }

    fn logits(&self) -> &Conv2d {
        self.layers.last().expect("a network has layers")
    }

    /// `[frames, channels, S, S]` in \[0, 1\] to logits `[frames, objects, S, S]`.
    pub fn forward(&self, frames: &Tensor) -> Tensor {
        self.operation.forward(&self.variables(), frames)
    }

    /// Gives the logits another order: the one that was `order[i]` (`[objects]`) is i from now on.
    pub(crate) fn reorder_logits(&self, order: &Tensor) {
        let _guard = tch::no_grad_guard();
        let Conv2d { weight, bias, .. } = self.logits();
        for values in [weight, bias] {
            values.shallow_clone().copy_(&values.index_select(0, order));
        }
    }

    /// Replaces each logit y by `scale (y - mean) + centre`; `mean` is `[objects]`.
    pub(crate) fn rescale_logits(&self, scale: &Tensor, mean: &Tensor, centre: f64) {
        let _guard = tch::no_grad_guard();
        let Conv2d { weight, bias, .. } = self.logits();
        bias.shallow_clone().copy_(&((bias - mean) * scale + centre));
        let _ = weight.shallow_clone().g_mul_(scale);
    }
}

#[cfg(test)]
mod tests {
    use tch::nn::VarStore;
    use tch::{Device, Kind};

    use super::*;
    use paig_kernels::allow_tf32;
    use paig_kernels::gpu;
    use paig_kernels::gpu::testing::test_device;

    /// The deep network and the shallow one, of sides that quads of pixels divide and that they do not, of one frame and of more
    /// than a block has.
    #[test]
    fn the_kernels_for_gpus_are_the_network_of_libtorch() {
        let Some(device) = test_device() else { return };
        // libtorch's convolutions on a GPU round their factors to ten bits unless they are told not to.
        allow_tf32(false);
        let few = [(32, 3, 2, 3), (36, 3, 3, 1), (64, 1, 2, 1), (12, 3, 5, 17)];
        // Enough for the blocks of many frames; on the processor only for those of the first level.
        let many = match device {
            Device::Cpu => [(32, 3, 2, 257)].as_slice(),
            _ => &[(32, 3, 2, 1100), (36, 3, 3, 1100), (64, 3, 2, 300)],
        };
        for &(side, channels, objects, frames) in few.iter().chain(many) {
            let store = VarStore::new(device);
            let mut layers = Layers::new(store.root());
            let shape = UNet::shape(side as usize, channels, objects);
            let network = UNet::of_shape(&mut layers, shape, Kernels::Libtorch);
            // The same numbers in every run, between -1 and 1, scattered: their sums do not cancel.
            let scattered = |size: &[i64], seed: i64| {
                let place = Tensor::arange(size.iter().product::<i64>(), (Kind::Double, device)) + 1000 * seed;
                let hashed = (place * 12.9898).sin() * 43758.5453;
                ((&hashed - hashed.floor()) * 2.0 - 1.0).to_kind(Kind::Float).reshape(size)
            };
            tch::no_grad(|| {
                let mut variables: Vec<_> = store.variables().into_iter().collect();
                variables.sort_by(|a, b| a.0.cmp(&b.0));
                for (number, (_, mut value)) in variables.into_iter().enumerate() {
                    let size = value.size();
                    let inputs = size[1..].iter().product::<i64>() as f64;
                    value.copy_(&(scattered(&size, 1 + number as i64) / inputs.sqrt()));
                }
            });
            let pictures = scattered(&[frames, channels as i64, side, side], 0);
            let by_libtorch = network.forward(&pictures);
            let pull = scattered(&by_libtorch.size(), 99);
            let variables: Vec<_> = network.variables().into_iter().flat_map(|(weight, bias)| [weight, bias]).collect();
            let gradients =
                |of: &Tensor| Tensor::run_backward(&[(of * &pull).sum(Kind::Float)], &variables, false, false);
            let expected = gradients(&by_libtorch);
            let own = gpu::unet(shape, &network.variables(), &pictures);
            let found = gradients(&own);
            let error = |a: &Tensor, b: &Tensor| ((a - b).norm() / b.norm()).double_value(&[]);
            // Sums of up to some hundred float32 numbers in another order, layer after layer, libtorch's by Fourier transforms.
            let of_logits = error(&own, &by_libtorch);
            assert!(of_logits < 5e-5, "side {side}: {of_logits}");
            // Where two pixels of a pool are equal but for rounding, or one is as good as 0, all of its gradient goes another
            // way: one pixel of some thousand.
            let errors = found.iter().zip(&expected).map(|(found, expected)| error(found, expected));
            let largest = errors.fold(0.0, f64::max);
            assert!(largest < 2e-3, "side {side}: {largest}");
        }
    }
}
