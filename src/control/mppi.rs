//! Model predictive path integral control: the next plan is the mean of all that were drawn, the better the heavier.

use super::environment::MAX_TORQUE;
use super::model::Model;
use super::reward::{PendulumState, Reward};
use super::search::{Planner, Search, SearchSettings};

/// By how much less a plan is worth that weighs a factor e less.
const TEMPERATURE: f64 = 0.1;
/// Spread of the torques about the plan, in the first and in the last iteration.
const SPREAD: [f64; 2] = [MAX_TORQUE, 0.25 * MAX_TORQUE];

/// The path integral planner.
#[derive(Debug)]
pub struct PathIntegral(Search);

impl PathIntegral {
    pub fn new(settings: SearchSettings) -> Self {
        PathIntegral(Search::new(settings))
    }
}

impl Planner for PathIntegral {
    fn begin(&mut self, seed: u64) {
        self.0.begin(seed);
    }

    fn plan(&mut self, model: &dyn Model, start: PendulumState, reward: Reward) -> Option<f64> {
        let search = &mut self.0;
        let SearchSettings { decisions, iterations, .. } = search.settings;
        for iteration in 0..iterations {
            let share = iteration as f64 / iterations.max(2).saturating_sub(1) as f64;
            let spread = vec![SPREAD[0] + share * (SPREAD[1] - SPREAD[0]); decisions];
            let Some(candidates) = search.draw(&spread, model, start, reward) else { return search.give_up() };
            let best = candidates.returns.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let weights: Vec<f64> =
                candidates.returns.iter().map(|worth| ((worth - best) / TEMPERATURE).exp()).collect();
            let whole: f64 = weights.iter().sum();
            search.mean.fill(0.0);
            for (plan, weight) in candidates.torques.chunks_exact(decisions).zip(&weights) {
                for (mean, torque) in search.mean.iter_mut().zip(plan) {
                    *mean += weight / whole * f64::from(*torque);
                }
            }
        }
        Some(search.decide())
    }
}
