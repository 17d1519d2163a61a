//! Long short-term memory (Hochreiter, Schmidhuber 1997) on the positions of all objects.
//!
//! ```text
//! i, f, g, o = W [x, h] + b
//! c' = sigmoid(f + 1) c + sigmoid(i) tanh(g)
//! h' = sigmoid(o) tanh(c')
//! ```
//!
//! The 1 keeps the memory at the start (Jozefowicz et al. 2015; TensorFlow's `forget_bias`).

use tch::Tensor;

use super::{Features, Predictor};
use crate::network::blocks::{Activation, Dense, Layers};
use paig_kernels::{Kernels, lstm_cell};

/// Units of the memory.
const HIDDEN: usize = 100;
/// Added to the forget gate.
pub const FORGET_BIAS: f64 = 1.0;

/// One step of the memory. Its kernel `[4 * hidden, inputs + hidden]` holds the gates in the order i, f, g, o.
#[derive(Debug)]
pub struct LstmCell {
    gates: Dense,
    hidden: i64,
}

impl LstmCell {
    pub fn new(layers: &mut Layers, inputs: usize, hidden: usize) -> Self {
        LstmCell { gates: layers.dense(inputs + hidden, 4 * hidden, Activation::None), hidden: hidden as i64 }
    }

    /// The memory `[h, c]` before the first input, zero.
    pub fn start(&self, like: &Tensor) -> [Tensor; 2] {
        [(); 2].map(|()| Tensor::zeros([like.size()[0], self.hidden], (like.kind(), like.device())))
    }

    /// `[h, c]` (each `[batch, hidden]`) after `x` (`[batch, inputs]`).
    pub fn step(&self, x: &Tensor, [h, c]: [&Tensor; 2]) -> [Tensor; 2] {
        let gates = self.gates.forward(&Tensor::cat(&[x, h], 1));
        // A few thousand numbers: not worth a kernel.
        lstm_cell(Kernels::Libtorch, &gates, c, FORGET_BIAS)
    }
}

/// The memory, and a linear read-out.
#[derive(Debug)]
pub(super) struct Lstm {
    cell: LstmCell,
    output: Dense,
}

impl Lstm {
    pub(super) fn new(layers: &mut Layers, features: &Features) -> Self {
        Lstm {
            cell: LstmCell::new(layers, features.in_frame(), HIDDEN),
            output: layers.dense(HIDDEN, features.positions(), Activation::None),
        }
    }
}

impl Predictor for Lstm {
    fn see(&self, memory: &mut Vec<Tensor>, frame: &Tensor) {
        if memory.is_empty() {
            memory.extend(self.cell.start(frame));
        }
        *memory = self.cell.step(frame, [&memory[0], &memory[1]]).into();
    }

    fn change(&self, memory: &[Tensor]) -> Tensor {
        self.output.forward(&memory[0])
    }
}
