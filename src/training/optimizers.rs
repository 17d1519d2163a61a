//! Optimizers with TensorFlow 1's arithmetic, over named variables, with slots that can be saved.
//!
//! Original: `base.py` (`tf.train.RMSPropOptimizer`, `AdamOptimizer`, `MomentumOptimizer`, `GradientDescentOptimizer`).
//! PyTorch's differ: its RMSProp starts at zero and adds epsilon outside the root, its Adam corrects both moments.

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};
use tch::{Device, Kind, Tensor};

use paig_kernels::{Kernels, Rate, Rule, Updated, descend, forget_gradient};

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
    rates: Rates,
}

/// What the step at hand is multiplied by, one for each variable.
#[derive(Debug)]
enum Rates {
    Numbers(Vec<f64>),
    /// On a GPU, with the sign of a descent, `[variables]`: a step that is recorded reads them there.
    OnDevice(Tensor),
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

    /// The rule with its constants.
    fn rule(self) -> Rule {
        match self {
            OptimizerKind::RmsProp => Rule::RmsProp { decay: RMSPROP_DECAY, epsilon: RMSPROP_EPSILON },
            OptimizerKind::Adam => Rule::Adam { decays: ADAM_BETAS, epsilon: ADAM_EPSILON },
            OptimizerKind::Momentum => Rule::Momentum { decay: MOMENTUM },
            OptimizerKind::Sgd => Rule::Sgd,
        }
    }
}

impl Rates {
    /// That of a variable.
    fn of(&self, place: usize) -> Rate {
        match self {
            Rates::Numbers(rates) => Rate::Number(rates[place]),
            Rates::OnDevice(rates) => Rate::OnDevice(rates.get(place as i64)),
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
        let rates = match variables.first().map(|(_, variable)| variable.device()) {
            None | Some(Device::Cpu) => Rates::Numbers(Vec::new()),
            Some(device) => Rates::OnDevice(Tensor::zeros([variables.len() as i64], (Kind::Float, device))),
        };
        Optimizer { rule, clip, steps: 0, slots, kernels: Kernels::Own, rates }
    }

    /// As a phase's config has it: gradients are clipped to +- `clip_gradients`, and with 0 not at all.
    pub fn of_config(rule: OptimizerKind, clip_gradients: f64, variables: &[(String, Tensor)]) -> Self {
        Self::new(rule, (clip_gradients > 0.0).then_some(clip_gradients), variables)
    }

    /// Computes with these kernels.
    #[must_use]
    pub fn with_kernels(self, kernels: Kernels) -> Self {
        Optimizer { kernels, ..self }
    }

    /// One step on the variables' gradients, with a learning rate for each variable; forgets the gradients.
    ///
    /// A variable without a gradient is left as it is.
    pub fn step(&mut self, variables: &[(String, Tensor)], learning_rate: impl Fn(&str) -> f64) {
        let rates: Vec<_> = variables.iter().map(|(name, _)| learning_rate(name)).collect();
        self.begin_step(&rates);
        self.follow_gradients(variables);
    }

    /// Counts a step and makes its rates known, one for each variable: what of a step is new each time.
    pub fn begin_step(&mut self, rates: &[f64]) {
        self.steps += 1;
        let correction = self.correction();
        let corrected = rates.iter().map(|rate| rate * correction);
        match &mut self.rates {
            Rates::Numbers(numbers) => *numbers = corrected.collect(),
            Rates::OnDevice(known) => {
                let _guard = tch::no_grad_guard();
                let downwards: Vec<_> = corrected.map(|rate| -rate as f32).collect();
                known.copy_(&Tensor::from_slice(&downwards));
            }
        }
    }

    /// Differentiates a loss and takes the step that was begun. On a GPU both may be recorded and repeated: nothing but the
    /// rates, which are read there, is new each time.
    pub fn descend(&self, loss: &Tensor, variables: &[(String, Tensor)]) {
        // A recording that failed leaves gradients that were never computed.
        forget_gradients(variables);
        loss.backward();
        self.follow_gradients(variables);
    }

    /// The step that was begun, on the variables' gradients; forgets them: libtorch then keeps the next ones, where it can, as
    /// they were computed, instead of adding them to zeros.
    fn follow_gradients(&self, variables: &[(String, Tensor)]) {
        descend(self.kernels, self.rule.rule(), self.clip, self.updated(variables));
        forget_gradients(variables);
    }

    /// The variables that have a gradient, with their slots and rates.
    fn updated(&self, variables: &[(String, Tensor)]) -> Vec<Updated> {
        let with_gradient = variables.iter().enumerate().filter(|(_, (_, variable))| variable.grad().defined());
        let updated = with_gradient.map(|(place, (name, variable))| {
            let slots = self.rule.slots().iter().map(|(slot, _)| self.slot(name, slot)).collect();
            let (variable, gradient) = (variable.shallow_clone(), variable.grad());
            Updated { variable, gradient, slots, rate: self.rates.of(place) }
        });
        updated.collect()
    }

    /// What a rate is multiplied by at this step: of Adam, the correction of moments that began at 0.
    fn correction(&self) -> f64 {
        let (b1, b2) = ADAM_BETAS;
        match (self.rule, self.steps as f64) {
            (OptimizerKind::Adam, t) => (1.0 - b2.powf(t)).sqrt() / (1.0 - b1.powf(t)),
            _ => 1.0,
        }
    }

    fn slot(&self, variable: &str, slot: &str) -> Tensor {
        let key = format!("{variable}/{slot}");
        self.slots.get(&key).unwrap_or_else(|| panic!("no slot {key}")).shallow_clone()
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

fn forget_gradients(variables: &[(String, Tensor)]) {
    variables.iter().for_each(|(_, variable)| forget_gradient(variable));
}

#[cfg(test)]
mod tests {
    use super::*;
    use paig_kernels::gpu::{self, testing::test_device};

    const RULES: [OptimizerKind; 4] =
        [OptimizerKind::RmsProp, OptimizerKind::Adam, OptimizerKind::Momentum, OptimizerKind::Sgd];

    /// TensorFlow 1's RMSProp as the original has it, after gradients that were 0 for so long that nothing but epsilon is left
    /// under the root, then tiny, clipped and plain ones, at a rate that falls. Rounding of double precision.
    #[test]
    fn rmsprop_has_its_epsilon_under_the_root_and_begins_at_one() {
        let gradients = [vec![0.0; 300], vec![1e-7; 5], vec![5.0, -5.0, 0.3, -0.01]].concat();
        for clip in [None, Some(1.0)] {
            let weights = Tensor::zeros([1], (Kind::Double, Device::Cpu)).set_requires_grad(true);
            let variables = [("weights".to_string(), weights.shallow_clone())];
            let mut optimizer = Optimizer::new(OptimizerKind::RmsProp, clip, &variables);
            let (mut mean_square, mut expected) = (1.0f64, 0.0f64);
            for (step, gradient) in gradients.iter().enumerate() {
                let rate = if step < 305 { 0.01 } else { 0.002 };
                (&weights * *gradient).sum(Kind::Double).backward();
                optimizer.step(&variables, |_| rate);
                let gradient = clip.map_or(*gradient, |clip| gradient.clamp(-clip, clip));
                mean_square = 0.9 * mean_square + 0.1 * gradient * gradient;
                expected -= rate * gradient / (mean_square + 1e-10).sqrt();
                let found = weights.double_value(&[0]);
                assert!(
                    (found - expected).abs() <= 1e-12 * expected.abs(),
                    "{clip:?}, step {step}: {found}, {expected}"
                );
            }
        }
    }

    #[test]
    fn a_limit_of_0_clips_nothing() {
        let moved = |clip_gradients: f64| {
            let weights = Tensor::zeros([1], (Kind::Double, Device::Cpu)).set_requires_grad(true);
            let variables = [("weights".to_string(), weights.shallow_clone())];
            (&weights * 5.0).sum(Kind::Double).backward();
            Optimizer::of_config(OptimizerKind::Sgd, clip_gradients, &variables).step(&variables, |_| 1.0);
            weights.double_value(&[0])
        };
        assert_eq!([moved(0.0), moved(2.0)], [-5.0, -2.0]);
    }

    /// A step whose rates are read from a tensor, as on a GPU, is the same as one that is told numbers; so what is recorded once
    /// follows rates that fall and moments that are corrected.
    #[test]
    fn rates_on_the_device_are_the_rates() {
        for rule in RULES {
            let [told, read] = [false, true].map(|on_device| {
                let weights = Tensor::linspace(-1.0, 1.0, 9, (Kind::Float, Device::Cpu)).set_requires_grad(true);
                let variables = [("weights".to_string(), weights.shallow_clone())];
                let mut optimizer = Optimizer::new(rule, Some(0.5), &variables).with_kernels(Kernels::Libtorch);
                if on_device {
                    optimizer.rates = Rates::OnDevice(Tensor::zeros([1], (Kind::Float, Device::Cpu)));
                }
                for step in 0..6 {
                    (weights.sin() * &weights).sum(Kind::Float).backward();
                    optimizer.step(&variables, |_| 0.1 / f64::from(1 + step));
                }
                weights.detach()
            });
            // Rounding of a rate to float32 before it is multiplied, or with it.
            let difference = (told - read).abs().max().double_value(&[]);
            assert!(difference < 1e-6, "{rule:?}: {difference}");
        }
    }

    /// libtorch hands both variables of a sum one gradient, seen in two shapes: a step of one must not change it for the other.
    #[test]
    fn variables_whose_gradients_share_memory_move_as_if_alone() {
        for (rule, clip) in RULES.into_iter().flat_map(|rule| [(rule, None), (rule, Some(0.5))]) {
            let zeros = |size: &[i64]| Tensor::zeros(size, (Kind::Float, Device::Cpu)).set_requires_grad(true);
            let pull = Tensor::linspace(-1.0, 2.0, 6, (Kind::Float, Device::Cpu));
            let moved = |variables: Vec<Tensor>, kernels: Kernels| {
                let named = |(n, variable): (usize, &Tensor)| (n.to_string(), variable.shallow_clone());
                let named: Vec<_> = variables.iter().enumerate().map(named).collect();
                let mut optimizer = Optimizer::new(rule, clip, &named).with_kernels(kernels);
                for _ in 0..3 {
                    let sum = variables.iter().map(|variable| variable.view(-1)).reduce(|sum, it| sum + it).unwrap();
                    (sum * &pull).sum(Kind::Float).backward();
                    optimizer.step(&named, |_| 0.1);
                }
                variables.iter().map(|variable| variable.detach().view(-1)).collect::<Vec<_>>()
            };
            for kernels in [Kernels::Libtorch, Kernels::Own] {
                let alone = moved(vec![zeros(&[6])], kernels).remove(0);
                assert!(alone.abs().max().double_value(&[]) > 0.01);
                for together in moved(vec![zeros(&[6]), zeros(&[2, 3])], kernels) {
                    assert_eq!(together, alone, "{rule:?}, {clip:?}, {kernels:?}");
                }
            }
        }
    }

    /// All variables at once, more than one launch takes, with gradients that are clipped and one that is no number.
    #[test]
    fn the_kernel_for_gpus_takes_the_same_steps() {
        let Some(device) = test_device() else { return };
        for (rule, clip) in RULES.into_iter().flat_map(|rule| [(rule, None), (rule, Some(0.5))]) {
            let [by_libtorch, by_kernel] = [false, true].map(|by_kernel| {
                let values = (0..70).map(|n| {
                    // One that several blocks share, and one without numbers.
                    let numbers = [(20, 5000), (21, 0)].into_iter().find(|(place, _)| *place == n);
                    let numbers = numbers.map_or(3 + 5 * n, |(_, numbers)| numbers);
                    let weights = Tensor::linspace(-1.0, 1.0, numbers, (Kind::Float, device)).set_requires_grad(true);
                    (format!("weights {n}"), weights)
                });
                let variables: Vec<_> = values.collect();
                let mut optimizer = Optimizer::new(rule, clip, &variables).with_kernels(Kernels::Libtorch);
                optimizer.rates = Rates::OnDevice(Tensor::zeros([70], (Kind::Float, device)));
                for step in 0..4 {
                    let loss = |(_, weights): &(String, Tensor)| (weights.sin() * weights).sum(Kind::Float);
                    let loss = variables.iter().map(loss).reduce(|sum, loss| sum + loss).unwrap();
                    loss.backward();
                    if step == 3 {
                        let _ = variables[1].1.grad().narrow(0, 1, 1).fill_(f64::NAN);
                    }
                    let rates: Vec<_> = (0..70).map(|n| 0.1 / f64::from(1 + n + step)).collect();
                    optimizer.begin_step(&rates);
                    if by_kernel {
                        let _guard = tch::no_grad_guard();
                        gpu::descend(rule.rule(), clip, &mut optimizer.updated(&variables));
                        forget_gradients(&variables);
                    } else {
                        optimizer.follow_gradients(&variables);
                    }
                    assert!(variables.iter().all(|(_, weights)| !weights.grad().defined()));
                }
                let weights: Vec<_> = variables.iter().map(|(_, weights)| weights.detach()).collect();
                Tensor::cat(&weights, 0)
            });
            assert_eq!(i64::try_from(by_kernel.isnan().sum(Kind::Int64)).unwrap(), 1, "{rule:?}: the one number");
            // Roundings of a few operations a step, of numbers up to 1; a GPU rounds a product and a sum once.
            let difference = (by_libtorch - by_kernel).nan_to_num(0.0, None, None).abs().max().double_value(&[]);
            assert!(difference < 5e-6, "{rule:?}: {difference}");
        }
    }
}
