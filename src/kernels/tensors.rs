//! The kernels on tensors, within libtorch's autograd.

use tch::{Device, Kind, Tensor};

use super::autograd;
use super::lanes::Instructions;
use super::unet::{Kernel, Shape};

/// The U-Net of one shape.
#[derive(Debug)]
pub struct UNetKernel(Kernel);

impl UNetKernel {
    pub fn new(instructions: Instructions, shape: Shape) -> Self {
        UNetKernel(Kernel::new(instructions, shape))
    }

    /// Whether these frames, and weights of this kind, can be computed with: float32 in the main memory; the gradient by
    /// the frames is not computed.
    pub fn serves(&self, frames: &Tensor, weight: &Tensor) -> bool {
        let float = |tensor: &Tensor| tensor.kind() == Kind::Float && tensor.device() == Device::Cpu;
        float(frames) && float(weight) && !autograd::records(&[frames])
    }

    /// Frames `[frames, channels, S, S]` to logits `[frames, objects, S, S]`, differentiable by the weights. `layers` are
    /// weights and biases in the network's order.
    pub fn forward(&self, layers: &[(&Tensor, &Tensor)], frames: &Tensor) -> Tensor {
        let variables: Vec<&Tensor> = layers.iter().flat_map(|&(weight, bias)| [weight, bias]).collect();
        let values: Vec<_> = layers.iter().map(|(weight, bias)| (numbers(weight), numbers(bias))).collect();
        let Shape { side, channels, objects, .. } = self.0.shape();
        let frames = frames.detach().contiguous();
        assert_eq!(frames.size()[1..], [channels, side, side].map(|n| n as i64), "frames of the network's shape");
        let mut logits =
            Tensor::empty([frames.size()[0], objects as i64, side as i64, side as i64], (Kind::Float, Device::Cpu));
        let pass = self.0.forward(&values, floats(&frames), floats_mut(&mut logits), autograd::records(&variables));
        let Some(pass) = pass else { return logits };
        let sizes: Vec<_> = variables.iter().map(|variable| variable.size()).collect();
        autograd::attach(logits, &variables, move |gradient| {
            let gradients = pass.backward(floats(&gradient.contiguous()));
            let gradients = gradients.into_iter().flat_map(|(weight, bias)| [weight, bias]);
            gradients.zip(&sizes).map(|(values, size)| Tensor::from_slice(&values).reshape(size)).collect()
        })
    }
}

fn numbers(tensor: &Tensor) -> Vec<f32> {
    floats(&tensor.detach().contiguous()).to_vec()
}

/// The memory of a tensor.
fn floats(tensor: &Tensor) -> &[f32] {
    check(tensor);
    // SAFETY: as many floats as the tensor has, side by side, which live as long as it does.
    unsafe { std::slice::from_raw_parts(tensor.data_ptr().cast(), tensor.numel()) }
}

/// The memory of a tensor that nothing else has a view of.
fn floats_mut(tensor: &mut Tensor) -> &mut [f32] {
    check(tensor);
    // SAFETY: as above, and the tensor is borrowed alone.
    unsafe { std::slice::from_raw_parts_mut(tensor.data_ptr().cast(), tensor.numel()) }
}

/// # Panics
/// A tensor whose memory is not a list of floats.
fn check(tensor: &Tensor) {
    assert!(tensor.kind() == Kind::Float && tensor.device() == Device::Cpu && tensor.is_contiguous());
}
