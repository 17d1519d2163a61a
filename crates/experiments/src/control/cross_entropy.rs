//! The cross-entropy method: plans are drawn, and the next ones are drawn as the best of them were spread.

use super::model::{PlanStart, PlanningModel};
use super::planner::{Planner, Search, SearchSettings};

/// Of the plans tried, those that the next draw's mean and spread are measured in: 100 of 1000.
const ELITE_SHARE: f64 = 0.1;

/// The cross-entropy planner.
#[derive(Debug)]
pub struct CrossEntropy {
    search: Search,
    /// Room for the candidates' places.
    places: Vec<usize>,
}

impl CrossEntropy {
    pub fn new(settings: SearchSettings) -> Self {
        CrossEntropy { search: Search::new(settings), places: Vec::with_capacity(settings.candidates) }
    }

    /// The plans that the next ones are drawn like.
    fn measure_elites(&mut self) {
        let Search { settings, mean, spread, actions, returns, .. } = &mut self.search;
        let elites = elites(returns, &mut self.places);
        let count = elites.len() as f32;
        for ((actions, mean), spread) in actions.chunks_exact(settings.candidates).zip(mean).zip(spread) {
            *mean = elites.iter().map(|place| actions[*place]).sum::<f32>() / count;
            let variance = elites.iter().map(|place| (actions[*place] - *mean).powi(2)).sum::<f32>() / count;
            *spread = variance.sqrt();
        }
    }
}

impl Planner for CrossEntropy {
    fn begin(&mut self, seed: u64) {
        self.search.begin(seed);
    }

    fn plan(&mut self, model: &mut dyn PlanningModel, outset: PlanStart) -> Option<f64> {
        // Wide again: what is left of the last plan is only where the search begins.
        let widest = self.search.settings.largest as f32;
        self.search.spread.fill(widest);
        for _ in 0..self.search.settings.iterations {
            if !self.search.draw(model, outset) {
                return self.search.give_up();
            }
            self.measure_elites();
        }
        Some(self.search.decide())
    }

    fn planned(&self) -> &[f32] {
        &self.search.planned
    }
}

/// The best plans by their places, at most a tenth and at least one, in no order; none without a finite return. `places`
/// is room for them.
fn elites<'a>(returns: &[f32], places: &'a mut Vec<usize>) -> &'a [usize] {
    places.clear();
    places.extend((0..returns.len()).filter(|place| returns[*place].is_finite()));
    let count = ((returns.len() as f64 * ELITE_SHARE) as usize).max(1);
    if count < places.len() {
        // Equal returns stand by their places, so that a seed says what is planned.
        places.select_nth_unstable_by(count, |a, b| returns[*b].total_cmp(&returns[*a]).then(a.cmp(b)));
        places.truncate(count);
    }
    places
}
