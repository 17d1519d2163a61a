//! A step of an optimizer on all variables at once (`optimizer.cu`).

use std::ffi::{c_int, c_long, c_void};

use tch::Tensor;

use super::launch::{floats, floats_mut, on_stream, serve};

/// How a variable is changed by its gradient, with the rule's constants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rule {
    Sgd,
    Momentum { decay: f64 },
    RmsProp { decay: f64, epsilon: f64 },
    Adam { decays: (f64, f64), epsilon: f64 },
}

/// A variable, its gradient, the slots of the rule, and the rate (one number, downwards: below 0): none of them in the memory of
/// another. Two variables may have one gradient.
#[derive(Debug)]
pub struct Updated {
    pub variable: Tensor,
    pub gradient: Tensor,
    pub slots: Vec<Tensor>,
    pub rate: Tensor,
}

#[repr(C)]
struct Variable {
    variable: *mut f32,
    first: *mut f32,
    second: *mut f32,
    gradient: *const f32,
    rate: *const f32,
    count: c_long,
}

#[repr(C)]
#[derive(Clone, Copy)]
struct Update {
    rule: c_int,
    clip: f32,
    first_decay: f32,
    second_decay: f32,
    epsilon: f32,
}

unsafe extern "C" {
    fn paig_gpu_descend(update: Update, variables: *const Variable, count: c_int, stream: *mut c_void) -> bool;
}

impl Updated {
    fn tensors(&self) -> Vec<&Tensor> {
        [&self.variable, &self.gradient, &self.rate].into_iter().chain(&self.slots).collect()
    }

    /// Whether the kernel can change it.
    pub fn is_served(&self) -> bool {
        let tensors = self.tensors();
        serve(&tensors) && tensors.iter().all(|tensor| tensor.is_contiguous())
    }

    fn row(&mut self) -> Variable {
        let Updated { variable, gradient, slots, rate } = self;
        let same = |tensor: &Tensor| tensor.size() == variable.size();
        assert!(same(gradient) && slots.iter().all(same), "a number of each for every number of a variable");
        assert_eq!(rate.numel(), 1, "a rate for a variable");
        let count = variable.numel() as c_long;
        let mut slot = |number: usize| slots.get_mut(number).map_or(std::ptr::null_mut(), floats_mut);
        let (first, second) = (slot(0), slot(1));
        Variable {
            variable: floats_mut(variable),
            first,
            second,
            gradient: floats(gradient),
            rate: floats(rate),
            count,
        }
    }
}

impl Rule {
    fn slots(self) -> usize {
        match self {
            Rule::Sgd => 0,
            Rule::Momentum { .. } | Rule::RmsProp { .. } => 1,
            Rule::Adam { .. } => 2,
        }
    }

    fn update(self, clip: Option<f64>) -> Update {
        let (rule, (first, second), epsilon) = match self {
            Rule::Sgd => (0, (0.0, 0.0), 0.0),
            Rule::Momentum { decay } => (1, (decay, 0.0), 0.0),
            Rule::RmsProp { decay, epsilon } => (2, (decay, 0.0), epsilon),
            Rule::Adam { decays, epsilon } => (3, decays, epsilon),
        };
        let [clip, first_decay, second_decay, epsilon] =
            [clip.unwrap_or(f64::INFINITY), first, second, epsilon].map(|number| number as f32);
        Update { rule, clip, first_decay, second_decay, epsilon }
    }
}

/// Changes the variables by their rates and their gradients, of which every number is clipped to +- `clip`.
///
/// # Panics
/// Tensors that are not contiguous or not of one size.
pub fn descend(rule: Rule, clip: Option<f64>, variables: &mut [Updated]) {
    assert!(variables.iter().all(|variable| variable.slots.len() == rule.slots()), "the rule's slots");
    let table: Vec<_> = variables.iter_mut().map(Updated::row).collect();
    let Some(first) = variables.first() else { return };
    // SAFETY: tensors of the sizes that are said; the table is read before the call returns.
    on_stream(&first.variable, |stream| unsafe {
        paig_gpu_descend(rule.update(clip), table.as_ptr(), table.len() as c_int, stream)
    });
}
