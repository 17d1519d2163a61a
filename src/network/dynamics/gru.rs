//! Gated recurrent unit (Cho et al. 2014, in the form of cuDNN and PyTorch) on the positions of all objects.
//!
//! ```text
//! r = sigmoid(W_r x + b_r + U_r h + d_r)
//! z = sigmoid(W_z x + b_z + U_z h + d_z)
//! n = tanh(W_n x + b_n + r (U_n h + d_n))
//! h' = (1 - z) n + z h
//! ```

use tch::Tensor;

use super::{Features, Predictor};
use crate::network::blocks::{Activation, Dense, Layers};

/// Units of the memory.
const HIDDEN: usize = 115;

/// One step of the memory; both kernels hold r, z, n in this order.
#[derive(Debug)]
pub struct GruCell {
    /// W and b.
    input: Dense,
    /// U and d.
    recurrent: Dense,
    hidden: i64,
}

impl GruCell {
    pub fn new(layers: &mut Layers, inputs: usize, hidden: usize) -> Self {
        GruCell {
            input: layers.dense(inputs, 3 * hidden, Activation::None),
            recurrent: layers.dense(hidden, 3 * hidden, Activation::None),
            hidden: hidden as i64,
        }
    }

    /// The memory before the first input, zero.
    pub fn start(&self, like: &Tensor) -> Tensor {
        Tensor::zeros([like.size()[0], self.hidden], (like.kind(), like.device()))
    }

    /// h (`[batch, hidden]`) after `x` (`[batch, inputs]`).
    pub fn step(&self, x: &Tensor, h: &Tensor) -> Tensor {
        let (x, u) = (self.input.forward(x).chunk(3, 1), self.recurrent.forward(h).chunk(3, 1));
        let [r, z] = [0, 1].map(|gate| (&x[gate] + &u[gate]).sigmoid());
        let n = (&x[2] + r * &u[2]).tanh();
        &n + z * (h - &n)
    }
}

/// The memory, and a linear read-out.
#[derive(Debug)]
pub(super) struct Gru {
    cell: GruCell,
    output: Dense,
}

impl Gru {
    pub(super) fn new(layers: &mut Layers, features: &Features) -> Self {
        Gru {
            cell: GruCell::new(layers, features.in_frame(), HIDDEN),
            output: layers.dense(HIDDEN, features.positions(), Activation::None),
        }
    }
}

impl Predictor for Gru {
    fn see(&self, memory: &mut Vec<Tensor>, frame: &Tensor) {
        let before = memory.pop().unwrap_or_else(|| self.cell.start(frame));
        memory.push(self.cell.step(frame, &before));
    }

    fn change(&self, memory: &[Tensor]) -> Tensor {
        self.output.forward(&memory[0])
    }
}
