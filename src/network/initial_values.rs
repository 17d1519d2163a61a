//! Initial values: Glorot-uniform kernels and zero biases everywhere, as TensorFlow's layers have them.
//!
//! Every variable draws from a generator of its own, seeded by the run's seed and the variable's name, so values
//! depend neither on the order of construction nor on libtorch's global generator.

use rand::Rng;
use tch::nn::VarStore;
use tch::{Kind, Tensor};

use crate::support::random::named_generator;

/// Fills every `weight` of the store with `U(-limit, limit)`, `limit = sqrt(6 / (fan_in + fan_out))`.
pub fn glorot_uniform(variables: &VarStore, seed: u64) {
    let _guard = tch::no_grad_guard();
    for (name, mut variable) in variables.variables() {
        if name.ends_with(".weight") {
            variable.copy_(&glorot_tensor(&variable.size(), seed, &name).to_kind(variable.kind()));
        }
    }
}

/// One kernel's initial values, `[out, in, ..]`, as float32 on the CPU.
pub fn glorot_tensor(shape: &[i64], seed: u64, name: &str) -> Tensor {
    let receptive: i64 = shape[2..].iter().product();
    let limit = (6.0 / ((shape[0] + shape[1]) * receptive) as f64).sqrt();
    let mut random = named_generator(seed, name);
    let count: i64 = shape.iter().product();
    let values: Vec<f32> = (0..count).map(|_| random.random_range(-limit..limit) as f32).collect();
    Tensor::from_slice(&values).reshape(shape).to_kind(Kind::Float)
}
