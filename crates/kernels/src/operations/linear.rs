//! A dense layer's affine map of many rows.

use tch::{Device, Kind, Tensor};

use crate::autograd;
use crate::backend::{Backend, Kernels};
use crate::dense::{self, Factors};
use crate::simd::Instructions;
use crate::tensors::{floats, floats_mut};

/// `x weight^T + bias`, differentiable by all three: `[rows, inputs]`, `[outputs, inputs]` and `[outputs]` to
/// `[rows, outputs]`. On a GPU libtorch computes it.
pub fn linear(kernels: Kernels, x: &Tensor, weight: &Tensor, bias: &Tensor) -> Tensor {
    match kernels.backend(&[x, weight]) {
        Backend::Cpu(instructions) => on_cpu(instructions, x, weight, bias),
        Backend::Gpu | Backend::Libtorch => by_libtorch(x, weight, bias),
    }
}

/// The same twice: once differentiable by all three, once by weight and bias alone. The kernel computes the products once.
pub fn linear_twice(kernels: Kernels, x: &Tensor, weight: &Tensor, bias: &Tensor) -> [Tensor; 2] {
    match kernels.backend(&[x, weight]) {
        Backend::Cpu(instructions) => {
            let by_layer = on_cpu(instructions, &x.detach(), weight, bias);
            [with_gradient_path(instructions, &by_layer, x, weight), by_layer]
        }
        Backend::Gpu | Backend::Libtorch => [by_libtorch(x, weight, bias), by_libtorch(&x.detach(), weight, bias)],
    }
}

fn by_libtorch(x: &Tensor, weight: &Tensor, bias: &Tensor) -> Tensor {
    x.linear(weight, Some(bias))
}

fn on_cpu(instructions: Instructions, x: &Tensor, weight: &Tensor, bias: &Tensor) -> Tensor {
    let (inputs, x_requires_grad) = ([x, weight, bias], x.requires_grad());
    let values = [x, weight].map(|tensor| tensor.detach().contiguous());
    let (rows, terms) = values[0].size2().expect("rows of inputs");
    let mut result = Tensor::empty([rows, bias.size()[0]], (Kind::Float, Device::Cpu));
    let [x, weight] = values.each_ref().map(floats);
    dense::by_rows(instructions, terms as usize, x, weight, floats_mut(&mut result));
    let result = result.g_add_(&bias.detach());
    if !autograd::records(&inputs) {
        return result;
    }
    autograd::attach(result, &inputs, move |gradient| {
        let gradient = gradient.contiguous();
        let [x, weight] = values.each_ref();
        let by_x = if x_requires_grad { combined(instructions, factors(&gradient), weight) } else { Tensor::new() };
        let by_weight = combined(instructions, factors(&gradient).transposed(), x);
        vec![by_x, by_weight, gradient.sum_dim_intlist([0i64].as_slice(), false, None)]
    })
}

/// A copy of `linear` (`[rows, outputs]`), computed of a constant `x`, with a gradient path to `x` (`[rows, inputs]`) as well,
/// as if it were `x weight^T`.
fn with_gradient_path(instructions: Instructions, linear: &Tensor, x: &Tensor, weight: &Tensor) -> Tensor {
    let copy = linear.detach().copy();
    let inputs = [linear, x];
    if !autograd::records(&inputs) {
        return copy;
    }
    let weight = weight.detach().contiguous();
    autograd::attach(copy, &inputs, move |gradient| {
        let gradient = gradient.contiguous();
        let by_x = combined(instructions, factors(&gradient), &weight);
        vec![gradient, by_x]
    })
}

/// A tensor `[rows, terms]`, contiguous in memory.
fn factors(tensor: &Tensor) -> Factors<'_> {
    Factors::new(floats(tensor), tensor.size()[1] as usize)
}

/// The product with a matrix `[terms, columns]`, contiguous in memory.
fn combined(instructions: Instructions, factors: Factors, matrix: &Tensor) -> Tensor {
    let mut product = Tensor::empty([factors.rows() as i64, matrix.size()[1]], (Kind::Float, Device::Cpu));
    dense::combined(instructions, factors, floats(matrix), floats_mut(&mut product));
    product
}
