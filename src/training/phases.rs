//! Recipes: the phases of a training and their order.
//!
//! The original trains everything together from the first step (`join` alone, the `paper` recipe). The `fast` recipe
//! finds the objects first, then the parameters, then joins.

use anyhow::Result;
use tch::Tensor;

use super::schedule::Timetable;
use crate::network::physics_models::PhysicsNet;
use crate::network::physics_models::losses::MeanLosses;
use crate::training::config::Config;

/// The phases, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    Discover,
    Identify,
    Join,
}

/// The phases a config asks for.
pub fn phases(config: &Config) -> Vec<Phase> {
    let mut phases = Vec::new();
    if config.discover.is_some() {
        phases.push(Phase::Discover);
    }
    if config.identify.is_some() {
        phases.push(Phase::Identify);
    }
    phases.push(Phase::Join);
    phases
}

/// The loss of one step: what is differentiated, and its parts by name for the log.
#[derive(Debug)]
pub struct StepLoss {
    pub total: Tensor,
    pub parts: Vec<(&'static str, Tensor)>,
}

/// A phase that descends a loss. A step is a function of the model, the step's number and the scores so far.
pub trait GradientPhase {
    fn name(&self) -> &'static str;

    /// Called before the first step, not on resuming: sets initial values.
    fn begin(&mut self, _model: &PhysicsNet) -> Result<()> {
        Ok(())
    }

    /// When rates fall and the phase ends.
    fn timetable(&self) -> &Timetable<'_>;

    fn loss(&mut self, model: &PhysicsNet, step: u64) -> Result<StepLoss>;

    /// The rate of a variable before annealing.
    fn learning_rate(&self, variable: &str) -> f64;

    /// The score (lower is better) by which the phase ends and the best checkpoint is chosen; `scores` are the model's losses
    /// on the validation split.
    fn score(&self, model: &PhysicsNet, scores: &MeanLosses) -> f64;
}
