//! What the planners share: a mean plan that moves on with time, candidates drawn around it, and what they are worth.

use rand_chacha::ChaCha8Rng;

use super::environment::MAX_TORQUE;
use super::model::{Model, Plans};
use super::reward::{PendulumState, Reward};
use crate::support::random::{named_generator, normal};

/// How wide and how far a planner looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchSettings {
    /// Plans tried in an iteration.
    pub candidates: usize,
    pub iterations: usize,
    /// Decisions of a plan.
    pub decisions: usize,
    /// Steps for which each is held.
    pub hold: usize,
}

impl Default for SearchSettings {
    fn default() -> Self {
        SearchSettings { candidates: 1000, iterations: 10, decisions: 12, hold: 2 }
    }
}

/// A planner that looks for the torques of the next decisions.
pub trait Planner {
    /// Forgets the last plan, and draws from this seed from now on.
    fn begin(&mut self, seed: u64);

    /// The torque to hold now, within the limits. None where the model foretells no plan a finite return; the next call
    /// then begins without a plan.
    fn plan(&mut self, model: &dyn Model, start: PendulumState, reward: Reward) -> Option<f64>;
}

/// Some plans and what each is worth.
#[derive(Debug, Default)]
pub(super) struct Candidates {
    /// `[candidates, decisions]`
    pub torques: Vec<f32>,
    /// `[candidates]`; minus infinity where there is no finite number.
    pub returns: Vec<f64>,
}

/// A search on its way.
#[derive(Debug)]
pub(super) struct Search {
    pub settings: SearchSettings,
    /// The plan that candidates are drawn around, `[decisions]`.
    pub mean: Vec<f64>,
    random: ChaCha8Rng,
}

impl Search {
    pub fn new(settings: SearchSettings) -> Self {
        Search { settings, mean: vec![0.0; settings.decisions], random: named_generator(0, "plans") }
    }

    pub fn begin(&mut self, seed: u64) {
        self.mean.fill(0.0);
        self.random = named_generator(seed, "plans");
    }

    /// Draws candidates around the mean plan with a spread for each decision, and tries them. The first is the mean
    /// itself. None if not one has a finite return.
    pub fn draw(
        &mut self,
        spread: &[f64],
        model: &dyn Model,
        start: PendulumState,
        reward: Reward,
    ) -> Option<Candidates> {
        let SearchSettings { candidates, decisions, hold, .. } = self.settings;
        let mut torques = Vec::with_capacity(candidates * decisions);
        torques.extend(self.mean.iter().map(|mean| *mean as f32));
        for _ in 1..candidates {
            for (mean, spread) in self.mean.iter().zip(spread) {
                let torque = mean + spread * normal(&mut self.random);
                torques.push(torque.clamp(-MAX_TORQUE, MAX_TORQUE) as f32);
            }
        }
        let plans = Plans { torques: &torques, decisions, hold };
        let trajectories = model.roll_out(start, &plans).ok()?;
        let mut returns = trajectories.returns(start, &plans, reward);
        returns.iter_mut().filter(|worth| !worth.is_finite()).for_each(|worth| *worth = f64::NEG_INFINITY);
        returns.iter().any(|worth| worth.is_finite()).then_some(Candidates { torques, returns })
    }

    /// The torque to hold now; what is left of the plan is where the next search begins.
    pub fn decide(&mut self) -> f64 {
        let now = self.mean.remove(0);
        self.mean.push(0.0);
        now
    }

    /// What is said where there is no plan.
    pub fn give_up(&mut self) -> Option<f64> {
        self.mean.fill(0.0);
        None
    }
}
