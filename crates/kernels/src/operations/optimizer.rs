//! A step of an optimizer on all variables.

use crate::adam::{self, AdamStep, Slices};
use crate::backend::{Backend, Kernels};
use crate::gpu;
use crate::simd::Instructions;
use crate::tensors::{address_span, floats, floats_mut};
use crate::update::{Rate, Rule, Updated};

/// Changes the variables by their rates and their gradients, every number of which is clipped to +- `clip`: on a GPU all of
/// them in one launch, on the CPU one after the other, there by a kernel for Adam.
///
/// # Panics
/// Slots that are not the rule's, tensors of different sizes, two tensors of one variable in the same memory.
pub fn descend(kernels: Kernels, rule: Rule, clip: Option<f64>, mut updated: Vec<Updated>) {
    assert!(updated.iter().all(|one| one.slots.len() == rule.slots()), "the rule's slots");
    assert!(updated.iter().all(is_apart), "each has memory of its own");
    let _guard = tch::no_grad_guard();
    if kernels == Kernels::Own && !updated.is_empty() && updated.iter().all(gpu::can_update) {
        return gpu::descend(rule, clip, &mut updated);
    }
    for mut one in updated {
        if let Some(limit) = clip {
            one.gradient = one.gradient.clamp(-limit, limit);
        }
        match (backend(kernels, &one), rule, &one.rate) {
            (Backend::Cpu(instructions), Rule::Adam { decays, epsilon }, &Rate::Number(rate)) => {
                let [betas @ .., rate, epsilon] = [decays.0, decays.1, rate, epsilon].map(|number| number as f32);
                adam_on_cpu(instructions, AdamStep { betas, rate, epsilon }, &mut one);
            }
            _ => by_libtorch(rule, one),
        }
    }
}

fn backend(kernels: Kernels, one: &Updated) -> Backend {
    let tensors = one.tensors();
    if tensors.iter().all(|tensor| tensor.is_contiguous()) { kernels.backend(&tensors) } else { Backend::Libtorch }
}

/// Whether no tensor of a variable is in the memory of another.
fn is_apart(one: &Updated) -> bool {
    let mut spans: Vec<_> = one.tensors().into_iter().map(address_span).filter(|span| !span.is_empty()).collect();
    spans.sort_unstable_by_key(|span| span.start);
    spans.windows(2).all(|pair| pair[0].end <= pair[1].start)
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

fn adam_on_cpu(instructions: Instructions, step: AdamStep, one: &mut Updated) {
    let Updated { variable, gradient, slots, .. } = one;
    let [mean, square] = slots.as_mut_slice() else { unreachable!("the slots were counted") };
    let slices = Slices {
        variable: floats_mut(variable),
        gradient: floats(gradient),
        mean: floats_mut(mean),
        square: floats_mut(square),
    };
    adam::step(instructions, step, slices);
}
