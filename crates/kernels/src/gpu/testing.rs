//! What the tests of the kernels have in common.

use tch::{Device, Kind, Tensor};

/// Where kernels can be tested: on a GPU, or in a program that was built without CUDA's compiler on the processor. Nowhere where
/// there is a compiler and no GPU.
pub fn test_device() -> Option<Device> {
    unsafe extern "C" {
        fn paig_gpu_compiled() -> bool;
    }
    // SAFETY: tells how this program was built.
    match unsafe { paig_gpu_compiled() } {
        false => Some(Device::Cpu),
        true => tch::Cuda::is_available().then_some(Device::Cuda(0)),
    }
}

/// Numbers between -1 and 1 in the main memory, always the same.
pub fn scattered(size: &[i64], step: f64) -> Tensor {
    let count: i64 = size.iter().product();
    (Tensor::arange(count, (Kind::Float, Device::Cpu)) * step).sin().reshape(size)
}

/// That two tensors differ by no more than 1e-5 of the second one's largest number: rounding of float32 sums.
pub fn assert_close(own: &Tensor, other: &Tensor) {
    let scale = other.abs().max().double_value(&[]);
    let error = (own - other).abs().max().double_value(&[]);
    assert!(error <= 1e-5 * scale, "{error:e} of {scale}");
}
