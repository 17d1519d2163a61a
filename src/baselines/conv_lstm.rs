//! Convolutional LSTM (Shi et al. 2015, without peepholes): the memory is an image, the gates are convolutions.
//!
//! ```text
//! i, f, g, o = W * [x, h] + b
//! ```
//!
//! and on as in [`memory_step`].

use tch::Tensor;

use crate::network::blocks::{Activation, Conv2d, Layers};
use crate::network::dynamics::memory_step;

/// One layer. Its kernel `[4 * hidden, inputs + hidden, size, size]` holds the gates in the order i, f, g, o.
#[derive(Debug)]
pub struct ConvLstmCell {
    gates: Conv2d,
    hidden: i64,
}

impl ConvLstmCell {
    pub fn new(layers: &mut Layers, inputs: usize, hidden: usize, size: usize) -> Self {
        ConvLstmCell {
            gates: layers.conv2d(inputs + hidden, 4 * hidden, size, Activation::None),
            hidden: hidden as i64,
        }
    }

    /// The memory `[h, c]` before the first input, zero.
    pub fn start(&self, like: &Tensor) -> [Tensor; 2] {
        let size = like.size();
        [(); 2].map(|()| Tensor::zeros([size[0], self.hidden, size[2], size[3]], (like.kind(), like.device())))
    }

    /// `[h, c]` (each `[batch, hidden, height, width]`) after `x` (`[batch, inputs, height, width]`).
    pub fn step(&self, x: &Tensor, [h, c]: &[Tensor; 2]) -> [Tensor; 2] {
        memory_step(&self.gates.forward(&Tensor::cat(&[x, h], 1)), c)
    }
}
