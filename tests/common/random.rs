//! Random tensors that are the same in every run. libtorch's own generator will not do: all tests of a process draw from it at
//! the same time.

use paig::support::random::named_generator;
use rand_chacha::ChaCha8Rng;
use tch::Tensor;
use tch::kind::Element;

/// Numbers of this shape for one purpose of a test, each drawn by `number`.
pub fn numbers<T: Element>(seed: u64, purpose: &str, shape: &[i64], number: impl Fn(&mut ChaCha8Rng) -> T) -> Tensor {
    let mut random = named_generator(seed, purpose);
    let numbers: Vec<T> = (0..shape.iter().product::<i64>()).map(|_| number(&mut random)).collect();
    Tensor::from_slice(&numbers).reshape(shape)
}
