//! What the planners share: a mean plan that moves on with time, candidates drawn around it, and what they are worth.

use rand_chacha::ChaCha8Rng;

use super::model::{PlanStart, PlanningModel};
use super::plans::{Plans, Trajectories};
use paig::support::random::{fill_normal, named_generator};

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
    /// The largest action, to either side.
    pub largest: f64,
}

impl Default for SearchSettings {
    fn default() -> Self {
        SearchSettings { candidates: 1000, iterations: 10, decisions: 12, hold: 2, largest: 2.0 }
    }
}

/// A planner that looks for the actions of the next decisions.
pub trait Planner {
    /// Forgets the last plan, and draws from this seed from now on.
    fn begin(&mut self, seed: u64);

    /// The action to hold now, within the limits. None where the model foretells no plan a finite return; the next call
    /// then begins without a plan.
    fn plan(&mut self, model: &mut dyn PlanningModel, outset: PlanStart) -> Option<f64>;

    /// The decisions that the last plan made, the one to hold now first; `[decisions]`.
    fn planned(&self) -> &[f32];
}

/// A search on its way. All room is kept from one decision to the next.
#[derive(Debug)]
pub(super) struct Search {
    pub settings: SearchSettings,
    /// The plan that candidates are drawn around, and how widely, `[decisions]`.
    pub mean: Vec<f32>,
    pub spread: Vec<f32>,
    /// `[decisions, candidates]`
    pub actions: Vec<f32>,
    /// `[candidates]`; minus infinity where there is no finite number.
    pub returns: Vec<f32>,
    /// The last plan.
    pub planned: Vec<f32>,
    trajectories: Trajectories,
    random: ChaCha8Rng,
}

impl Search {
    pub fn new(settings: SearchSettings) -> Self {
        let SearchSettings { candidates, decisions, .. } = settings;
        Search {
            settings,
            mean: vec![0.0; decisions],
            spread: vec![0.0; decisions],
            actions: vec![0.0; decisions * candidates],
            returns: vec![0.0; candidates],
            planned: vec![0.0; decisions],
            trajectories: Trajectories::default(),
            random: named_generator(0, "plans"),
        }
    }

    pub fn begin(&mut self, seed: u64) {
        self.mean.fill(0.0);
        self.planned.fill(0.0);
        self.random = named_generator(seed, "plans");
    }

    /// Draws candidates around the mean plan, and tries them. The first is the mean itself. False if not one has a finite
    /// return.
    pub fn draw(&mut self, model: &mut dyn PlanningModel, outset: PlanStart) -> bool {
        let SearchSettings { candidates, hold, largest, .. } = self.settings;
        let largest = largest as f32;
        for ((actions, mean), spread) in self.actions.chunks_exact_mut(candidates).zip(&self.mean).zip(&self.spread) {
            fill_normal(&mut self.random, &mut actions[1..]);
            actions[0] = 0.0;
            actions.iter_mut().for_each(|action| *action = (mean + spread * *action).clamp(-largest, largest));
        }
        let plans = Plans { actions: &self.actions, candidates, hold };
        if model.returns(outset, &plans, &mut self.trajectories, &mut self.returns).is_err() {
            return false;
        }
        self.returns.iter_mut().filter(|worth| !worth.is_finite()).for_each(|worth| *worth = f32::NEG_INFINITY);
        self.returns.iter().any(|worth| worth.is_finite())
    }

    /// The action to hold now; what is left of the plan is where the next search begins.
    pub fn decide(&mut self) -> f64 {
        self.planned.copy_from_slice(&self.mean);
        self.mean.rotate_left(1);
        self.mean.last_mut().into_iter().for_each(|last| *last = 0.0);
        f64::from(self.planned[0])
    }

    /// What is said where there is no plan.
    pub fn give_up(&mut self) -> Option<f64> {
        self.mean.fill(0.0);
        self.planned.fill(0.0);
        None
    }
}
