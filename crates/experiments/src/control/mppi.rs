//! Model predictive path integral control: the next plan is the mean of all that were drawn, the better the heavier.

use super::model::{PlanStart, PlanningModel};
use super::planner::{Planner, Search, SearchSettings};

/// By how much less a plan is worth that weighs a factor e less.
const TEMPERATURE: f32 = 0.1;
/// Spread of the actions about the plan, in the first and in the last iteration, as a share of the largest action.
const SPREAD: [f64; 2] = [1.0, 0.25];

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

    fn plan(&mut self, model: &mut dyn PlanningModel, outset: PlanStart) -> Option<f64> {
        let search = &mut self.0;
        let SearchSettings { candidates, iterations, largest, .. } = search.settings;
        for iteration in 0..iterations {
            let share = iteration as f64 / iterations.max(2).saturating_sub(1) as f64;
            search.spread.fill((largest * (SPREAD[0] + share * (SPREAD[1] - SPREAD[0]))) as f32);
            if !search.draw(model, outset) {
                return search.give_up();
            }
            let best = search.returns.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            // Returns become weights; the next draw replaces them.
            search.returns.iter_mut().for_each(|worth| *worth = ((*worth - best) / TEMPERATURE).exp());
            let whole: f32 = search.returns.iter().sum();
            for (actions, mean) in search.actions.chunks_exact(candidates).zip(&mut search.mean) {
                let weighted = actions.iter().zip(&search.returns).map(|(action, weight)| action * weight);
                *mean = weighted.sum::<f32>() / whole;
            }
        }
        Some(search.decide())
    }

    fn planned(&self) -> &[f32] {
        &self.0.planned
    }
}
