//! The memory of tensors as slices.

use std::ops::Range;

use tch::{Device, Kind, Tensor};

/// A copy of a tensor's numbers.
pub fn numbers(tensor: &Tensor) -> Vec<f32> {
    floats(&tensor.detach().contiguous()).to_vec()
}

/// The addresses from a tensor's first element to the end of its last; none of an empty tensor.
pub fn address_span(tensor: &Tensor) -> Range<usize> {
    let first = tensor.data_ptr() as usize;
    if tensor.numel() == 0 {
        return first..first;
    }
    let last: i64 = tensor.size().iter().zip(tensor.stride()).map(|(size, stride)| (size - 1) * stride).sum();
    first..first + (last as usize + 1) * tensor.kind().elt_size_in_bytes()
}

/// The memory of a tensor.
///
/// # Panics
/// A tensor whose memory is not a list of floats.
pub fn floats(tensor: &Tensor) -> &[f32] {
    check(tensor);
    match tensor.numel() {
        // It has no address.
        0 => &[],
        // SAFETY: as many floats as the tensor has, side by side, which live as long as it does.
        count => unsafe { std::slice::from_raw_parts(tensor.data_ptr().cast(), count) },
    }
}

/// The memory of a tensor, which no other slice may be of meanwhile: it was made just now, or is compared with the others.
///
/// # Panics
/// As [`floats`].
pub fn floats_mut(tensor: &mut Tensor) -> &mut [f32] {
    check(tensor);
    match tensor.numel() {
        0 => &mut [],
        // SAFETY: as above; the tensor is borrowed alone, and its memory is in no other slice.
        count => unsafe { std::slice::from_raw_parts_mut(tensor.data_ptr().cast(), count) },
    }
}

fn check(tensor: &Tensor) {
    assert!(tensor.kind() == Kind::Float && tensor.device() == Device::Cpu && tensor.is_contiguous());
}
