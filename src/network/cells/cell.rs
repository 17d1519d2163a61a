//! The contract of an equation with its parameters.

use std::fmt::Debug;

use tch::Tensor;

use super::actions::Actions;
use super::integrator::SUBSTEPS;
use super::plain::PlainCell;
use super::state::State;

/// A differential equation, integrated by Euler steps.
pub trait Cell: Debug {
    /// The state a time `h` later; a negative `h` goes back (to the order of the method). `action` (`[batch, 1]`) acts
    /// meanwhile; without one nothing does.
    fn substep(&self, state: &State, action: Option<&Tensor>, h: f64) -> State;

    /// The state one frame (`dt` time units) later.
    fn step(&self, state: &State, action: Option<&Tensor>, dt: f64) -> State {
        let h = dt / SUBSTEPS as f64;
        let mut state = self.substep(state, action, h);
        for _ in 1..SUBSTEPS {
            state = self.substep(&state, action, h);
        }
        state
    }

    /// The states of the next `frames` frames, the initial one not included; `actions` begin at the initial state's frame.
    fn roll_out(&self, initial: &State, actions: &Actions, dt: f64, frames: usize) -> Vec<State> {
        let mut states: Vec<State> = Vec::with_capacity(frames);
        for frame in 0..frames {
            let next = self.step(states.last().unwrap_or(initial), actions.at(frame).as_ref(), dt);
            states.push(next);
        }
        states
    }

    /// The same equation with the parameters as they are now, in plain numbers; none where there is no such form.
    fn plain(&self) -> Option<Box<dyn PlainCell>> {
        None
    }

    /// The same in double precision.
    fn plain_double(&self) -> Option<Box<dyn PlainCell<f64>>> {
        None
    }
}

/// The unconstrained parameters that `build` was given, scalars, one for each of `N` parameters.
///
/// # Panics
/// Another number of them: a mistake in the program, never in its input.
pub fn scalars<const N: usize>(unconstrained: &[Tensor]) -> [Tensor; N] {
    let unconstrained: &[Tensor; N] =
        unconstrained.try_into().expect("one unconstrained parameter for each parameter of the cell");
    unconstrained.each_ref().map(Tensor::shallow_clone)
}
