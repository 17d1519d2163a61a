//! A convolution with zero padding and stride 1 that is applied many times between two changes of its weights, as a recurrent
//! layer's is. The kernel computes those of 3x3.

use std::sync::Arc;

use tch::{Device, Kind, Tensor};

use crate::autograd;
use crate::backend::{Backend, Kernels};
use crate::convolution::{ConvolutionKernel, ConvolutionMemory};
use crate::simd::Instructions;
use crate::tensors::{floats, floats_mut};

/// What a layer keeps from one change of its weights to the next.
#[derive(Debug)]
pub struct Convolution {
    kernels: Kernels,
    memory: Arc<ConvolutionMemory>,
}

impl Convolution {
    pub fn new(kernels: Kernels) -> Self {
        Convolution { kernels, memory: Arc::new(ConvolutionMemory::new()) }
    }

    /// Whether the kernel computes a layer with this weight `[outputs, inputs, height, width]`; otherwise libtorch does.
    pub fn has_kernel_for(&self, weight: &Tensor) -> bool {
        self.instructions_for(weight).is_some()
    }

    fn instructions_for(&self, weight: &Tensor) -> Option<Instructions> {
        let Backend::Cpu(instructions) = self.kernels.backend(&[weight]) else { return None };
        let size = weight.size();
        let fits = size[..2].iter().all(|channels| ConvolutionKernel::fits(instructions, *channels as usize));
        (size[2..] == [3, 3] && fits).then_some(instructions)
    }

    /// The layer with its weights as they are now.
    pub fn prepared(&self, weight: &Tensor, bias: &Tensor) -> PreparedConvolution {
        let kernel = self.instructions_for(weight).map(|instructions| {
            let values = [weight, bias].map(|tensor| tensor.detach().contiguous());
            let [weights, biases] = values.each_ref().map(floats);
            Arc::new(ConvolutionKernel::new(instructions, weights, biases, Arc::clone(&self.memory)))
        });
        PreparedConvolution { kernel, variables: [weight, bias].map(Tensor::shallow_clone) }
    }
}

/// A convolution with the weights of one moment, differentiable by its input and by them.
#[derive(Debug)]
pub struct PreparedConvolution {
    kernel: Option<Arc<ConvolutionKernel>>,
    variables: [Tensor; 2],
}

impl PreparedConvolution {
    /// `[pictures, inputs, S, S]` to `[pictures, outputs, S, S]`.
    pub fn forward(&self, pictures: &Tensor) -> Tensor {
        let [weight, bias] = &self.variables;
        match &self.kernel {
            Some(kernel) => on_cpu(kernel, [pictures, weight, bias]),
            None => pictures.conv2d(weight, Some(bias), 1, weight.size()[2] / 2, 1, 1),
        }
    }
}

fn on_cpu(kernel: &Arc<ConvolutionKernel>, inputs: [&Tensor; 3]) -> Tensor {
    let pictures = inputs[0];
    let sizes = inputs.map(|input| input.size());
    let (count, channels, side, width) = pictures.size4().expect("pictures [pictures, channels, S, S]");
    assert!(side == width && channels == sizes[1][1], "square pictures of the layer's channels");
    let mut results = Tensor::empty([count, kernel.outputs() as i64, side, side], (Kind::Float, Device::Cpu));
    let seen = pictures.detach().contiguous();
    let pass = kernel.forward(side as usize, floats(&seen), floats_mut(&mut results));
    if !autograd::records(&inputs) {
        return results;
    }
    autograd::attach(results, &inputs, move |gradient| {
        let mut by_pictures = Tensor::empty(&sizes[0], (Kind::Float, Device::Cpu));
        let (weight, bias) = pass.backward(floats(&gradient.contiguous()), floats_mut(&mut by_pictures));
        vec![by_pictures, Tensor::from_slice(&weight).reshape(&sizes[1]), Tensor::from_slice(&bias)]
    })
}
