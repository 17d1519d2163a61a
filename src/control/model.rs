//! What a planner tries its plans on.
//!
//! Anything that foretells can be a [`Model`]: an equation in plain numbers ([`PlainModel`]), any cell on tensors
//! ([`CellModel`]), or a black box that was learned.

use std::ops::{Deref, Range};

use anyhow::{Context, Result, ensure};
use tch::Tensor;

use super::state::ControlState;
use crate::network::cells::plain::PlainCell;
use crate::network::cells::{Actions, Cell, State};

/// Actions of some candidates, and for how many steps each is held.
#[derive(Debug, Clone, Copy)]
pub struct Plans<'a> {
    /// `[decisions, candidates]`: those of all candidates side by side.
    pub actions: &'a [f32],
    pub candidates: usize,
    pub hold: usize,
}

impl<'a> Plans<'a> {
    pub fn decisions(&self) -> usize {
        self.actions.len() / self.candidates
    }

    /// Steps of a plan.
    pub fn steps(&self) -> usize {
        self.decisions() * self.hold
    }

    /// What acts in a step, `[candidates]`.
    pub fn at(&self, step: usize) -> &'a [f32] {
        &self.actions[step / self.hold * self.candidates..][..self.candidates]
    }
}

/// Where plans lead: the states after each step. The room is kept from one use to the next.
#[derive(Debug, Clone, Default)]
pub struct Trajectories {
    candidates: usize,
    coordinates: usize,
    /// `[steps, coordinates, candidates]`.
    positions: Vec<f32>,
    velocities: Vec<f32>,
}

impl Trajectories {
    /// Makes room for so much; what was in it means nothing any more.
    pub fn make_room(&mut self, candidates: usize, coordinates: usize, steps: usize) {
        (self.candidates, self.coordinates) = (candidates, coordinates);
        self.positions.resize(candidates * coordinates * steps, 0.0);
        self.velocities.resize(candidates * coordinates * steps, 0.0);
    }

    fn place(&self, step: usize, coordinate: usize) -> Range<usize> {
        let first = (step * self.coordinates + coordinate) * self.candidates;
        first..first + self.candidates
    }

    /// A coordinate after a step, `[candidates]`: radians or pixels.
    pub fn position(&self, step: usize, coordinate: usize) -> &[f32] {
        &self.positions[self.place(step, coordinate)]
    }

    /// Its velocity, per time unit.
    pub fn velocity(&self, step: usize, coordinate: usize) -> &[f32] {
        &self.velocities[self.place(step, coordinate)]
    }

    /// To be written: positions and velocities after a step, `[coordinates, candidates]` each.
    pub fn step_mut(&mut self, step: usize) -> [&mut [f32]; 2] {
        let size = self.coordinates * self.candidates;
        [&mut self.positions, &mut self.velocities].map(|all| &mut all[step * size..][..size])
    }

    /// Begins a step as the last one ended, or at the start.
    fn go_on(&mut self, step: usize, start: &ControlState) {
        let size = self.coordinates * self.candidates;
        for (all, start) in [(&mut self.positions, &start.positions), (&mut self.velocities, &start.velocities)] {
            if step > 0 {
                all.copy_within((step - 1) * size..step * size, step * size);
                continue;
            }
            for (column, start) in all.chunks_exact_mut(self.candidates).zip(start) {
                column.fill(*start as f32);
            }
        }
    }

    /// The states that a candidate goes through.
    pub fn of(&self, candidate: usize) -> Vec<ControlState> {
        let size = (self.coordinates * self.candidates).max(1);
        let coordinate = |all: &[f32], step: usize| -> Vec<f64> {
            let column = |axis: usize| f64::from(all[step * size + axis * self.candidates + candidate]);
            (0..self.coordinates).map(column).collect()
        };
        let state = |step| ControlState {
            positions: coordinate(&self.positions, step),
            velocities: coordinate(&self.velocities, step),
        };
        (0..self.positions.len() / size).map(state).collect()
    }
}

/// A world that can be tried.
pub trait Model {
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
}

/// An equation in plain numbers. Nothing is allocated once there is room for the candidates.
#[derive(Debug)]
pub struct PlainModel {
    pub cell: Box<dyn PlainCell>,
    /// Time units of a step.
    pub dt: f64,
}

impl Model for PlainModel {
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

impl<C: Deref<Target = dyn Cell>> Model for CellModel<C> {
    fn roll_out(&mut self, start: &ControlState, plans: &Plans, into: &mut Trajectories) -> Result<()> {
        let _guard = tch::no_grad_guard();
        let (candidates, steps, coordinates) = (plans.candidates as i64, plans.steps(), start.coordinates() as i64);
        let rows = |numbers: &[f64]| {
            let numbers: Vec<f32> = numbers.iter().map(|number| *number as f32).collect();
            Tensor::from_slice(&numbers).expand([candidates, coordinates], false)
        };
        let initial = State { pos: rows(&start.positions), vel: rows(&start.velocities) };
        let actions = Tensor::from_slice(plans.actions).reshape([-1, candidates]).transpose(0, 1);
        let actions = Actions::new(Some(actions.repeat_interleave_self_int(plans.hold as i64, 1, None)));
        let states = self.cell.roll_out(&initial, &actions, self.dt, steps);
        into.make_room(plans.candidates, start.coordinates(), steps);
        for (step, state) in states.iter().enumerate() {
            for (column, part) in into.step_mut(step).into_iter().zip([&state.pos, &state.vel]) {
                ensure!(part.size() == [candidates, coordinates], "the equation does not move what is controlled");
                let numbers: Vec<f32> =
                    Vec::try_from(part.transpose(0, 1).contiguous().flatten(0, 1)).context("the states of plans")?;
                column.copy_from_slice(&numbers);
            }
        }
        Ok(())
    }
}

/// A cell with its parameters as they are now: in plain numbers where it has that form, which takes a fraction of the
/// time.
pub fn of_cell<'a, C: Deref<Target = dyn Cell> + 'a>(cell: C, dt: f64) -> Box<dyn Model + 'a> {
    match cell.plain() {
        Some(plain) => Box::new(PlainModel { cell: plain, dt }),
        None => Box::new(CellModel { cell, dt }),
    }
}
