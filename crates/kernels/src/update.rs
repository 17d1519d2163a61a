//! The update rules of the optimizers, and a variable's part in a step.

use tch::Tensor;

/// How a variable is changed by its gradient g, with the rule's constants, at the rate r.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rule {
    /// `w -= r g`.
    Sgd,
    /// Slot a: `a = decay a + g`; `w -= r a`.
    Momentum { decay: f64 },
    /// Slot ms: `ms = decay ms + (1 - decay) g^2`; `w -= r g / sqrt(ms + epsilon)`.
    RmsProp { decay: f64, epsilon: f64 },
    /// Slots m and v, the decaying means of g and of its square; `w -= r m / (sqrt(v) + epsilon)`.
    Adam { decays: (f64, f64), epsilon: f64 },
}

/// The rate of a variable in one step.
#[derive(Debug)]
pub enum Rate {
    Number(f64),
    /// On a GPU, one number with the sign of a descent: a step that is recorded reads it there.
    OnDevice(Tensor),
}

/// A variable, its gradient, and the rule's slots in their order: none of them in the memory of another. Two variables may
/// have one gradient.
#[derive(Debug)]
pub struct Updated {
    pub variable: Tensor,
    pub gradient: Tensor,
    pub slots: Vec<Tensor>,
    pub rate: Rate,
}

impl Updated {
    /// Variable, gradient and slots.
    pub(super) fn tensors(&self) -> Vec<&Tensor> {
        [&self.variable, &self.gradient].into_iter().chain(&self.slots).collect()
    }
}

impl Rule {
    /// The number of its slots.
    pub fn slots(self) -> usize {
        match self {
            Rule::Sgd => 0,
            Rule::Momentum { .. } | Rule::RmsProp { .. } => 1,
            Rule::Adam { .. } => 2,
        }
    }
}

impl Rate {
    /// A direction of ascent times the rate, downwards.
    pub fn descent(&self, direction: &Tensor) -> Tensor {
        match self {
            Rate::Number(rate) => direction * -rate,
            Rate::OnDevice(rate) => direction * rate,
        }
    }
}
