//! Linear autoregression on the last L frames: `change of p = W [x_{t-L+1}, .., x_t] + b`.

use tch::Tensor;

use super::{Features, Predictor, keep_last};
use crate::network::blocks::{Activation, Dense, Layers};

#[derive(Debug)]
pub(super) struct Linear {
    dense: Dense,
    frames: usize,
}

impl Linear {
    pub(super) fn new(layers: &mut Layers, features: &Features) -> Self {
        let inputs = features.frames * features.in_frame();
        Linear { dense: layers.dense(inputs, features.positions(), Activation::None), frames: features.frames }
    }
}

impl Predictor for Linear {
    fn see(&self, memory: &mut Vec<Tensor>, frame: &Tensor) {
        keep_last(memory, frame, self.frames);
    }

    fn change(&self, memory: &[Tensor]) -> Tensor {
        self.dense.forward(&Tensor::cat(memory, 1))
    }
}
