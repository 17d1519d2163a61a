//! A rod of mass 1 and length 1 that turns about its end, with a torque u from outside:
//! `theta'' = 3/2 g sin(theta) + 3 a u`, theta = 0 upright.
//!
//! g is gravity (lengths in rods), a the actuation coefficient. Paper: section 4.3 (vision-based control); the authors'
//! code for it was never released. Positions and velocities are angles, `[batch, 1]`.

use std::borrow::Cow;

use tch::Tensor;

use super::cell::{Cell, scalars};
use super::integrands::{OnNumber, euler};
use super::integrator::{Integrator, SUBSTEPS};
use super::kind::{Build, CellKind};
use super::parameter::PhysicalParameter;
use super::plain::{Euler, Law, PlainCell};
use super::state::{Coordinates, State};
use crate::support::fast_math::sine;

const PARAMETERS: &[PhysicalParameter] =
    &[PhysicalParameter::learned("g", "log_g", 0), PhysicalParameter::learned("a", "log_a", 0)];

pub static PENDULUM: CellKind = CellKind {
    name: Cow::Borrowed("pendulum"),
    scope: "pendulum_ode_cell",
    objects: Some(1),
    coordinates: Coordinates::Angle,
    walls: false,
    actions: true,
    parameters: Cow::Borrowed(PARAMETERS),
    build: Build::Rust(|logs, _walls| {
        let [log_g, log_a] = scalars(logs);
        Box::new(Pendulum { log_g, log_a })
    }),
    text: Some(
        r#"
state = "angle"
acceleration = "1.5 * g * sin(p) + 3 * a * u"
parameters.a = {}
parameters.g.unit = [0, -2]
"#,
    ),
};

#[derive(Debug)]
struct Pendulum {
    log_g: Tensor,
    log_a: Tensor,
}

impl Cell for Pendulum {
    fn substep(&self, state: &State, action: Option<&Tensor>, h: f64) -> State {
        let gravity = self.log_g.exp() * state.pos.sin() * 1.5;
        let acceleration = match action {
            Some(torque) => gravity + self.log_a.exp() * torque * 3.0,
            None => gravity,
        };
        euler(state, &acceleration, h)
    }

    fn plain(&self) -> Option<Box<dyn PlainCell>> {
        let value = |log: &Tensor| log.double_value(&[]).exp() as f32;
        let (gravity, torque) = (1.5 * value(&self.log_g), 3.0 * value(&self.log_a));
        Some(Box::new(PlainPendulum { gravity, torque, substeps: SUBSTEPS, largest_rate: f32::INFINITY }))
    }

    fn plain_double(&self) -> Option<Box<dyn PlainCell<f64>>> {
        let [g, a] = [&self.log_g, &self.log_a].map(|log| log.double_value(&[]).exp());
        Some(Box::new(Euler::new(PendulumLaw { gravity: 1.5 * g, torque: 3.0 * a })))
    }
}

/// The pendulum in double precision.
#[derive(Debug)]
struct PendulumLaw {
    gravity: f64,
    torque: f64,
}

impl Law for PendulumLaw {
    fn accelerate(&self, angles: &[f64], _rates: &[f64], action: &[f64], into: &mut [f64]) {
        for ((faster, angle), action) in into.iter_mut().zip(angles).zip(action) {
            *faster = self.gravity * angle.sin() + self.torque * action;
        }
    }
}

/// The pendulum in plain numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlainPendulum {
    /// Angular acceleration of gravity on a rod that lies flat, and for a torque of 1.
    pub gravity: f32,
    pub torque: f32,
    /// Euler steps for one frame.
    pub substeps: usize,
    /// Where a rate is cut off to either side after each of them.
    pub largest_rate: f32,
}

impl PlainCell for PlainPendulum {
    fn step(&mut self, angles: &mut [f32], rates: &mut [f32], action: &[f32], dt: f32) {
        let h = dt / self.substeps as f32;
        for _ in 0..self.substeps {
            for ((angle, rate), action) in angles.iter_mut().zip(&mut *rates).zip(action) {
                let mut rod = OnNumber(|angle: f32, _| self.gravity * sine(angle) + self.torque * action);
                let [moved, faster] = Integrator::Euler.step(&mut rod, [*angle, *rate], h);
                *angle = moved;
                *rate = faster.clamp(-self.largest_rate, self.largest_rate);
            }
        }
    }
}
