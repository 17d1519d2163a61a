//! Phase 3, join: encoder, physics and decoder trained together, `L_pred + alpha L_rec`.
//!
//! With `latent` and `velocity` at 0 and no refinement this is the original's whole training (paper: section 3.4). The
//! two extra terms pull the roll-out to the encoded (detached) positions and the velocity estimator to the refined
//! velocities.

use anyhow::Result;
use tch::Tensor;

use super::phases::{GradientPhase, StepLoss};
use super::schedule::Timetable;
use crate::datasets::iterators::{Clips, ShuffledBatches};
use crate::network::physics_models::losses::{Losses, MeanLosses, latent_error};
use crate::network::physics_models::{ForwardPass, PhysicsNet};
use crate::training::config::Join;

/// The phase's state between steps.
#[derive(Debug)]
pub struct Joint<'a> {
    config: &'a Join,
    train: &'a Clips,
    batches: ShuffledBatches,
    timetable: Timetable<'a>,
}

impl<'a> Joint<'a> {
    /// # Errors
    /// A training split smaller than a batch.
    pub fn new(config: &'a Join, train: &'a Clips, seed: u64) -> Result<Self> {
        let batches = ShuffledBatches::new(train.len(), config.batch, seed)?;
        let timetable = match (config.max_steps, config.epochs) {
            (Some(steps), _) => Timetable::new(&config.schedule, steps, 1, 0),
            (None, epochs) => Timetable::new(&config.schedule, epochs.unwrap_or(0), batches.steps_per_epoch(), 0),
        };
        Ok(Joint { config, train, batches, timetable })
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

    fn timetable(&self) -> &Timetable<'_> {
        &self.timetable
    }

    fn loss(&mut self, model: &PhysicsNet, step: u64) -> Result<StepLoss> {
        let task = &model.task;
        let chosen = self.batches.clips_of_step(step);
        let clips = self.train.batch(chosen, task.input_steps + task.pred_steps);
        let pass = model.forward(&clips, &self.train.actions(chosen))?;
        let losses = Losses::new(&pass, &clips, task);
        let mut total = losses.train(self.config.alpha);
        if let Some(latent) = self.latent_terms(model, &pass) {
            total += latent;
        }
        Ok(StepLoss { total, parts: vec![("recons_loss", losses.reconstruction), ("pred_loss", losses.prediction)] })
    }

    fn learning_rate(&self, variable: &str) -> f64 {
        let physical = variable.contains("_cell.");
        if physical { self.config.physics_learning_rate } else { self.config.learning_rate }
    }

    /// `L_pred + alpha L_rec` on the validation split.
    fn score(&self, _model: &PhysicsNet, scores: &MeanLosses) -> f64 {
        scores.pred_loss + self.config.alpha * scores.recons_loss
    }
}
