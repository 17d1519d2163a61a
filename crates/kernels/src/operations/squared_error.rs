//! The sum of squared differences.

use tch::{Device, Kind, Tensor};

use crate::autograd;
use crate::backend::{Backend, Kernels};
use crate::gpu;
use crate::simd::Instructions;
use crate::squared_error::{self as kernel, Rows};
use crate::tensors::floats_mut;

/// `sum (a - b)^2`, a scalar, differentiable by `a`; the gradient by `b` is libtorch's alone. Both `[batch, time, ..]`, the
/// frames side by side in memory or not.
pub fn squared_error(kernels: Kernels, a: &Tensor, b: &Tensor) -> Tensor {
    match kernels.backend(&[a, b]) {
        _ if b.requires_grad() => by_libtorch(a, b),
        Backend::Cpu(instructions) => on_cpu(instructions, a, b),
        Backend::Gpu => gpu::squared_error(a, b),
        Backend::Libtorch => by_libtorch(a, b),
    }
}

fn by_libtorch(a: &Tensor, b: &Tensor) -> Tensor {
    (a - b).square().sum(a.kind())
}

fn on_cpu(instructions: Instructions, a: &Tensor, b: &Tensor) -> Tensor {
    assert_eq!(a.size(), b.size());
    let values = [a, b].map(|tensor| framewise(&tensor.detach()));
    let [first, second] = values.each_ref().map(rows);
    let sum = Tensor::from(kernel::squared_error(instructions, &first, &second) as f32);
    if !autograd::records(&[a]) {
        return sum;
    }
    let size = a.size();
    autograd::attach(sum, &[a], move |gradient| {
        let [first, second] = values.each_ref().map(rows);
        let mut difference = Tensor::empty(&size, (Kind::Float, Device::Cpu));
        let factor = 2.0 * gradient.double_value(&[]) as f32;
        kernel::difference(&first, &second, factor, floats_mut(&mut difference));
        vec![difference]
    })
}

/// The tensor itself where what follows the first two axes stands side by side in memory, else a copy.
fn framewise(tensor: &Tensor) -> Tensor {
    let side_by_side = tensor.numel() == 0 || tensor.select(0, 0).select(0, 0).is_contiguous();
    if side_by_side { tensor.shallow_clone() } else { tensor.contiguous() }
}

/// The frames of a tensor `[batch, time, ..]` whose frames stand side by side.
fn rows(tensor: &Tensor) -> Rows<'_> {
    let (size, stride) = (tensor.size(), tensor.stride());
    let width = size[2..].iter().product::<i64>() as usize;
    assert!(tensor.kind() == Kind::Float && tensor.device() == Device::Cpu);
    if tensor.numel() == 0 {
        return Rows { data: &[], starts: Vec::new(), width };
    }
    let starts = (0..size[0]).flat_map(|clip| (0..size[1]).map(move |time| (clip, time)));
    let starts: Vec<_> = starts.map(|(clip, time)| (clip * stride[0] + time * stride[1]) as usize).collect();
    let floats = starts.iter().max().map_or(0, |last| last + width);
    // SAFETY: the memory from the first element of the first frame to the last one of the last.
    let data = unsafe { std::slice::from_raw_parts(tensor.data_ptr().cast(), floats) };
    Rows { data, starts, width }
}
