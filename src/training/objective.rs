//! A loss that a phase descends.

use anyhow::Result;
use tch::Tensor;

use super::schedule::Timetable;
use super::trained::Trainable;
use crate::network::physics_models::PhysicsNet;
use crate::network::physics_models::losses::MeanLosses;

/// The loss of one step: what is differentiated, and its parts by name for the log.
#[derive(Debug)]
pub struct StepLoss {
    pub total: Tensor,
    pub reconstruction: Option<Tensor>,
    pub prediction: Option<Tensor>,
}

impl StepLoss {
    /// Without the way back to what they are computed from.
    pub(super) fn detached(&self) -> Self {
        let parts = [&self.reconstruction, &self.prediction].map(|part| part.as_ref().map(Tensor::detach));
        let [reconstruction, prediction] = parts;
        StepLoss { total: self.total.detach(), reconstruction, prediction }
    }
}

/// A loss that a phase descends. A step is a function of the model, the step's number and the scores so far.
pub trait Objective<M: Trainable = PhysicsNet> {
    /// When rates fall and the phase ends.
    fn timetable(&self) -> &Timetable;

    /// What is new in a step, on the model's device: frames, and what else was chosen or found for them.
    ///
    /// # Errors
    /// Data that do not suffice.
    fn inputs(&mut self, model: &M, step: u64, validations: &[f64]) -> Result<Vec<Tensor>>;

    /// The loss of these inputs, which depends on nothing else but the model's variables. On a GPU it is recorded and repeated
    /// as long as the inputs keep their sizes: it must not look at a number.
    ///
    /// # Errors
    /// Clips that are too short.
    fn loss(&self, model: &M, inputs: &[Tensor]) -> Result<StepLoss>;

    /// The rate of a group of variables before annealing.
    fn learning_rate(&self, group: M::Group) -> f64;

    /// Whether the phase ends with the weights of its best validation, and not with its last ones.
    fn ends_at_best(&self) -> bool {
        false
    }

    /// Validates the model; `losses` computes all of its losses on the validation split.
    ///
    /// # Errors
    /// Those of `losses`.
    fn validate(&self, model: &M, losses: &dyn Fn() -> Result<MeanLosses>) -> Result<Validated>;

    /// An early fit after a validation, by all scores so far: a line on it, if there was one.
    ///
    /// # Errors
    /// Those of what it does.
    fn after_validation(&mut self, _model: &M, _validations: &[f64]) -> Result<Option<String>> {
        Ok(None)
    }
}

/// What a validation found.
#[derive(Debug)]
pub struct Validated {
    /// Lower is better: by it the phase ends and the best weights are told.
    pub score: f64,
    /// On the validation split, as far as the phase asks for them.
    pub recons_loss: Option<f64>,
    pub pred_loss: Option<f64>,
    pub extrap_loss: Option<f64>,
}

impl Validated {
    /// With all losses.
    pub fn new(score: f64, losses: &MeanLosses) -> Self {
        let MeanLosses { recons_loss, pred_loss, extrap_loss } = *losses;
        Validated { score, recons_loss: Some(recons_loss), pred_loss: Some(pred_loss), extrap_loss }
    }
}
