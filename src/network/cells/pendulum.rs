//! A rod of mass 1 and length 1 that turns about its end, with a torque u from outside:
//! `theta'' = 3/2 g sin(theta) + 3 a u`, theta = 0 upright.
//!
//! g is gravity (lengths in rods), a the actuation coefficient. Paper: section 4.3 (vision-based control); the authors'
//! code for it was never released. Positions and velocities are angles, `[batch, 1]`.

use super::built_in::BuiltIn;
use super::integrator::SUBSTEPS;
use super::plain::PlainCell;
use super::text::PlainForms;
use crate::support::fast_math::sine;

pub const PENDULUM: BuiltIn = BuiltIn {
    name: "pendulum",
    scope: "pendulum_ode_cell",
    objects: Some(1),
    parameters: &["g", "a"],
    text: r#"
state = "angle"
acceleration = "g * sin(p) * 1.5 + a * u * 3"
parameters.g.unit = [0, -2]
parameters.a = {}
"#,
    plain: PlainForms { fit: None, plan: Some(plan) },
};

fn plan(values: &[f64]) -> Box<dyn PlainCell> {
    let (gravity, torque) = (1.5 * values[0] as f32, 3.0 * values[1] as f32);
    Box::new(PlainPendulum { gravity, torque, substeps: SUBSTEPS, largest_rate: f32::INFINITY })
}

/// The pendulum in plain numbers. The loop computes several angles at a time, which the steps of
/// [`Integrator`](super::Integrator) on single numbers do not: they take 25 times as long.
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
                let faster = *rate + (self.gravity * sine(*angle) + self.torque * action) * h;
                *angle += faster * h;
                *rate = faster.clamp(-self.largest_rate, self.largest_rate);
            }
        }
    }
}
