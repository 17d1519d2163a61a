//! Initial values: Glorot-uniform kernels and zero biases everywhere, as TensorFlow's layers have them.
//!
//! Every variable draws from a generator of its own, seeded by the run's seed and the variable's name, so values
//! depend neither on the order of construction nor on libtorch's global generator.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tch::nn::VarStore;
use tch::{Kind, Tensor};

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

/// 64-bit FNV-1a: a fixed, documented hash, so that seeds and checksums mean the same on every platform and version.
pub(crate) fn fnv1a<'a>(bytes: impl IntoIterator<Item = &'a u8>) -> u64 {
    let more = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3);
    bytes.into_iter().fold(0xcbf2_9ce4_8422_2325, more)
}

/// A generator for one purpose of one run: equal for equal `(seed, purpose)`, unrelated for others.
pub fn named_generator(seed: u64, purpose: &str) -> ChaCha8Rng {
    let mut key = [0u8; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    key[8..16].copy_from_slice(&fnv1a(purpose.as_bytes()).to_le_bytes());
    ChaCha8Rng::from_seed(key)
}
