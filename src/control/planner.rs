//! The cross-entropy method: plans are drawn, and the next ones are drawn as the best of them were spread.

use super::environment::MAX_TORQUE;
use super::model::Model;
use super::reward::{PendulumState, Reward};
use super::search::{Candidates, Planner, Search, SearchSettings};

/// Of the plans tried, those that the next draw's mean and spread are measured in: 100 of 1000.
const ELITE_SHARE: f64 = 0.1;

/// The cross-entropy planner.
#[derive(Debug)]
pub struct CrossEntropy(Search);

impl CrossEntropy {
    pub fn new(settings: SearchSettings) -> Self {
        CrossEntropy(Search::new(settings))
    }
}

impl Planner for CrossEntropy {
    fn begin(&mut self, seed: u64) {
        self.0.begin(seed);
    }

    fn plan(&mut self, model: &dyn Model, start: PendulumState, reward: Reward) -> Option<f64> {
        let search = &mut self.0;
        // Wide again: what is left of the last plan is only where the search begins.
        let mut spread = vec![MAX_TORQUE; search.settings.decisions];
        for _ in 0..search.settings.iterations {
            let Some(candidates) = search.draw(&spread, model, start, reward) else { return search.give_up() };
            let elites = elites(&candidates);
            let (decisions, count) = (search.settings.decisions, elites.len() as f64);
            for (decision, (mean, spread)) in search.mean.iter_mut().zip(&mut spread).enumerate() {
                let torque = |plan: &usize| f64::from(candidates.torques[plan * decisions + decision]);
                *mean = elites.iter().map(torque).sum::<f64>() / count;
                let variance = elites.iter().map(|plan| (torque(plan) - *mean).powi(2)).sum::<f64>() / count;
                *spread = variance.sqrt();
            }
        }
        Some(search.decide())
    }
}

/// The best plans by their places, at most a tenth and at least one; none without a finite return.
fn elites(candidates: &Candidates) -> Vec<usize> {
    let returns = &candidates.returns;
    let mut places: Vec<usize> = (0..returns.len()).filter(|place| returns[*place].is_finite()).collect();
    // A stable order: equal returns stand by their places, so that a seed says what is planned.
    places.sort_by(|a, b| returns[*b].total_cmp(&returns[*a]));
    places.truncate(((returns.len() as f64 * ELITE_SHARE) as usize).max(1));
    places
}
