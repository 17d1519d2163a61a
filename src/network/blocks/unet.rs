//! The encoder's two U-Nets. Original: `shallow_unet`, `unet` of `blocks.py`; paper: section 3.1.

use tch::Tensor;

use super::{Activation, Conv2d, Layers, resize_bilinear_x2};
use crate::kernels::{Instructions, Kernels, Shape, UNetKernel};

/// A U-Net: `levels` times two convolutions and a 2x2 max pooling with the width doubling, and the way back up with
/// skip connections. Gives one mask logit per object and pixel.
#[derive(Debug)]
pub struct UNet {
    /// Two convolutions for each level, the lowest (not pooled) last.
    down: Vec<[Conv2d; 2]>,
    /// From the lowest level up: the linear convolution after the up-sampling, and the two after the concatenation.
    up: Vec<(Conv2d, [Conv2d; 2])>,
    logits: Conv2d,
    /// Computes it where libtorch need not.
    kernel: Option<UNetKernel>,
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

    pub fn of_shape(layers: &mut Layers, shape: Shape, kernels: Kernels) -> Self {
        let Shape { channels, objects, base, poolings, .. } = shape;
        let mut down = Vec::new();
        let (mut inputs, mut width) = (channels, base);
        for _ in 0..=poolings {
            down.push([
                layers.conv2d(inputs, width, 3, Activation::Relu),
                layers.conv2d(width, width, 3, Activation::Relu),
            ]);
            inputs = width;
            width *= 2;
        }
        let mut up = Vec::new();
        for level in (0..poolings).rev() {
            let skip = base << level;
            let upsampled = layers.conv2d(inputs, 2 * base, 3, Activation::None);
            up.push((
                upsampled,
                [
                    layers.conv2d(2 * base + skip, skip, 3, Activation::Relu),
                    layers.conv2d(skip, skip, 3, Activation::Relu),
                ],
            ));
            inputs = skip;
        }
        let kernel = (kernels == Kernels::Own).then(|| UNetKernel::new(Instructions::best(), shape));
        UNet { down, up, logits: layers.conv2d(base, objects, 1, Activation::None), kernel }
    }

    /// Weights and biases of all layers, in their order.
    fn layers(&self) -> Vec<(&Tensor, &Tensor)> {
        let down = self.down.iter().flatten();
        let up = self.up.iter().flat_map(|(upsampled, after)| std::iter::once(upsampled).chain(after));
        down.chain(up).chain([&self.logits]).map(|layer| (&layer.weight, &layer.bias)).collect()
    }

    /// `[frames, channels, S, S]` in \[0, 1\] to logits `[frames, objects, S, S]`.
    pub fn forward(&self, frames: &Tensor) -> Tensor {
        match &self.kernel {
            Some(kernel) if kernel.serves(frames, &self.logits.weight) => kernel.forward(&self.layers(), frames),
            _ => self.forward_by_libtorch(frames),
        }
    }

    fn forward_by_libtorch(&self, frames: &Tensor) -> Tensor {
        let mut skips: Vec<Tensor> = Vec::new();
        let mut h = frames.shallow_clone();
        for [first, second] in &self.down {
            if !skips.is_empty() {
                h = h.max_pool2d(2, 2, 0, 1, false);
            }
            h = second.forward(&first.forward(&h));
            skips.push(h.shallow_clone());
        }
        skips.pop();
        for (upsampled, [first, second]) in &self.up {
            let skip = skips.pop().expect("one skip connection for each level");
            h = Tensor::cat(&[upsampled.forward(&resize_bilinear_x2(&h)), skip], 1);
            h = second.forward(&first.forward(&h));
        }
        self.logits.forward(&h)
    }

    /// Gives the logits another order: the one that was `order[i]` (`[objects]`) is i from now on.
    pub fn reorder_logits(&self, order: &Tensor) {
        let _guard = tch::no_grad_guard();
        let Conv2d { weight, bias, .. } = &self.logits;
        for values in [weight, bias] {
            values.shallow_clone().copy_(&values.index_select(0, order));
        }
    }

    /// Replaces each logit y by `scale (y - mean) + centre`; `mean` is `[objects]`.
    pub fn rescale_logits(&self, scale: &Tensor, mean: &Tensor, centre: f64) {
        let _guard = tch::no_grad_guard();
        let Conv2d { weight, bias, .. } = &self.logits;
        bias.shallow_clone().copy_(&((bias - mean) * scale + centre));
        let _ = weight.shallow_clone().g_mul_(scale);
    }
}
