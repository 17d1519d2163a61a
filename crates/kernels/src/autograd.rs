//! Functions with a gradient of their own in libtorch's autograd graph, which tch has no call for (`autograd.cpp`).

use std::ffi::{c_char, c_void};
use std::mem;
use std::panic::{AssertUnwindSafe, catch_unwind};

use tch::Tensor;
use torch_sys::C_tensor;

use super::panics;

/// Gradients of the inputs, in their order, from that of the output.
type Backward = Box<dyn FnMut(&Tensor) -> Vec<Tensor> + Send>;

#[repr(C)]
struct Calls {
    backward: extern "C" fn(*mut c_void, *mut C_tensor, *mut *mut C_tensor, *mut c_char) -> bool,
    release: extern "C" fn(*mut c_void),
}

/// Bytes of the text that says why a gradient failed, with the 0 at its end (`REASON` in `autograd.cpp`).
const REASON: usize = 256;

/// What a function keeps until its gradient is asked for.
struct SavedState {
    backward: Backward,
    inputs: usize,
}

unsafe extern "C" {
    fn paig_records(inputs: *const *const C_tensor, count: usize) -> bool;
    fn paig_forget_gradient(variable: *const C_tensor);
    fn paig_attach(
        output: *mut C_tensor,
        inputs: *const *const C_tensor,
        count: usize,
        state: *mut c_void,
        calls: Calls,
    ) -> bool;
}

/// Whether autograd wants the gradient of a function of these tensors.
pub fn records(inputs: &[&Tensor]) -> bool {
    let inputs: Vec<_> = inputs.iter().map(|input| input.as_ptr()).collect();
    // SAFETY: the tensors live as long as the call.
    unsafe { paig_records(inputs.as_ptr(), inputs.len()) }
}

/// Takes a variable's gradient away: the next one is not added to anything.
pub fn forget_gradient(variable: &Tensor) {
    // SAFETY: the tensor lives as long as the call.
    unsafe { paig_forget_gradient(variable.as_ptr()) };
}

/// Tells autograd that `output`, which was computed without it, is a function of `inputs`. `backward` takes the gradient
/// of the output to those of the inputs, one for each, or an undefined tensor where nobody wants it; it is called from any
/// thread, and once unless autograd is told to keep its graph.
///
/// # Panics
/// An output of whole numbers.
pub fn attach(
    mut output: Tensor,
    inputs: &[&Tensor],
    backward: impl FnMut(&Tensor) -> Vec<Tensor> + Send + 'static,
) -> Tensor {
    let raw: Vec<_> = inputs.iter().map(|input| input.as_ptr()).collect();
    let state = Box::into_raw(Box::new(SavedState { backward: Box::new(backward), inputs: inputs.len() }));
    let calls = Calls { backward: call_backward, release };
    // SAFETY: the tensors live as long as the call, and the state until `release`, which is called once.
    let done = unsafe { paig_attach(output.as_mut_ptr(), raw.as_ptr(), raw.len(), state.cast(), calls) };
    assert!(done, "a tensor of floats can be given a history");
    output
}

extern "C" fn call_backward(
    state: *mut c_void,
    gradient: *mut C_tensor,
    results: *mut *mut C_tensor,
    reason: *mut c_char,
) -> bool {
    // A panic must not go through C++.
    let call = AssertUnwindSafe(|| {
        // SAFETY: `state` is the one that was attached, and not released yet; one call at a time, under the node's lock.
        let state = unsafe { &mut *state.cast::<SavedState>() };
        // SAFETY: a tensor of C++ that outlives the call.
        let gradient = unsafe { Tensor::clone_from_ptr(gradient) };
        let gradients = (state.backward)(&gradient);
        assert_eq!(gradients.len(), state.inputs, "one gradient for each input");
        for (i, mut gradient) in gradients.into_iter().enumerate() {
            // SAFETY: there is a place for each input; C++ takes the tensor over.
            unsafe { *results.add(i) = gradient.as_mut_ptr() };
            mem::forget(gradient);
        }
    });
    let Err(panic) = catch_unwind(call) else { return true };
    let said = panics::first_line(panic.as_ref()).as_bytes();
    let length = said.len().min(REASON - 1);
    // SAFETY: C++ gives room for `REASON` bytes, which it has set to 0.
    unsafe { said.as_ptr().cast::<c_char>().copy_to_nonoverlapping(reason, length) };
    false
}

extern "C" fn release(state: *mut c_void) {
    // SAFETY: made by `Box::into_raw` in `attach`, and released once.
    let state = unsafe { Box::from_raw(state.cast::<SavedState>()) };
    let _ = catch_unwind(AssertUnwindSafe(|| drop(state)));
}
