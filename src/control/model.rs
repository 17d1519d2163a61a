//! What a planner tries its plans on, and a learned cell as such a model.

use anyhow::{Context, Result, ensure};
use tch::Tensor;

use super::reward::{PendulumState, Reward};
use crate::network::cells::{Actions, Cell, State};

/// Torques of some candidates, and for how many steps each is held.
#[derive(Debug, Clone, Copy)]
pub struct Plans<'a> {
    /// `[candidates, decisions]`, row by row.
    pub torques: &'a [f32],
    pub decisions: usize,
    pub hold: usize,
}

impl Plans<'_> {
    pub fn candidates(&self) -> usize {
        self.torques.len() / self.decisions
    }

    /// Steps of a plan.
    pub fn steps(&self) -> usize {
        self.decisions * self.hold
    }
}

/// Where plans lead: the states after each step.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectories {
    /// `[candidates, steps]`, row by row; radians.
    pub angles: Vec<f32>,
    /// The same, radians per time unit.
    pub rates: Vec<f32>,
}

impl Trajectories {
    /// What each plan is worth from `start` on, `[candidates]`; not a number where the trajectory is none.
    pub fn returns(&self, start: PendulumState, plans: &Plans, reward: Reward) -> Vec<f64> {
        let steps = plans.steps();
        let rows = self.angles.chunks_exact(steps).zip(self.rates.chunks_exact(steps));
        rows.zip(plans.torques.chunks_exact(plans.decisions))
            .map(|((angles, rates), torques)| {
                let mut before = start;
                let mut total = 0.0;
                for (step, (angle, rate)) in angles.iter().zip(rates).enumerate() {
                    let after = PendulumState { angle: f64::from(*angle), rate: f64::from(*rate) };
                    total += reward.of(before, f64::from(torques[step / plans.hold]), after);
                    before = after;
                }
                total
            })
            .collect()
    }
}

/// A pendulum that can be tried.
pub trait Model {
    /// Where each of the plans leads from one state.
    ///
    /// # Errors
    /// A model that does not roll out one angle for each candidate.
    fn roll_out(&self, start: PendulumState, plans: &Plans) -> Result<Trajectories>;
}

/// Any learned cell of one angle that is driven from outside, all candidates in one batch.
#[derive(Debug)]
pub struct CellModel<'a> {
    pub cell: &'a dyn Cell,
    /// Time units between two frames: the task's own, which the cell was learned with.
    pub dt: f64,
}

impl Model for CellModel<'_> {
    fn roll_out(&self, start: PendulumState, plans: &Plans) -> Result<Trajectories> {
        let _guard = tch::no_grad_guard();
        let (candidates, steps) = (plans.candidates() as i64, plans.steps());
        let column = |value: f64| Tensor::from_slice(&[value as f32]).expand([candidates, 1], false);
        let initial = State { pos: column(start.angle), vel: column(start.rate) };
        let torques = Tensor::from_slice(plans.torques).reshape([candidates, plans.decisions as i64]);
        let actions = Actions::new(Some(torques.repeat_interleave_self_int(plans.hold as i64, 1, None)));
        let states = self.cell.roll_out(&initial, &actions, self.dt, steps);
        let rows = |part: fn(&State) -> &Tensor| -> Result<Vec<f32>> {
            let columns: Vec<_> = states.iter().map(part).collect();
            let rows = Tensor::cat(&columns, 1);
            ensure!(rows.size() == [candidates, steps as i64], "the equation does not move one angle");
            Vec::try_from(rows.flatten(0, 1)).context("the states of plans")
        };
        Ok(Trajectories { angles: rows(|state| &state.pos)?, rates: rows(|state| &state.vel)? })
    }
}
