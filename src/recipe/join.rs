//! Phase 3, join: encoder, physics and decoder trained together, `L_pred + alpha L_rec`.
//!
//! With `latent` and `velocity` at 0 and no refinement this is the original's whole training (paper: section 3.4). The
//! two extra terms pull the roll-out to the encoded (detached) positions and the velocity estimator to the refined
//! velocities.

use anyhow::Result;
use tch::Tensor;

use super::{GradientPhase, StepLoss, plateau_at};
use crate::base;
use crate::config::Join;
use crate::datasets::iterators::{Clips, ShuffledBatches};
use crate::physics_models::losses::{Losses, latent_error};
use crate::physics_models::{ForwardPass, PhysicsNet};

/// The phase's state between steps.
#[derive(Debug)]
pub struct Joint<'a> {
    config: &'a Join,
    train: &'a Clips,
    valid: &'a Clips,
    batches: ShuffledBatches,
    max_steps: u64,
    /// The step from which the learning rates are divided at the latest.
    anneal_from: u64,
}

impl<'a> Joint<'a> {
    /// # Errors
    /// A training split smaller than a batch.
    pub fn new(config: &'a Join, train: &'a Clips, valid: &'a Clips, seed: u64) -> Result<Self> {
        let batches = ShuffledBatches::new(train.len(), config.batch, seed)?;
        // The original anneals at the start of epoch int(0.75 epochs).
        let share = |total: u64| (config.anneal_at * total as f64) as u64;
        let (max_steps, anneal_from) = match (config.max_steps, config.epochs) {
            (Some(steps), _) => (steps, share(steps)),
            (None, epochs) => {
                let epochs = epochs.unwrap_or(0);
                (epochs * batches.steps_per_epoch(), share(epochs) * batches.steps_per_epoch())
            }
        };
        Ok(Joint { config, train, valid, batches, max_steps, anneal_from })
    }

    /// The step from which the rates are divided: where the validation score stands still, at the latest `anneal_from`.
    fn anneal_start(&self, validations: &[f64]) -> u64 {
        if self.config.plateau == 0.0 {
            return self.anneal_from;
        }
        plateau_at(validations, self.config.patience, self.config.plateau)
            .map_or(self.anneal_from, |place| self.anneal_from.min(place as u64 * self.config.validate_every))
    }

    /// The two latent terms of a pass, weighted; none where switched off.
    fn latent_terms(&self, model: &PhysicsNet, pass: &ForwardPass) -> Option<Tensor> {
        let input = model.task.input_steps as i64;
        let mut terms = Vec::new();
        if self.config.latent > 0.0 {
            let rolled: Vec<_> = pass.states.iter().map(|state| state.pos.shallow_clone()).collect();
            let encoded = pass.positions.narrow(1, input, model.task.pred_steps as i64);
            terms.push(latent_error(&Tensor::stack(&rolled, 1), &encoded) * self.config.latent);
        }
        if self.config.velocity > 0.0 && model.options.refinement_steps > 0 {
            let estimate = model.velocity.forward(&pass.positions.narrow(1, 0, input).detach());
            terms.push(latent_error(&estimate, &pass.initial.vel) * self.config.velocity);
        }
        terms.into_iter().reduce(|sum, term| sum + term)
    }
}

impl GradientPhase for Joint<'_> {
    fn name(&self) -> &'static str {
        "join"
    }

    fn max_steps(&self) -> u64 {
        self.max_steps
    }

    fn loss(&mut self, model: &PhysicsNet, step: u64) -> Result<StepLoss> {
        let task = &model.task;
        let clips = self.train.batch(self.batches.clips_of_step(step), task.input_steps + task.pred_steps);
        let pass = model.forward(&clips)?;
        let losses = Losses::new(&pass, &clips, task);
        let mut total = losses.train(self.config.alpha);
        if let Some(latent) = self.latent_terms(model, &pass) {
            total += latent;
        }
        Ok(StepLoss { total, parts: vec![("recons_loss", losses.reconstruction), ("pred_loss", losses.prediction)] })
    }

    fn learning_rate(&self, step: u64, validations: &[f64], variable: &str) -> f64 {
        let physical = variable.contains("_cell.");
        let base = if physical { self.config.physics_learning_rate } else { self.config.learning_rate };
        if step >= self.anneal_start(validations) { base / self.config.anneal_factor } else { base }
    }

    fn validate_every(&self) -> u64 {
        self.config.validate_every
    }

    /// Done when as many steps have been taken at the divided rates as the schedule has at its end.
    fn finished(&self, step: u64, validations: &[f64]) -> bool {
        step >= self.anneal_start(validations) + (self.max_steps - self.anneal_from)
    }

    /// `L_pred + alpha L_rec` on the validation split.
    fn validate(&self, model: &PhysicsNet) -> Result<f64> {
        let scores = base::evaluate(model, self.valid, self.config.validation_clips, self.config.batch)?;
        Ok(scores.pred_loss + self.config.alpha * scores.recons_loss)
    }
}
