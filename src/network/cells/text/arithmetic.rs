//! The operations on tensors.
//!
//! The last axis of a tensor holds a scalar (1) or a vector (2); the axes before it, as far as they are there, are batch,
//! object and other object. What has fewer axes, down to a parameter that has none, is the same along those it lacks.

use tch::{Device, Kind, Tensor};

use super::operation::{Binary, Unary};

/// A number that stands in the text, or what was computed.
#[derive(Debug)]
pub(super) enum Operand {
    Number(f64),
    Tensor(Tensor),
}

impl Operand {
    /// As a tensor, a number as one of `[1]`.
    pub(super) fn tensor(&self, options: (Kind, Device)) -> Tensor {
        match self {
            Operand::Number(number) => Tensor::full([1], *number, options),
            Operand::Tensor(tensor) => tensor.shallow_clone(),
        }
    }
}

/// One operation; numbers become tensors of these options.
pub(super) fn unary(operation: Unary, of: &Operand, options: (Kind, Device)) -> Tensor {
    let x = of.tensor(options);
    match operation {
        Unary::Negative => -x,
        Unary::Part(axis) => part(&x, axis),
        // Its gradient where the vector vanishes is 0; that of a square root would be none.
        Unary::Norm => x.norm_scalaropt_dim(2, [-1i64].as_slice(), true),
        Unary::Perp => Tensor::cat(&[-part(&x, 1), part(&x, 0)], -1),
        Unary::Sqrt => x.sqrt(),
        Unary::Exp => x.exp(),
        Unary::Ln => x.log(),
        Unary::Sin => x.sin(),
        Unary::Cos => x.cos(),
        Unary::Tan => x.tan(),
        Unary::Tanh => x.tanh(),
        Unary::Abs => x.abs(),
        Unary::Sign => x.sign(),
        Unary::Square => x.square(),
        Unary::ForOthers => x.unsqueeze(2),
        Unary::OverOthers if x.size()[2] == 1 => x.squeeze_dim(2),
        Unary::OverOthers => x.sum_dim_intlist([2i64].as_slice(), false, None),
    }
}

/// One operation; numbers become tensors of these options where they must.
pub(super) fn binary(operation: Binary, a: &Operand, b: &Operand, options: (Kind, Device)) -> Tensor {
    use Operand::{Number as N, Tensor as T};
    match (operation, a, b) {
        (Binary::Plus, T(x), N(number)) | (Binary::Plus, N(number), T(x)) => x + *number,
        (Binary::Minus, T(x), N(number)) => x - *number,
        (Binary::Minus, N(number), T(x)) => *number - x,
        (Binary::Times, T(x), N(number)) | (Binary::Times, N(number), T(x)) => x * *number,
        (Binary::Over, T(x), N(number)) => x / *number,
        (Binary::Over, N(number), T(x)) => *number / x,
        (Binary::Power, T(x), N(number)) => x.pow_tensor_scalar(*number),
        (Binary::Min, T(x), N(number)) | (Binary::Min, N(number), T(x)) => x.clamp_max(*number),
        (Binary::Max, T(x), N(number)) | (Binary::Max, N(number), T(x)) => x.clamp_min(*number),
        _ => of_tensors(operation, &a.tensor(options), &b.tensor(options)),
    }
}

/// The dot product of vectors with themselves.
pub(super) fn squared_norm(x: &Tensor) -> Tensor {
    x.square().sum_dim_intlist([-1i64].as_slice(), true, None)
}

fn of_tensors(operation: Binary, a: &Tensor, b: &Tensor) -> Tensor {
    match operation {
        Binary::Plus => a + b,
        Binary::Minus => a - b,
        Binary::Times => a * b,
        Binary::Over => a / b,
        Binary::Power => a.pow(b),
        Binary::Dot => (a * b).sum_dim_intlist([-1i64].as_slice(), true, None),
        Binary::Cross => part(a, 0) * part(b, 1) - part(a, 1) * part(b, 0),
        Binary::Vec if a.dim() > 0 && a.size() == b.size() => Tensor::cat(&[a, b], -1),
        Binary::Vec => Tensor::cat(&Tensor::broadcast_tensors(&[with_axis(a), with_axis(b)]), -1),
        Binary::Atan2 => a.atan2(b),
        Binary::Min => a.minimum(b),
        Binary::Max => a.maximum(b),
    }
}

/// A parameter is a scalar without axes.
fn with_axis(x: &Tensor) -> Tensor {
    if x.dim() == 0 { x.unsqueeze(0) } else { x.shallow_clone() }
}

fn part(x: &Tensor, axis: u8) -> Tensor {
    x.narrow(-1, i64::from(axis), 1)
}
