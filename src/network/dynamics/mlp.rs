//! A multilayer perceptron on the last L frames, all objects together: `change of p = mlp(x_{t-L+1}, .., x_t)`.

use tch::Tensor;

use super::{Features, Predictor, keep_last};
use crate::network::blocks::{Activation, Layers, Mlp};

/// Units of a hidden layer.
const HIDDEN: usize = 195;

#[derive(Debug)]
pub(super) struct StackedMlp {
    mlp: Mlp,
    frames: usize,
}

impl StackedMlp {
    pub(super) fn new(layers: &mut Layers, features: &Features) -> Self {
        let widths = [features.frames * features.in_frame(), HIDDEN, HIDDEN, features.positions()];
        StackedMlp { mlp: Mlp::new(layers, &widths, Activation::Relu, Activation::None), frames: features.frames }
    }
}

impl Predictor for StackedMlp {
    fn see(&self, memory: &mut Vec<Tensor>, frame: &Tensor) {
        keep_last(memory, frame, self.frames);
    }

    fn change(&self, memory: &[Tensor]) -> Tensor {
        self.mlp.forward(&Tensor::cat(memory, 1))
    }
}
