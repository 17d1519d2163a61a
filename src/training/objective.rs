//! A loss that a phase descends.

use anyhow::Result;
use tch::Tensor;

use super::schedule::Timetable;
use crate::network::physics_models::losses::MeanLosses;
use crate::network::physics_models::{PhysicsNet, VariableGroup};

/// The loss of one step: what is differentiated, and its parts by name for the log.
#[derive(Debug)]
pub struct StepLoss {
    pub total: Tensor,
    pub reconstruction: Option<Tensor>,
    pub prediction: Option<Tensor>,
}

/// A loss that a phase descends. A step is a function of the model, the step's number and the scores so far.
pub trait Objective {
    /// When rates fall and the phase ends.
    fn timetable(&self) -> &Timetable;

    fn loss(&mut self, model: &PhysicsNet, step: u64, validations: &[f64]) -> Result<StepLoss>;

    /// The rate of a group of variables before annealing.
    fn learning_rate(&self, group: VariableGroup) -> f64;

    /// Whether the phase ends with the weights of its best validation, and not with its last ones.
    fn ends_at_best(&self) -> bool {
        false
    }

    /// Validates the model; `losses` computes all of its losses on the validation split.
    ///
    /// # Errors
    /// Those of `losses`.
    fn validate(&self, model: &PhysicsNet, losses: &dyn Fn() -> Result<MeanLosses>) -> Result<Validated>;

    /// An early fit after a validation, by all scores so far: a line on it, if there was one.
    ///
    /// # Errors
    /// Those of what it does.
    fn after_validation(&mut self, _model: &PhysicsNet, _validations: &[f64]) -> Result<Option<String>> {
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
