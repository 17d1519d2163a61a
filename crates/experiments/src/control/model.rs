//! What a planner tries its plans on.
//!
//! Anything that foretells can be a [`PlanningModel`]: an equation in plain numbers ([`PlainModel`]), any cell on tensors
//! ([`CellModel`]), a [black box](super::learned) that was learned, or one that foretells nothing but
//! [rewards](super::latent).

use std::ops::Deref;

use anyhow::Result;
use tch::{Kind, Tensor};

use super::plans::{Plans, Trajectories};
use super::reward::Reward;
use super::state::ControlState;
use paig::network::cells::plain::PlainCell;
use paig::network::cells::{Actions, Cell, State};

/// Where a plan begins.
#[derive(Debug, Clone, Copy)]
pub struct PlanStart<'a> {
    pub state: &'a ControlState,
    /// The step of the episode that comes next.
    pub step: usize,
    pub reward: &'a Reward,
}

/// A world that can be tried.
pub trait PlanningModel {
    /// Writes where each of the plans leads from one state.
    ///
    /// # Errors
    /// A model that does not foretell one state for each candidate.
    fn roll_out(&mut self, start: &ControlState, plans: &Plans, into: &mut Trajectories) -> Result<()>;

    /// Where a single sequence of actions leads, one action for each step.
    ///
    /// # Errors
    /// As [`Self::roll_out`].
    fn follow(&mut self, start: &ControlState, actions: &[f32]) -> Result<Vec<ControlState>> {
        let mut trajectories = Trajectories::default();
        if actions.is_empty() {
            return Ok(Vec::new());
        }
        self.roll_out(start, &Plans { actions, candidates: 1, hold: 1 }, &mut trajectories)?;
        Ok(trajectories.of(0))
    }

    /// What plans are worth, `[candidates]`; `room` is for where they lead. Not a number where they lead to none.
    ///
    /// # Errors
    /// As [`Self::roll_out`].
    fn returns(
        &mut self,
        outset: PlanStart,
        plans: &Plans,
        room: &mut Trajectories,
        returns: &mut [f32],
    ) -> Result<()> {
        self.roll_out(outset.state, plans, room)?;
        outset.reward.returns(outset.step, outset.state, plans, room, returns);
        Ok(())
    }
}

/// An equation in plain numbers. Nothing is allocated once there is room for the candidates.
#[derive(Debug)]
pub struct PlainModel {
    pub cell: Box<dyn PlainCell>,
    /// Time units of a step.
    pub dt: f64,
}

impl PlanningModel for PlainModel {
    fn roll_out(&mut self, start: &ControlState, plans: &Plans, into: &mut Trajectories) -> Result<()> {
        into.make_room(plans.candidates, start.coordinates(), plans.steps());
        for step in 0..plans.steps() {
            into.go_on(step, start);
            let [positions, velocities] = into.step_mut(step);
            self.cell.step(positions, velocities, plans.at(step), self.dt as f32);
        }
        Ok(())
    }
}

/// Any cell that something acts on, all candidates in one batch of tensors.
#[derive(Debug)]
pub struct CellModel<C> {
    pub cell: C,
    /// Time units between two frames: the task's own, which the cell was learned with.
    pub dt: f64,
}

impl<C: Deref<Target = dyn Cell>> PlanningModel for CellModel<C> {
    fn roll_out(&mut self, start: &ControlState, plans: &Plans, into: &mut Trajectories) -> Result<()> {
        let _guard = tch::no_grad_guard();
        let (candidates, steps, coordinates) = (plans.candidates as i64, plans.steps(), start.coordinates() as i64);
        let rows = |numbers: &[f64]| row(numbers).expand([candidates, coordinates], false);
        let initial = State { pos: rows(&start.positions), vel: rows(&start.velocities) };
        let actions = Tensor::from_slice(plans.actions).reshape([-1, candidates]).transpose(0, 1);
        let actions = Actions::new(Some(actions.repeat_interleave_self_int(plans.hold as i64, 1, None)));
        let states = self.cell.roll_out(&initial, &actions, self.dt, steps);
        into.make_room(plans.candidates, start.coordinates(), steps);
        states.iter().enumerate().try_for_each(|(step, state)| into.write(step, state))
    }
}

/// Numbers as a tensor, float32.
pub(super) fn row(numbers: &[f64]) -> Tensor {
    Tensor::from_slice(numbers).to_kind(Kind::Float)
}

/// A cell with its parameters as they are now: in plain numbers where it has that form, which takes a fraction of the
/// time.
pub fn of_cell<'a, C: Deref<Target = dyn Cell> + 'a>(cell: C, dt: f64) -> Box<dyn PlanningModel + 'a> {
    match cell.plain() {
        Some(plain) => Box::new(PlainModel { cell: plain, dt }),
        None => Box::new(CellModel { cell, dt }),
    }
}
