//! Roll-outs of an equation over a whole video, one state at a time.

use tch::{Kind, Tensor};

use crate::network::System;
use crate::network::cells::{Actions, Build, State};

/// An equation, ready to be rolled out from frame to frame of a film.
#[derive(Debug, Clone)]
pub struct Dynamics {
    pub system: System,
    /// Time between two frames of the film, in the unit of the system's `dt`.
    pub dt: f64,
}

impl Dynamics {
    /// Numbers in the positions of all objects.
    pub fn coordinates(&self) -> usize {
        self.system.coordinates()
    }

    /// The values that raw numbers of all parameters stand for.
    pub fn values(&self, raw: &[f64]) -> Vec<f64> {
        self.system.cell.parameters.iter().zip(raw).map(|(parameter, raw)| parameter.bounds.value(*raw)).collect()
    }

    /// States of `frames` frames, each positions and then velocities, the initial one first: it is that of the frame
    /// `begin`. `raw` are the raw numbers of all parameters. Nothing acts from outside.
    pub fn roll_out(&self, raw: &[f64], initial: &[f64], begin: usize, frames: usize) -> Vec<f64> {
        match self.system.cell.build {
            Build::Text(equation) => {
                let mut equation = equation.single(&self.values(raw), self.system.walls);
                equation.roll_out(initial, begin as f64 * self.dt, self.dt, frames)
            }
            Build::Rust(_) => self.by_tensors(raw, initial, frames),
        }
    }

    fn by_tensors(&self, raw: &[f64], initial: &[f64], frames: usize) -> Vec<f64> {
        let _guard = tch::no_grad_guard();
        let raw: Vec<_> = raw.iter().take(self.system.cell.parameters.len()).map(|raw| Tensor::from(*raw)).collect();
        let first = State::from_joined(&Tensor::from_slice(initial).unsqueeze(0));
        let rest = self.system.build_cell(&raw).roll_out(&first, &Actions::none(), self.dt, frames.saturating_sub(1));
        let states = std::iter::once(&first).chain(&rest).take(frames);
        let states: Vec<_> = states.map(State::joined).collect();
        Tensor::cat(&states, 0).to_kind(Kind::Double).flatten(0, 1).try_into().expect("float64 numbers")
    }

    /// By how much what is seen has moved on with the camera at a tick, if raw numbers stand for a drift: those behind the
    /// parameters', one for each coordinate, in its unit per unit of `dt`.
    pub fn drifted(&self, raw: &[f64], tick: usize, coordinate: usize) -> f64 {
        raw.get(self.system.cell.parameters.len() + coordinate).map_or(0.0, |drift| drift * self.dt * tick as f64)
    }

    /// The positions alone, frame by frame.
    pub fn positions(&self, raw: &[f64], initial: &[f64], begin: usize, frames: usize) -> Vec<f64> {
        let states = self.roll_out(raw, initial, begin, frames);
        states.chunks(initial.len()).flat_map(|state| &state[..state.len() / 2]).copied().collect()
    }
}
