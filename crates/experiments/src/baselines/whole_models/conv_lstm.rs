//! Convolutional LSTM (Shi et al. 2015, without peepholes): the memory is an image, the gates are convolutions.
//!
//! ```text
//! i, f, g, o = W * [x, h] + b
//! ```
//!
//! and on as in [`memory_step`].

use tch::Tensor;

use paig::network::blocks::{Activation, Conv2d, Layers, PreparedConv2d};
use paig::network::dynamics::{FORGET_BIAS, memory_step};
use paig_kernels::{self, ConvolutionKernel, Instructions};

/// One layer. Its kernel `[4 * hidden, inputs + hidden, size, size]` holds the gates in the order i, f, g, o.
#[derive(Debug)]
pub struct ConvLstmCell {
    gates: Conv2d,
    kernel: ConvolutionKernel,
    hidden: i64,
}

/// A layer with its weights of one moment.
#[derive(Debug)]
pub struct PreparedConvLstm<'a> {
    gates: PreparedConv2d<'a>,
}

impl ConvLstmCell {
    pub fn new(layers: &mut Layers, inputs: usize, hidden: usize, size: usize) -> Self {
        ConvLstmCell {
            gates: layers.conv2d(inputs + hidden, 4 * hidden, size, Activation::None),
            kernel: ConvolutionKernel::new(Instructions::best()),
            hidden: hidden as i64,
        }
    }

    /// The memory `[h, c]` before the first input, zero.
    pub fn start(&self, like: &Tensor) -> [Tensor; 2] {
        let size = like.size();
        [(); 2].map(|()| Tensor::zeros([size[0], self.hidden, size[2], size[3]], (like.kind(), like.device())))
    }

    /// Ready for many steps.
    pub fn prepared(&self) -> PreparedConvLstm<'_> {
        PreparedConvLstm { gates: self.gates.prepared(&self.kernel) }
    }
}

impl PreparedConvLstm<'_> {
    /// `[h, c]` (each `[batch, hidden, side, side]`) after `x` (`[batch, inputs, side, side]`).
    pub fn step(&self, x: &Tensor, [h, c]: &[Tensor; 2]) -> [Tensor; 2] {
        let gates = self.gates.forward(&Tensor::cat(&[x, h], 1));
        if paig_kernels::serve(&[&gates, c]) {
            paig_kernels::memory_step(&gates, c, FORGET_BIAS as f32)
        } else {
            memory_step(&gates, c)
        }
    }
}
