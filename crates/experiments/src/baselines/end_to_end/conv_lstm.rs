//! Convolutional LSTM (Shi et al. 2015, without peepholes): the memory is an image, the gates are convolutions.
//!
//! ```text
//! i, f, g, o = W * [x, h] + b
//! ```
//!
//! and on as in [`lstm_cell`].

use tch::Tensor;

use paig::network::blocks::{Activation, Conv2d, Layers, PreparedConv2d};
use paig::network::dynamics::FORGET_BIAS;
use paig_kernels::{Convolution, Kernels, lstm_cell};

/// One layer. Its kernel `[4 * hidden, inputs + hidden, size, size]` holds the gates in the order i, f, g, o.
#[derive(Debug)]
pub struct ConvLstmCell {
    gates: Conv2d,
    convolution: Convolution,
    hidden: i64,
    kernels: Kernels,
}

/// A layer with its weights of one moment.
#[derive(Debug)]
pub struct PreparedConvLstm {
    gates: PreparedConv2d,
    kernels: Kernels,
}

impl ConvLstmCell {
    pub fn new(layers: &mut Layers, inputs: usize, hidden: usize, size: usize, kernels: Kernels) -> Self {
        ConvLstmCell {
            gates: layers.conv2d(inputs + hidden, 4 * hidden, size, Activation::None),
            convolution: Convolution::new(kernels),
            hidden: hidden as i64,
            kernels,
        }
    }

    /// The memory `[h, c]` before the first input, zero.
    pub fn start(&self, like: &Tensor) -> [Tensor; 2] {
        let size = like.size();
        [(); 2].map(|()| Tensor::zeros([size[0], self.hidden, size[2], size[3]], (like.kind(), like.device())))
    }

    /// Ready for many steps.
    pub fn prepared(&self) -> PreparedConvLstm {
        PreparedConvLstm { gates: self.gates.prepared(&self.convolution), kernels: self.kernels }
    }
}

impl PreparedConvLstm {
    /// `[h, c]` (each `[batch, hidden, side, side]`) after `x` (`[batch, inputs, side, side]`).
    pub fn step(&self, x: &Tensor, [h, c]: &[Tensor; 2]) -> [Tensor; 2] {
        let gates = self.gates.forward(&Tensor::cat(&[x, h], 1));
        lstm_cell(self.kernels, &gates, c, FORGET_BIAS)
    }
}
