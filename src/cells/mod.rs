//! Physics cells: the differential equations, each in a file of its own, behind one trait.
//!
//! Original: `nn/network/cells.py`; paper: section 3.2. A frame is integrated in [`SUBSTEPS`] Euler steps. Positions and
//! velocities are `[batch, 2 * objects]` as `(x0, y0, x1, y1, ..)`, in pixels and pixels per time unit.
//!
//! A new system takes one file with a [`Cell`], a variant of [`CellKind`] and a row of the task table.

mod bouncing;
mod gravity;
mod spring;

use std::fmt::Debug;

use tch::Tensor;

pub use crate::tasks::CellKind;

/// Euler steps for one frame.
pub const SUBSTEPS: usize = 5;

/// Positions and velocities of all objects, each `[batch, 2 * objects]`.
#[derive(Debug)]
pub struct State {
    pub pos: Tensor,
    pub vel: Tensor,
}

impl State {
    /// Splits `[batch, 4 * objects]`, positions then velocities.
    pub fn from_joined(joined: &Tensor) -> Self {
        let halves = joined.chunk(2, 1);
        State { pos: halves[0].shallow_clone(), vel: halves[1].shallow_clone() }
    }

    /// `[batch, 4 * objects]`, positions then velocities.
    pub fn joined(&self) -> Tensor {
        Tensor::cat(&[&self.pos, &self.vel], 1)
    }

    pub fn detach(&self) -> Self {
        State { pos: self.pos.detach(), vel: self.vel.detach() }
    }

    /// Position of one object, `[batch, 2]`.
    pub fn position(&self, object: i64) -> Tensor {
        self.pos.narrow(1, 2 * object, 2)
    }
}

/// What a cell can learn. The variable is the logarithm, so the value stays positive.
#[derive(Debug)]
pub struct PhysicalParameter {
    /// Symbol of the paper, the key under `parameters` in `summary.json`.
    pub name: &'static str,
    /// Name of its logarithm in the cell's scope.
    pub variable: &'static str,
    /// Power of a length in its unit: what a rescaling of the coordinates does to it.
    pub length_power: i32,
}

/// A differential equation, integrated by Euler steps.
pub trait Cell: Debug {
    /// The state a time `h` later; a negative `h` goes back (to the order of the method).
    fn substep(&self, state: &State, h: f64) -> State;

    /// The state one frame (`dt` time units) later.
    fn step(&self, state: &State, dt: f64) -> State {
        let h = dt / SUBSTEPS as f64;
        let mut state = self.substep(state, h);
        for _ in 1..SUBSTEPS {
            state = self.substep(&state, h);
        }
        state
    }

    /// The states of the next `frames` frames, the initial one not included.
    fn roll_out(&self, initial: &State, dt: f64, frames: usize) -> Vec<State> {
        let mut states: Vec<State> = Vec::with_capacity(frames);
        for _ in 0..frames {
            let next = self.step(states.last().unwrap_or(initial), dt);
            states.push(next);
        }
        states
    }
}

impl CellKind {
    /// Name of the scope that holds the cell's variables.
    pub fn scope(self) -> &'static str {
        match self {
            CellKind::Bouncing => "bouncing_ode_cell",
            CellKind::Spring => "spring_ode_cell",
            CellKind::Gravity => "gravity_ode_cell",
        }
    }

    /// What the cell learns, in the order in which [`CellKind::build`] takes it.
    pub fn parameters(self) -> &'static [PhysicalParameter] {
        match self {
            CellKind::Bouncing => &[],
            CellKind::Spring => spring::PARAMETERS,
            CellKind::Gravity => gravity::PARAMETERS,
        }
    }

    /// The cell with these log-parameters (scalars, one for each of [`CellKind::parameters`]) for frames of side `side`.
    pub fn build(self, logs: &[Tensor], side: usize) -> Box<dyn Cell> {
        match (self, logs) {
            (CellKind::Bouncing, []) => Box::new(bouncing::Bouncing { side: side as f64 }),
            (CellKind::Spring, [log_k, log_l]) => {
                Box::new(spring::Spring { log_k: log_k.shallow_clone(), log_l: log_l.shallow_clone() })
            }
            (CellKind::Gravity, [log_g]) => Box::new(gravity::Gravity { log_g: log_g.shallow_clone() }),
            _ => unreachable!("{self:?} takes {} parameters, got {}", self.parameters().len(), logs.len()),
        }
    }
}
