//! Plans that are tried, all candidates side by side, and where they lead.

use std::ops::Range;

use anyhow::{Context, Result, ensure};

use super::state::ControlState;
use paig::network::cells::State;

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
    pub(super) fn go_on(&mut self, step: usize, start: &ControlState) {
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

    /// Writes a step's states of all candidates, each `[candidates, coordinates]`.
    ///
    /// # Errors
    /// States of another shape.
    pub(super) fn write(&mut self, step: usize, state: &State) -> Result<()> {
        let shape = [self.candidates as i64, self.coordinates as i64];
        for (column, part) in self.step_mut(step).into_iter().zip([&state.pos, &state.vel]) {
            ensure!(part.size() == shape, "the model does not move what is controlled");
            let numbers: Vec<f32> =
                Vec::try_from(part.transpose(0, 1).contiguous().flatten(0, 1)).context("the states of plans")?;
            column.copy_from_slice(&numbers);
        }
        Ok(())
    }

    /// The states that a candidate goes through.
    pub fn of(&self, candidate: usize) -> Vec<ControlState> {
        let size = (self.coordinates * self.candidates).max(1);
        let coordinate = |all: &[f32], step: usize| -> Vec<f64> {
            let column = |axis: usize| f64::from(all[step * size + axis * self.candidates + candidate]);
            (0..self.coordinates).map(column).collect()
        };
        let state = |step| ControlState::new(coordinate(&self.positions, step), coordinate(&self.velocities, step));
        (0..self.positions.len() / size).map(state).collect()
    }
}
