//! A step of an optimizer on all variables at once (`optimizer.cu`).

use std::ffi::{c_int, c_long, c_void};

use tch::Tensor;

use super::launch::{floats, floats_mut, on_stream, supports};
use crate::update::{Rate, Rule, Updated};

#[repr(C)]
struct OptimizerVariable {
    variable: *mut f32,
    first: *mut f32,
    second: *mut f32,
    gradient: *const f32,
    rate: *const f32,
    count: c_long,
}

#[repr(C)]
#[derive(Clone, Copy)]
struct OptimizerUpdate {
    rule: c_int,
    clip: f32,
    first_decay: f32,
    second_decay: f32,
    epsilon: f32,
}

unsafe extern "C" {
    fn paig_gpu_descend(
        update: OptimizerUpdate,
        variables: *const OptimizerVariable,
        count: c_int,
        stream: *mut c_void,
    ) -> bool;
}

/// Whether the kernel can change a variable.
pub fn can_update(updated: &Updated) -> bool {
    let Rate::OnDevice(rate) = &updated.rate else { return false };
    let tensors: Vec<_> = [&updated.variable, &updated.gradient, rate].into_iter().chain(&updated.slots).collect();
    supports(&tensors) && tensors.iter().all(|tensor| tensor.is_contiguous())
}

fn row(updated: &mut Updated) -> OptimizerVariable {
    let Updated { variable, gradient, slots, rate } = updated;
    let same = |tensor: &Tensor| tensor.size() == variable.size();
    assert!(same(gradient) && slots.iter().all(same), "a number of each for every number of a variable");
    let Rate::OnDevice(rate) = rate else { panic!("a rate on the device") };
    assert_eq!(rate.numel(), 1, "a rate for a variable");
    let count = variable.numel() as c_long;
    let mut slot = |number: usize| slots.get_mut(number).map_or(std::ptr::null_mut(), floats_mut);
    let (first, second) = (slot(0), slot(1));
    OptimizerVariable {
        variable: floats_mut(variable),
        first,
        second,
        gradient: floats(gradient),
        rate: floats(rate),
        count,
    }
}

fn update(rule: Rule, clip: Option<f64>) -> OptimizerUpdate {
    let (rule, (first, second), epsilon) = match rule {
        Rule::Sgd => (0, (0.0, 0.0), 0.0),
        Rule::Momentum { decay } => (1, (decay, 0.0), 0.0),
        Rule::RmsProp { decay, epsilon } => (2, (decay, 0.0), epsilon),
        Rule::Adam { decays, epsilon } => (3, decays, epsilon),
    };
    let [clip, first_decay, second_decay, epsilon] =
        [clip.unwrap_or(f64::INFINITY), first, second, epsilon].map(|number| number as f32);
    OptimizerUpdate { rule, clip, first_decay, second_decay, epsilon }
}

/// Changes the variables by their rates and their gradients, of which every number is clipped to +- `clip`.
///
/// # Panics
/// Tensors that are not contiguous or not of one size, a rate that is not on the device.
pub fn descend(rule: Rule, clip: Option<f64>, variables: &mut [Updated]) {
    assert!(variables.iter().all(|variable| variable.slots.len() == rule.slots()), "the rule's slots");
    let table: Vec<_> = variables.iter_mut().map(row).collect();
    let Some(first) = variables.first() else { return };
    // SAFETY: tensors of the sizes that are said; the table is read before the call returns.
    on_stream(&first.variable, |stream| unsafe {
        paig_gpu_descend(update(rule, clip), table.as_ptr(), table.len() as c_int, stream)
    });
}
