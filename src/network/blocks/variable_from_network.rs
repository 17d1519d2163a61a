//! Learned arrays. Original: `variable_from_network` of `blocks.py`.

use tch::Tensor;

use super::{Activation, Dense, Layers};

/// A learned array written as the output of a small network on a constant input, which conditions its training better
/// than a bare variable (original: `variable_from_network`).
#[derive(Debug)]
pub struct VariableFromNetwork {
    hidden: Dense,
    output: Dense,
    shape: Vec<i64>,
}

/// Of a learned array's network: its constant inputs and its hidden units.
pub(in crate::network) const CONSTANT_INPUTS: usize = 10;
pub(in crate::network) const HIDDEN: usize = 200;

impl VariableFromNetwork {
    pub fn new(layers: &mut Layers, shape: &[i64]) -> Self {
        let values: i64 = shape.iter().product();
        VariableFromNetwork {
            hidden: layers.dense(CONSTANT_INPUTS, HIDDEN, Activation::Tanh),
            output: layers.dense(HIDDEN, values as usize, Activation::None),
            shape: shape.to_vec(),
        }
    }

    /// The array, of the shape given at construction.
    pub fn value(&self) -> Tensor {
        let weight = &self.hidden.weight;
        let ones = Tensor::ones([1, CONSTANT_INPUTS as i64], (weight.kind(), weight.device()));
        self.output.forward(&self.hidden.forward(&ones)).reshape(&self.shape)
    }

    /// Begins the array at `values` (as many as it has, in its order), with the output kernel scaled by `kernel`.
    pub fn start_at(&self, values: &Tensor, kernel: f64) {
        self.output.start_at(values, kernel);
    }

    /// The same array as a constant; see [`Dense::detached`].
    pub(crate) fn detached(&self) -> Self {
        VariableFromNetwork {
            hidden: self.hidden.detached(),
            output: self.output.detached(),
            shape: self.shape.clone(),
        }
    }

    /// Begins the array as another one of the same hidden layer; `map`, a linear map, makes this array's shape of that
    /// one's; it takes and gives `[shape.., columns]`.
    pub fn begin_as(&self, other: &Self, map: impl Fn(&Tensor) -> Tensor) {
        let _guard = tch::no_grad_guard();
        for (mine, others) in [(&self.hidden.weight, &other.hidden.weight), (&self.hidden.bias, &other.hidden.bias)] {
            mine.shallow_clone().copy_(others);
        }
        self.set_columns(&map(&other.columns()));
    }

    /// Applies a linear map to the array by applying it to the output layer; `map` takes and gives
    /// `[shape.., columns]`.
    pub fn map(&self, map: impl Fn(&Tensor) -> Tensor) {
        let _guard = tch::no_grad_guard();
        self.set_columns(&map(&self.columns()));
    }

    /// The output layer's kernel and bias, `[shape.., columns]`.
    fn columns(&self) -> Tensor {
        let Dense { weight, bias, .. } = &self.output;
        let shape: Vec<i64> = self.shape.iter().copied().chain([-1]).collect();
        Tensor::cat(&[weight, &bias.unsqueeze(1)], 1).reshape(shape)
    }

    fn set_columns(&self, columns: &Tensor) {
        let Dense { weight, bias, .. } = &self.output;
        let (values, inputs) = weight.size2().expect("a kernel [values, inputs]");
        let flat = columns.reshape([values, inputs + 1]);
        weight.shallow_clone().copy_(&flat.narrow(1, 0, inputs));
        bias.shallow_clone().copy_(&flat.select(1, inputs));
    }
}
