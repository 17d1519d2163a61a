//! Recipes: the phases of a training and their order.
//!
//! The original trains everything together from the first step (`join` alone, the `paper` recipe). The `fast` recipe
//! finds the objects first, then the parameters, then joins; each phase can be switched off in the config.

pub mod anchors;
pub mod discover;
pub mod guide;
pub mod identify;
pub mod join;
pub mod recentre;

use anyhow::Result;
use tch::Tensor;

use crate::config::Config;
use crate::physics_models::PhysicsNet;

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

/// The first validation (as an index) at which the best of the last `patience` scores is less than a share of `plateau`
/// below the best before them.
fn plateau_at(validations: &[f64], patience: usize, plateau: f64) -> Option<usize> {
    let least = |values: &[f64]| values.iter().copied().fold(f64::INFINITY, f64::min);
    (patience + 1..=validations.len()).map(|seen| &validations[..seen]).find_map(|seen| {
        let (before, recent) = seen.split_at(seen.len() - patience);
        (least(recent) > (1.0 - plateau) * least(before)).then_some(seen.len() - 1)
    })
}

/// A phase that descends a loss. A step is a function of the model, the step's number and the scores so far.
pub trait GradientPhase {
    fn name(&self) -> &'static str;

    /// Called before the first step, not on resuming: sets initial values.
    fn begin(&mut self, _model: &PhysicsNet) -> Result<()> {
        Ok(())
    }

    fn max_steps(&self) -> u64;

    fn loss(&mut self, model: &PhysicsNet, step: u64) -> Result<StepLoss>;

    /// The rate of a variable at a step, given all validation scores of the phase so far.
    fn learning_rate(&self, step: u64, validations: &[f64], variable: &str) -> f64;

    fn validate_every(&self) -> u64;

    /// The score (lower is better) by which the phase ends and the best checkpoint is chosen.
    fn validate(&self, model: &PhysicsNet) -> Result<f64>;

    /// Whether the phase is over before its last step, given all its validation scores so far.
    fn finished(&self, _step: u64, _validations: &[f64]) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::plateau_at;

    #[test]
    fn a_plateau_is_where_the_recent_scores_stopped_falling() {
        let falling = [8.0, 4.0, 2.0, 1.0, 0.5];
        assert_eq!(plateau_at(&falling, 2, 0.1), None);
        let standing = [8.0, 4.0, 2.0, 1.95, 1.9, 1.0];
        // At index 4 the best of two, 1.9, is within 10 % of the best before, 2.0.
        assert_eq!(plateau_at(&standing, 2, 0.1), Some(4));
        assert_eq!(plateau_at(&standing, 2, 0.01), None);
        assert_eq!(plateau_at(&[1.0, 1.0], 2, 0.1), None);
    }
}
