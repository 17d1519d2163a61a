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
    fn timetable(&self) -> &Timetable<'_>;

    fn loss(&mut self, model: &PhysicsNet, step: u64) -> Result<StepLoss>;

    /// The rate of a group of variables before annealing.
    fn learning_rate(&self, group: VariableGroup) -> f64;

    /// The score (lower is better) by which the phase ends and the best weights are told; `scores` are the model's losses
    /// on the validation split.
    fn score(&self, model: &PhysicsNet, scores: &MeanLosses) -> f64;
}
