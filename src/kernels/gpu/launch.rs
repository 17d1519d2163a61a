//! Where the kernels for GPUs are launched.

use std::ffi::{CStr, c_char, c_int, c_void};

use tch::{Device, Kind, Tensor};

unsafe extern "C" {
    fn paig_gpu_suits(device: c_int) -> bool;
    fn paig_gpu_launch_failure() -> *const c_char;
    fn paig_cuda_current_stream(device: c_int) -> *mut c_void;
}

/// Whether the kernels can compute with these tensors: float32 on a GPU that they were compiled for.
pub fn serve(tensors: &[&Tensor]) -> bool {
    tensors.iter().all(|tensor| match tensor.device() {
        // SAFETY: asks what a device is.
        Device::Cuda(index) => tensor.kind() == Kind::Float && unsafe { paig_gpu_suits(index as c_int) },
        _ => false,
    })
}

/// Launches kernels on the stream in which this thread works on a tensor's device.
///
/// # Panics
/// A launch that fails.
pub fn on_stream(tensor: &Tensor, launch: impl FnOnce(*mut c_void) -> bool) {
    let stream = match tensor.device() {
        // SAFETY: asks for this thread's stream.
        Device::Cuda(index) => unsafe { paig_cuda_current_stream(index as c_int) },
        _ => std::ptr::null_mut(),
    };
    if !launch(stream) {
        // SAFETY: a string that ends, or null.
        let reason = unsafe { paig_gpu_launch_failure().as_ref().map(|reason| CStr::from_ptr(reason)) };
        panic!("a kernel could not be launched on the GPU: {}", reason.unwrap_or_default().to_string_lossy());
    }
}

/// A tensor of such numbers where another is, to be written.
pub fn empty_beside(tensor: &Tensor, size: &[i64]) -> Tensor {
    Tensor::empty(size, (Kind::Float, tensor.device()))
}

/// The memory of a tensor.
///
/// # Panics
/// A tensor whose memory is not a list of floats.
pub fn floats(tensor: &Tensor) -> *const f32 {
    assert!(tensor.kind() == Kind::Float && tensor.is_contiguous(), "floats side by side");
    tensor.data_ptr().cast_const().cast()
}

/// The memory of a tensor, to be written.
///
/// # Panics
/// As [`floats`].
pub fn floats_mut(tensor: &mut Tensor) -> *mut f32 {
    floats(tensor).cast_mut()
}

/// Where kernels can be tested: on a GPU, or in a program that was built without CUDA's compiler on the processor. Nowhere where
/// there is a compiler and no GPU.
#[cfg(test)]
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
