//! A step of a long short-term memory after the affine map of its gates.

use tch::{Device, Kind, Tensor};

use crate::autograd;
use crate::backend::{Backend, Kernels};
use crate::lstm_cell as kernel;
use crate::simd::Instructions;
use crate::tensors::{floats, floats_mut};

/// `[h', c']`, each `[batch, ..]`, from the gates i, f, g, o `[batch, 4 units, ..]` before their activations and from c;
/// `forget_bias` is added to f. Differentiable by both. On a GPU libtorch computes it.
pub fn lstm_cell(kernels: Kernels, gates: &Tensor, c: &Tensor, forget_bias: f64) -> [Tensor; 2] {
    match kernels.backend(&[gates, c]) {
        Backend::Cpu(instructions) => on_cpu(instructions, gates, c, forget_bias as f32),
        Backend::Gpu | Backend::Libtorch => by_libtorch(gates, c, forget_bias),
    }
}

fn by_libtorch(gates: &Tensor, c: &Tensor, forget_bias: f64) -> [Tensor; 2] {
    let gates = gates.chunk(4, 1);
    let c = (&gates[1] + forget_bias).sigmoid() * c + gates[0].sigmoid() * gates[2].tanh();
    [gates[3].sigmoid() * c.tanh(), c]
}

fn on_cpu(instructions: Instructions, gates: &Tensor, c: &Tensor, forget_bias: f32) -> [Tensor; 2] {
    let inputs = [gates, c];
    let sizes = inputs.map(|input| input.size());
    let [seen, before] = inputs.map(|input| input.detach().contiguous());
    let units = before.numel() / sizes[1][0] as usize;
    let both: Vec<i64> = [2].iter().chain(&sizes[1]).copied().collect();
    let mut after = Tensor::empty(&both, (Kind::Float, Device::Cpu));
    let [h, c] = halves_mut(&mut after);
    let pass = kernel::forward(instructions, units, floats(&seen), floats(&before), forget_bias, [h, c]);
    if autograd::records(&inputs) {
        after = autograd::attach(after, &inputs, move |gradient| {
            let mut by = sizes.each_ref().map(|size| Tensor::empty(size, (Kind::Float, Device::Cpu)));
            let gradient = gradient.contiguous();
            let pull = floats(&gradient).split_at(before.numel());
            let [by_gates, by_before] = by.each_mut().map(floats_mut);
            pass.backward(instructions, units, floats(&before), pull.into(), [by_gates, by_before]);
            by.into()
        });
    }
    after.unbind(0).try_into().expect("h and c")
}

fn halves_mut(tensor: &mut Tensor) -> [&mut [f32]; 2] {
    let half = tensor.numel() / 2;
    floats_mut(tensor).split_at_mut(half).into()
}
