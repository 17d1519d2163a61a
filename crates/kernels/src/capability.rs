//! The CPU capability of libtorch, which tch has no call for (`capability.cpp`).

use std::ffi::{CStr, c_char};

/// Bytes of a capability's name, with the 0 at its end.
const NAME: usize = 32;

unsafe extern "C" {
    fn paig_cpu_capability(text: *mut c_char, size: usize);
}

/// The instructions of libtorch's own CPU kernels (`DEFAULT`, `AVX2`, `AVX512`): the processor's, or those that
/// `ATEN_CPU_CAPABILITY` names.
pub fn libtorch_capability() -> String {
    let mut name = [0; NAME];
    // SAFETY: as many bytes as the call is told; it ends them with a 0.
    let name = unsafe {
        paig_cpu_capability(name.as_mut_ptr(), name.len());
        CStr::from_ptr(name.as_ptr())
    };
    name.to_string_lossy().into_owned()
}
