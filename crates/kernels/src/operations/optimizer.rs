//! A step of an optimizer on all variables.

use tch::Tensor;

use crate::adam::{self, AdamStep, Slices};
use crate::backend::{Backend, Kernels};
use crate::gpu;
use crate::simd::Instructions;
use crate::tensors::{floats, floats_mut};
use crate::update::{Rate, Rule, Updated};

/// Changes the variables by their rates and their gradients, every number of which is clipped to +- `clip`: on a GPU all of
/// them in one launch, on the CPU one after the other, there by a kernel for Adam.
///
/// # Panics
/// Slots that are not the rule's, tensors of different sizes, two tensors of one variable in the same memory.
pub fn descend(kernels: Kernels, rule: Rule, clip: Option<f64>, mut updated: Vec<Updated>) {
    assert!(updated.iter().all(|one| one.slots.len() == rule.slots()), "the rule's slots");
    let _guard = tch::no_grad_guard();
    if kernels == Kernels::Own && !updated.is_empty() && updated.iter().all(gpu::can_update) {
        return gpu::descend(rule, clip, &mut updated);
    }
    for mut one in updated {
        if let Some(limit) = clip {
            one.gradient = one.gradient.clamp(-limit, limit);
        }
        match (rule, &one.rate) {
            (Rule::Adam { decays, epsilon }, &Rate::Number(rate)) if has_kernel_for(kernels, &one) => {
                let [betas @ .., rate, epsilon] = [decays.0, decays.1, rate, epsilon].map(|number| number as f32);
                adam_on_cpu(AdamStep { betas, rate, epsilon }, &mut one);
            }
            _ => by_libtorch(rule, one),
        }
    }
}

fn has_kernel_for(kernels: Kernels, one: &Updated) -> bool {
    let tensors: Vec<_> = [&one.variable, &one.gradient].into_iter().chain(&one.slots).collect();
    kernels.backend(&tensors) == Backend::Cpu && tensors.iter().all(|tensor| tensor.is_contiguous())
}

fn by_libtorch(rule: Rule, one: Updated) {
    let Updated { mut variable, gradient: g, mut slots, rate } = one;
    match (rule, slots.as_mut_slice()) {
        (Rule::Momentum { decay }, [a]) => {
            let _ = a.g_mul_scalar_(decay).g_add_(&g);
            let _ = variable.g_add_(&rate.descent(a));
        }
        (Rule::RmsProp { decay, epsilon }, [ms]) => {
            let _ = ms.lerp_(&g.square(), 1.0 - decay);
            let root = (&*ms + epsilon).sqrt_();
            let _ = variable.addcdiv_(&rate.descent(&g), &root);
        }
        (Rule::Adam { decays: (b1, b2), epsilon }, [m, v]) => {
            let _ = m.lerp_(&g, 1.0 - b1);
            let _ = v.lerp_(&g.square(), 1.0 - b2);
            let root = v.sqrt().g_add_scalar_(epsilon);
            let _ = variable.addcdiv_(&rate.descent(m), &root);
        }
        _ => {
            let _ = variable.g_add_(&rate.descent(&g));
        }
    }
}

fn adam_on_cpu(step: AdamStep, one: &mut Updated) {
    let Updated { variable, gradient, slots, .. } = one;
    let [mean, square] = slots.as_mut_slice() else { unreachable!("the slots were counted") };
    let place = |tensor: &Tensor| (tensor.data_ptr() as usize, size_of::<f32>() * tensor.numel());
    let mut places = [place(gradient), place(variable), place(mean), place(square)];
    places.sort_unstable();
    let apart = places.windows(2).all(|pair| pair[0].0 + pair[0].1 <= pair[1].0);
    assert!(apart || gradient.numel() == 0, "each has memory of its own");
    let slices = Slices {
        variable: floats_mut(variable),
        gradient: floats(gradient),
        mean: floats_mut(mean),
        square: floats_mut(square),
    };
    adam::step(Instructions::best(), step, slices);
}
