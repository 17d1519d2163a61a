//! Tensors and NumPy arrays. Frames are `[.., S, S, channels]` in Python, `[.., channels, S, S]` in the model.

use anyhow::{Result, ensure};
use ndarray::ArrayD;
use numpy::{PyArrayDyn, PyReadonlyArrayDyn, ToPyArray};
use pyo3::prelude::*;
use tch::{Device, Kind, Tensor};

/// An array that a Python call gives or gets.
pub type Floats = ArrayD<f32>;

/// A copy of an array of Python, row-major.
pub fn taken(array: &PyReadonlyArrayDyn<f32>) -> Floats {
    array.as_array().as_standard_layout().into_owned()
}

/// The array as one of NumPy, without a copy.
pub fn given(py: Python, array: Floats) -> Bound<PyArrayDyn<f32>> {
    PyArrayDyn::from_owned_array(py, array)
}

/// The bytes as an array of NumPy.
pub fn given_bytes<'py>(py: Python<'py>, array: &ndarray::Array5<u8>) -> Bound<'py, PyAny> {
    array.to_pyarray(py).into_any()
}

pub fn tensor(array: &Floats, device: Device) -> Tensor {
    let shape: Vec<i64> = array.shape().iter().map(|&length| length as i64).collect();
    Tensor::from_slice(array.as_slice().expect("taken arrays are row-major")).reshape(shape).to_device(device)
}

/// # Errors
/// A tensor that libtorch cannot copy to the processor.
pub fn array(tensor: &Tensor) -> Result<Floats> {
    let here = tensor.to_device(Device::Cpu).to_kind(Kind::Float).contiguous();
    let shape: Vec<usize> = here.size().into_iter().map(|length| length as usize).collect();
    Ok(Floats::from_shape_vec(shape, Vec::try_from(here.flatten(0, -1))?)?)
}

/// Frames `[clips, time, S, S, channels]` as the model has them.
///
/// # Errors
/// Frames of another size.
pub fn frames(array: &Floats, [side, channels]: [usize; 2], device: Device) -> Result<Tensor> {
    ensure!(
        array.ndim() == 5 && array.shape()[2..] == [side, side, channels],
        "frames of shape {:?}: expected [clips, time, {side}, {side}, {channels}]",
        array.shape()
    );
    Ok(tensor(array, device).permute([0, 1, 4, 2, 3]))
}

/// Frames `[.., channels, S, S]` as Python has them.
pub fn channels_last(frames: &Tensor) -> Tensor {
    frames.movedim_int(-3, -1)
}

/// Coordinates `[clips, time, objects, coordinates]` as the model has them, `[clips, time, coordinates * objects]`.
///
/// # Errors
/// Another number of objects or coordinates.
pub fn flat(array: &Floats, [objects, coordinates]: [usize; 2], device: Device) -> Result<Tensor> {
    ensure!(
        array.ndim() == 4 && array.shape()[2..] == [objects, coordinates],
        "positions of shape {:?}: expected [clips, time, {objects}, {coordinates}]",
        array.shape()
    );
    Ok(tensor(array, device).flatten(2, 3))
}
