//! Phase 3, join: encoder, physics and decoder trained together, `L_pred + alpha L_rec`.
//!
//! With `position_consistency` and `velocity_consistency` at 0 and no refinement this is the original's whole training
//! (paper: section 3.4). The two extra terms pull the roll-out to the encoded (detached) positions and the velocity estimator
//! to the refined velocities.

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};
use tch::{Device, Tensor};

use super::base::{Session, TrainingOutcome};
use super::objective::{Objective, StepLoss, Validated};
use super::optimizers::OptimizerKind;
use super::phase::Phase;
use super::ranges::{at_least_one, countable, not_negative};
use super::schedule::{LrSchedule, Timetable};
use crate::datasets::iterators::{Clips, ShuffledBatches};
use crate::network::System;
use crate::network::cells::{Actions, State};
use crate::network::physics_models::losses::{Losses, MeanLosses, latent_error};
use crate::network::physics_models::{ForwardPass, GradientPaths, PhysicsNet, VariableGroup};

/// The phase's config.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Join {
    pub optimizer: OptimizerKind,
    /// Rate of the networks; the task's `base_lr` by default.
    pub learning_rate: f64,
    /// Rate of the physical parameters; that of the networks by default.
    pub physics_learning_rate: f64,
    /// Rate of a black box in the place of the physics; that of the networks by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dynamics_learning_rate: Option<f64>,
    /// Which loss teaches which part.
    #[serde(default)]
    pub gradients: GradientPaths,
    /// Limit of a gradient's elements; 0 is none.
    pub clip_gradients: f64,
    /// Weight of L_rec; the task's by default.
    pub alpha: f64,
    /// Clips in a step.
    pub batch: usize,
    /// Either a number of steps or of passes over the training set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_steps: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub epochs: Option<u64>,
    /// Whether the phase ends with the weights of its best validation; otherwise with its last ones, as the original.
    #[serde(default)]
    pub end_at_best: bool,
    pub schedule: LrSchedule,
    /// Weight of the smooth-L1 between rolled-out and encoded positions.
    pub position_consistency: f64,
    /// Weight of the smooth-L1 between estimated and refined velocities.
    pub velocity_consistency: f64,
    /// Clips of the validation split that are scored; all if there are fewer.
    pub validation_clips: usize,
}

impl Join {
    pub(super) fn check(&self) -> Result<()> {
        ensure!(
            self.max_steps.is_some() != self.epochs.is_some(),
            "config: join needs either max_steps or epochs, not both and not neither"
        );
        countable("join.max_steps", self.max_steps.unwrap_or(0))?;
        countable("join.epochs", self.epochs.unwrap_or(0))?;
        at_least_one("join.batch", self.batch as u64)?;
        at_least_one("join.validation_clips", self.validation_clips as u64)?;
        for (key, number) in [
            ("join.learning_rate", self.learning_rate),
            ("join.physics_learning_rate", self.physics_learning_rate),
            ("join.dynamics_learning_rate", self.dynamics_learning_rate.unwrap_or(0.0)),
            ("join.clip_gradients", self.clip_gradients),
            ("join.alpha", self.alpha),
            ("join.position_consistency", self.position_consistency),
            ("join.velocity_consistency", self.velocity_consistency),
        ] {
            not_negative(key, number)?;
        }
        self.schedule.check().context("config: join.schedule")
    }
}

impl Phase for Join {
    fn name(&self) -> &'static str {
        "join"
    }

    fn frames(&self, system: &System) -> f64 {
        self.max_steps.unwrap_or(0) as f64 * self.batch as f64 * (system.input_steps + system.pred_steps) as f64
    }

    fn run(&self, session: &mut Session) -> Result<TrainingOutcome> {
        let mut joint = Joint::new(self, session.train, session.seed)?;
        session.train_phase(self.name(), &mut joint, self.optimizer, self.clip_gradients)
    }
}

/// The phase's state between steps.
#[derive(Debug)]
struct Joint<'a> {
    config: &'a Join,
    train: &'a Clips,
    batches: ShuffledBatches,
    timetable: Timetable,
    /// Whether the step's inputs hold the order of the objects.
    ordered: bool,
}

impl<'a> Joint<'a> {
    /// # Errors
    /// No training clips.
    fn new(config: &'a Join, train: &'a Clips, seed: u64) -> Result<Self> {
        let batches = ShuffledBatches::new(train.len(), config.batch, seed)?;
        let timetable = match (config.max_steps, config.epochs) {
            (Some(steps), _) => Timetable::new(config.schedule.clone(), steps, 1),
            (None, epochs) => Timetable::new(config.schedule.clone(), epochs.unwrap_or(0), batches.steps_per_epoch()),
        };
        Ok(Joint { config, train, batches, timetable, ordered: false })
    }

    /// The two latent terms of a pass, weighted; none where switched off.
    fn latent_terms(&self, model: &PhysicsNet, pass: &ForwardPass) -> Option<Tensor> {
        let input = model.system.input_steps as i64;
        let mut terms = Vec::new();
        if self.config.position_consistency > 0.0 {
            let encoded = pass.positions.narrow(1, input, model.system.pred_steps as i64);
            terms.push(latent_error(&State::positions(&pass.states), &encoded) * self.config.position_consistency);
        }
        let refined = model.options.refinement_steps > 0 && model.black_box.is_none();
        if self.config.velocity_consistency > 0.0 && refined {
            let estimate = model.velocity.forward(&pass.positions.narrow(1, 0, input).detach());
            terms.push(latent_error(&estimate, &pass.initial.vel) * self.config.velocity_consistency);
        }
        terms.into_iter().reduce(|sum, term| sum + term)
    }
}

impl Objective for Joint<'_> {
    fn timetable(&self) -> &Timetable {
        &self.timetable
    }

    /// Clips, the order of the objects in them if it was looked up before, and what acts.
    fn inputs(&mut self, model: &PhysicsNet, step: u64, _validations: &[f64]) -> Result<Vec<Tensor>> {
        let system = &model.system;
        let chosen = self.batches.clips_of_step(step);
        let clips = self.train.batch(chosen, system.input_steps + system.pred_steps);
        // Names are told by the processor: on a GPU in a pass of its own, so that the step itself never waits for it.
        let order = if clips.device() == Device::Cpu { None } else { model.order(&clips) };
        self.ordered = order.is_some();
        Ok(std::iter::once(clips).chain(order).chain(self.train.actions(chosen).into_values()).collect())
    }

    fn loss(&self, model: &PhysicsNet, inputs: &[Tensor]) -> Result<StepLoss> {
        let (clips, others) = (&inputs[0], &inputs[1..]);
        let (order, actions) = others.split_at(usize::from(self.ordered));
        let actions = Actions::new(actions.first().map(Tensor::shallow_clone));
        let pass = model.forward_with(clips, &actions, order.first(), self.config.gradients)?;
        let losses = Losses::new(&pass, clips, &model.system);
        let mut total = losses.train(self.config.alpha);
        if let Some(latent) = self.latent_terms(model, &pass) {
            total += latent;
        }
        Ok(StepLoss { total, reconstruction: Some(losses.reconstruction), prediction: Some(losses.prediction) })
    }

    fn learning_rate(&self, group: VariableGroup) -> f64 {
        match group {
            VariableGroup::Physics => self.config.physics_learning_rate,
            VariableGroup::Dynamics => self.config.dynamics_learning_rate.unwrap_or(self.config.learning_rate),
            VariableGroup::Encoder | VariableGroup::Velocity | VariableGroup::Decoder => self.config.learning_rate,
        }
    }

    fn ends_at_best(&self) -> bool {
        self.config.end_at_best
    }

    /// `L_pred + alpha L_rec` on the validation split.
    fn validate(&self, _model: &PhysicsNet, losses: &dyn Fn() -> Result<MeanLosses>) -> Result<Validated> {
        let losses = losses()?;
        Ok(Validated::new(losses.pred_loss + self.config.alpha * losses.recons_loss, &losses))
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array5;

    use super::*;
    use crate::training::config::Config;
    use crate::training::layers::Overrides;

    #[test]
    fn alpha_weighs_the_reconstruction_and_the_physics_has_its_own_rate() {
        let overrides = Overrides {
            task: Some("spring_color".into()),
            recipe: Some("paper".into()),
            set: ["join.alpha=2.5", "join.physics_learning_rate=0.5"].map(String::from).into(),
            ..Overrides::default()
        };
        let config = Config::load(None, &overrides).unwrap();
        let model = PhysicsNet::new(&config.task.system, &config.model, Device::Cpu, 1).unwrap();
        let pixels =
            Array5::from_shape_fn((2, 12, 32, 32, 3), |(clip, t, y, x, c)| (clip + t + 5 * y + 3 * x + c) as u8);
        let clips = Clips::new(&pixels, None, Device::Cpu);
        let mut joint = Joint::new(&config.join, &clips, 0).unwrap();
        let inputs = joint.inputs(&model, 0, &[]).unwrap();
        let loss = joint.loss(&model, &inputs).unwrap();
        let number = |loss: &Tensor| loss.double_value(&[]);
        let [total, reconstruction, prediction] =
            [Some(&loss.total), loss.reconstruction.as_ref(), loss.prediction.as_ref()]
                .map(|part| number(part.unwrap()));
        // Two roundings of float32.
        let expected = prediction + 2.5 * reconstruction;
        assert!((total / expected - 1.0).abs() < 1e-6, "{total}, expected {expected}");
        assert_eq!(joint.learning_rate(VariableGroup::Physics), 0.5);
        assert_eq!(joint.learning_rate(VariableGroup::Decoder), config.task.base_lr);
    }
}
