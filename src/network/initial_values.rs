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
pub(crate) fn glorot_tensor(shape: &[i64], seed: u64, name: &str) -> Tensor {
    let receptive: i64 = shape[2..].iter().product();
    let limit = (6.0 / ((shape[0] + shape[1]) * receptive) as f64).sqrt();
    let mut random = named_generator(seed, name);
    let count: i64 = shape.iter().product();
    let values: Vec<f32> = (0..count).map(|_| random.random_range(-limit..limit) as f32).collect();
    Tensor::from_slice(&values).reshape(shape).to_kind(Kind::Float)
}

#[cfg(test)]
mod tests {
    use tch::Device;

    use super::glorot_tensor;
    use crate::network::physics_models::{ModelOptions, PhysicsNet};
    use crate::tasks;

    /// TensorFlow's: uniform up to the root of 6 / (fan in + fan out), a kernel's pixels counted in both. The largest of some
    /// hundred numbers lies within a twentieth of the limit, their variance within a tenth of a third of its square.
    #[test]
    fn kernels_are_glorot_uniform() {
        for (shape, limit) in [
            (&[8, 3, 3, 3][..], (6.0 / (27.0 + 72.0f64)).sqrt()),
            (&[2, 8, 1, 1], (6.0 / (8.0 + 2.0f64)).sqrt()),
            (&[200, 3072], (6.0 / (3072.0 + 200.0f64)).sqrt()),
        ] {
            let values: Vec<_> = (0..40).map(|seed| glorot_tensor(shape, seed, "weight")).collect();
            let values = tch::Tensor::stack(&values, 0);
            let largest = values.abs().max().double_value(&[]) / limit;
            let variance = values.var(true).double_value(&[]) / (limit * limit / 3.0);
            assert!((0.95..=1.0).contains(&largest), "{shape:?}: {largest}");
            assert!((0.9..=1.1).contains(&variance), "{shape:?}: {variance}");
            assert!(values.mean(tch::Kind::Float).double_value(&[]).abs() < 0.1 * limit, "{shape:?}");
        }
    }

    /// All but the kernels, and but for the decoder's width of a mask's edge and its templates, which the original begins
    /// elsewhere.
    #[test]
    fn biases_and_logarithms_of_parameters_begin_at_zero() {
        let system = tasks::find("spring_color").unwrap().system;
        let model = PhysicsNet::new(&system, &ModelOptions::original(), Device::Cpu, 3).unwrap();
        let variables = model.named_variables();
        let zero = |part: &str| {
            let chosen: Vec<_> = variables.iter().filter(|(name, _)| name.ends_with(part)).collect();
            assert!(!chosen.is_empty(), "no variable ends in {part}");
            for (name, variable) in chosen.into_iter().filter(|(name, _)| !name.starts_with("decoder.")) {
                assert_eq!(variable.abs().max().double_value(&[]), 0.0, "{name}");
            }
        };
        [".bias", ".log_k", ".log_l"].into_iter().for_each(zero);
    }
}
