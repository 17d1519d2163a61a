//! Where the kernels for GPUs are launched.

use std::ffi::{CStr, c_char, c_int, c_void};

use tch::{Device, Kind, Tensor};

unsafe extern "C" {
    fn paig_gpu_suits(device: c_int) -> bool;
    fn paig_gpu_launch_failure() -> *const c_char;
    fn paig_cuda_current_stream(device: c_int, stream: *mut *mut c_void) -> bool;
    fn paig_cuda_failure() -> *const c_char;
}

/// Whether the kernels were compiled for this GPU.
pub fn suits(index: usize) -> bool {
    // SAFETY: asks what a device is.
    unsafe { paig_gpu_suits(index as c_int) }
}

/// Whether the kernels can compute with these tensors: float32 on a GPU that they were compiled for.
pub fn supports(tensors: &[&Tensor]) -> bool {
    tensors.iter().all(|tensor| match tensor.device() {
        Device::Cuda(index) => tensor.kind() == Kind::Float && suits(index),
        _ => false,
    })
}

/// Launches kernels on the stream in which this thread works on a tensor's device.
///
/// # Panics
/// A launch that fails.
pub fn on_stream(tensor: &Tensor, launch: impl FnOnce(*mut c_void) -> bool) {
    let mut stream = std::ptr::null_mut();
    let on_gpu = matches!(tensor.device(), Device::Cuda(_));
    // SAFETY: asks for this thread's stream.
    let (done, reason): (bool, unsafe extern "C" fn() -> *const c_char) =
        match !on_gpu || unsafe { paig_cuda_current_stream(index_of(tensor), &raw mut stream) } {
            true => (launch(stream), paig_gpu_launch_failure),
            false => (false, paig_cuda_failure),
        };
    if !done {
        // SAFETY: a string that ends, or null.
        let reason = unsafe { reason().as_ref().map(|reason| CStr::from_ptr(reason)) };
        panic!("a kernel could not be launched on the GPU: {}", reason.unwrap_or_default().to_string_lossy());
    }
}

/// The number of a tensor's GPU; 0 of what is on none.
pub fn index_of(tensor: &Tensor) -> c_int {
    match tensor.device() {
        Device::Cuda(index) => index as c_int,
        _ => 0,
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
