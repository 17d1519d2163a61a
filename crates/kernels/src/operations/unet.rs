//! The U-Net: two 3x3 convolutions for each level, a 2x2 max pooling between levels, and the way back up with skip
//! connections.

use tch::{Device, Kind, Tensor};

use crate::autograd;
use crate::backend::{Backend, Kernels};
use crate::gpu;
use crate::interpolation::resize_bilinear_x2;
use crate::tensors::{floats, floats_mut, numbers};
use crate::unet::{Shape, UnetKernel};

/// The CPU kernel computes as many frames as a vector has lanes at a time, also where there are fewer. Below this number,
/// libtorch is faster.
const FEWEST_FRAMES: i64 = 5;

/// The U-Net of one shape.
#[derive(Debug)]
pub struct UNetOperation {
    kernels: Kernels,
    shape: Shape,
    /// None where libtorch computes on the CPU.
    kernel: Option<UnetKernel>,
}

impl UNetOperation {
    pub fn new(kernels: Kernels, shape: Shape) -> Self {
        let kernel = kernels.instructions().map(|instructions| UnetKernel::new(instructions, shape));
        UNetOperation { kernels, shape, kernel }
    }

    /// Frames `[frames, channels, S, S]` to logits `[frames, objects, S, S]`, differentiable by the weights; the gradient by
    /// the frames is libtorch's alone. `layers` are weights and biases in the network's order.
    pub fn forward(&self, layers: &[(&Tensor, &Tensor)], frames: &Tensor) -> Tensor {
        match (self.backend(layers, frames), &self.kernel) {
            (Backend::Cpu(_), Some(kernel)) => on_cpu(kernel, layers, frames),
            (Backend::Gpu, _) => gpu::unet(self.shape, layers, frames),
            (Backend::Cpu(_) | Backend::Libtorch, _) => by_libtorch(self.shape, layers, frames),
        }
    }

    fn backend(&self, layers: &[(&Tensor, &Tensor)], frames: &Tensor) -> Backend {
        let (weight, _) = layers.last().expect("a network has layers");
        let count = frames.size()[0];
        match self.kernels.backend(&[frames, weight]) {
            _ if autograd::records(&[frames]) => Backend::Libtorch,
            Backend::Cpu(_) if count < FEWEST_FRAMES && self.kernels == Kernels::Own => Backend::Libtorch,
            Backend::Gpu if count == 0 || !gpu::fits(self.shape.side, frames) => Backend::Libtorch,
            backend => backend,
        }
    }
}

fn on_cpu(kernel: &UnetKernel, layers: &[(&Tensor, &Tensor)], frames: &Tensor) -> Tensor {
    let variables: Vec<&Tensor> = layers.iter().flat_map(|&(weight, bias)| [weight, bias]).collect();
    let values: Vec<_> = layers.iter().map(|(weight, bias)| (numbers(weight), numbers(bias))).collect();
    let Shape { side, channels, objects, .. } = kernel.shape();
    let frames = frames.detach().contiguous();
    assert_eq!(frames.size()[1..], [channels, side, side].map(|n| n as i64), "frames of the network's shape");
    let mut logits =
        Tensor::empty([frames.size()[0], objects as i64, side as i64, side as i64], (Kind::Float, Device::Cpu));
    let pass = kernel.forward(&values, floats(&frames), floats_mut(&mut logits), autograd::records(&variables));
    let Some(pass) = pass else { return logits };
    let sizes: Vec<_> = variables.iter().map(|variable| variable.size()).collect();
    autograd::attach(logits, &variables, move |gradient| {
        let gradients = pass.backward(floats(&gradient.contiguous()));
        let gradients = gradients.into_iter().flat_map(|(weight, bias)| [weight, bias]);
        gradients.zip(&sizes).map(|(values, size)| Tensor::from_slice(&values).reshape(size)).collect()
    })
}

fn by_libtorch(shape: Shape, layers: &[(&Tensor, &Tensor)], frames: &Tensor) -> Tensor {
    let convolve = |x: &Tensor, layer: usize| {
        let (weight, bias) = layers[layer];
        x.conv2d(weight, Some(bias), 1, weight.size()[2] / 2, 1, 1)
    };
    // In place: the backward pass of a convolution does not need its result.
    let two_convolutions = |x: &Tensor, first: usize| convolve(&convolve(x, first).relu_(), first + 1).relu_();
    let mut skips: Vec<Tensor> = Vec::new();
    let mut h = frames.shallow_clone();
    for level in shape.levels() {
        if level > 0 {
            h = h.max_pool2d(2, 2, 0, 1, false);
        }
        h = two_convolutions(&h, shape.down(level));
        skips.push(h.shallow_clone());
    }
    skips.pop();
    for level in (0..shape.poolings).rev() {
        let skip = skips.pop().expect("one skip connection for each level");
        let layer = shape.up(level);
        h = Tensor::cat(&[convolve(&resize_bilinear_x2(&h), layer), skip], 1);
        h = two_convolutions(&h, layer + 1);
    }
    convolve(&h, layers.len() - 1)
}
