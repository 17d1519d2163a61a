//! Optimizers with TensorFlow 1's arithmetic, over named variables, with slots that can be saved.
//!
//! Original: `base.py` (`tf.train.RMSPropOptimizer`, `AdamOptimizer`, `MomentumOptimizer`, `GradientDescentOptimizer`).
//! PyTorch's differ: its RMSProp starts at zero and adds epsilon outside the root, its Adam corrects both moments.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};
use tch::Tensor;

use crate::kernels::{self, AdamStep, Kernels};

/// Which update rule. The constants are TensorFlow 1's defaults, as the original uses them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OptimizerKind {
    /// `ms = 0.9 ms + 0.1 g^2` from ms = 1; `w -= lr g / sqrt(ms + 1e-10)`.
    RmsProp,
    /// `w -= lr_t m / (sqrt(v) + 1e-8)` with `lr_t = lr sqrt(1 - 0.999^t) / (1 - 0.9^t)`.
    Adam,
    /// `a = 0.9 a + g`; `w -= lr a`.
    Momentum,
    /// `w -= lr g`.
    Sgd,
}

const RMSPROP_DECAY: f64 = 0.9;
const RMSPROP_EPSILON: f64 = 1e-10;
const ADAM_BETAS: (f64, f64) = (0.9, 0.999);
const ADAM_EPSILON: f64 = 1e-8;
const MOMENTUM: f64 = 0.9;

/// An update rule with its slots.
#[derive(Debug)]
pub struct Optimizer {
    rule: OptimizerKind,
    /// Every element of a gradient is clipped to +- this.
    clip: Option<f64>,
    steps: u64,
    /// Slots by `variable/slot`.
    slots: BTreeMap<String, Tensor>,
    /// What computes a step.
    kernels: Kernels,
}

impl OptimizerKind {
    /// Names and initial values of the rule's slots.
    fn slots(self) -> &'static [(&'static str, f64)] {
        match self {
            OptimizerKind::RmsProp => &[("ms", 1.0)],
            OptimizerKind::Adam => &[("m", 0.0), ("v", 0.0)],
            OptimizerKind::Momentum => &[("momentum", 0.0)],
            OptimizerKind::Sgd => &[],
        }
    }
}

impl Optimizer {
    /// Slots at their initial values for these variables.
    pub fn new(rule: OptimizerKind, clip: Option<f64>, variables: &[(String, Tensor)]) -> Self {
        let _guard = tch::no_grad_guard();
        let mut slots = BTreeMap::new();
        for (name, variable) in variables {
            for (slot, initial) in rule.slots() {
                slots.insert(format!("{name}/{slot}"), variable.detach().full_like(*initial));
            }
        }
        Optimizer { rule, clip, steps: 0, slots, kernels: Kernels::Own }
    }

    /// Computes with these kernels.
    #[must_use]
    pub fn with_kernels(self, kernels: Kernels) -> Self {
        Optimizer { kernels, ..self }
    }

    /// One step on the variables' gradients, with a learning rate for each variable; clears the gradients.
    ///
    /// A variable without a gradient is left as it is.
    pub fn step(&mut self, variables: &[(String, Tensor)], learning_rate: impl Fn(&str) -> f64) {
        let _guard = tch::no_grad_guard();
        self.steps += 1;
        for (name, variable) in variables {
            let mut gradient = variable.grad();
            if !gradient.defined() {
                continue;
            }
            if let Some(limit) = self.clip {
                let _ = gradient.clamp_(-limit, limit);
            }
            self.update(name, variable.shallow_clone(), gradient.shallow_clone(), learning_rate(name));
            let _ = gradient.zero_();
        }
    }

    /// Changes a variable and its slots. The arithmetic is done in place as far as it goes, the gradient's memory used up:
    /// half of the parameters are background and templates, and every pass over them costs.
    fn update(&mut self, name: &str, mut variable: Tensor, mut g: Tensor, rate: f64) {
        let slot = |slot: &str| {
            let key = format!("{name}/{slot}");
            self.slots.get(&key).unwrap_or_else(|| panic!("no slot {key}")).shallow_clone()
        };
        match self.rule {
            OptimizerKind::Sgd => {
                let _ = variable.g_sub_(&g.g_mul_scalar_(rate));
            }
            OptimizerKind::Momentum => {
                let mut a = slot("momentum");
                let _ = a.g_mul_scalar_(MOMENTUM).g_add_(&g);
                let _ = variable.g_sub_(&(a * rate));
            }
            OptimizerKind::RmsProp => {
                let mut ms = slot("ms");
                let _ = ms.lerp_(&g.square(), 1.0 - RMSPROP_DECAY);
                let root = (ms + RMSPROP_EPSILON).sqrt_();
                let _ = variable.addcdiv_(&g.g_mul_scalar_(-rate), &root);
            }
            OptimizerKind::Adam => {
                let (b1, b2) = ADAM_BETAS;
                let (mut m, mut v) = (slot("m"), slot("v"));
                let t = self.steps as f64;
                let rate = rate * (1.0 - b2.powf(t)).sqrt() / (1.0 - b1.powf(t));
                let tensors = [&variable, &g, &m, &v];
                if self.kernels == Kernels::Own
                    && kernels::serve(&tensors)
                    && tensors.iter().all(|it| it.is_contiguous())
                {
                    let [betas @ .., rate, epsilon] = [b1, b2, rate, ADAM_EPSILON].map(|number| number as f32);
                    return kernels::adam(AdamStep { betas, rate, epsilon }, [&mut variable, &mut g, &mut m, &mut v]);
                }
                let _ = m.lerp_(&g, 1.0 - b1);
                let _ = v.lerp_(&g.square_(), 1.0 - b2);
                let root = v.sqrt().g_add_scalar_(ADAM_EPSILON);
                let _ = variable.addcdiv_(&(m * -rate), &root);
            }
        }
    }

    /// What is kept of every variable between steps, sorted by name.
    pub fn slots(&self) -> Vec<(String, Tensor)> {
        self.slots.iter().map(|(name, slot)| (name.clone(), slot.shallow_clone())).collect()
    }

    /// Takes over the slots after `steps` steps.
    ///
    /// # Errors
    /// A slot that is missing, unknown, or of another shape than the variable's.
    pub fn restore(&mut self, steps: u64, saved: Vec<(String, Tensor)>) -> Result<()> {
        let _guard = tch::no_grad_guard();
        let names: Vec<_> = saved.iter().map(|(name, _)| name.as_str()).collect();
        let expected: Vec<_> = self.slots.keys().map(String::as_str).collect();
        ensure!(names == expected, "optimizer slots differ: found {names:?}, expected {expected:?}");
        for (name, value) in saved {
            let slot = self.slots.get_mut(&name).expect("names were compared");
            ensure!(
                slot.size() == value.size(),
                "optimizer slot {name}: shape {:?} found, {:?} expected",
                value.size(),
                slot.size()
            );
            slot.copy_(&value);
        }
        self.steps = steps;
        Ok(())
    }
}
