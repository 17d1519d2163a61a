//! Two bodies of unit mass joined by a spring.
//!
//! With d = p0 - p1 and n = |d|, `F = k (n - 2 l) d / n`, `v0' = -F`, `v1' = F`; l is half the rest length.
//! Original: `spring_ode_cell`; paper: section 4.1.

use std::borrow::Cow;

use tch::Tensor;

use super::cell::{Cell, scalars};
use super::integrands::euler;
use super::kind::{Build, CellKind};
use super::parameter::PhysicalParameter;
use super::plain::{Euler, Law, PlainCell, columns, columns_mut};
use super::state::{Coordinates, State};

const PARAMETERS: &[PhysicalParameter] = &[
    PhysicalParameter::learned("k", "log_k", 0).with_time(-2),
    PhysicalParameter::learned("l", "log_l", 1).with_time(0),
];

pub static SPRING: CellKind = CellKind {
    name: Cow::Borrowed("spring"),
    scope: "spring_ode_cell",
    objects: Some(2),
    coordinates: Coordinates::Position,
    walls: false,
    actions: false,
    parameters: Cow::Borrowed(PARAMETERS),
    build: Build::Rust(|logs, _walls| {
        let [log_k, log_l] = scalars(logs);
        Box::new(Spring { log_k, log_l })
    }),
    text: Some(
        r#"
acceleration = "others(-k * (norm(p - q) - 2*l) * (p - q) / (norm(p - q) + 1e-4))"
parameters.k.unit = [0, -2]
parameters.l.unit = [1, 0]
"#,
    ),
};

/// Keeps the direction finite when the bodies meet.
const SOFTENING: f64 = 1e-4;
/// Of a distance: that of 0 has a root without a gradient.
const LEAST_SQUARE: f64 = 1e-36;

#[derive(Debug)]
pub(super) struct Spring {
    pub log_k: Tensor,
    pub log_l: Tensor,
}

impl Spring {
    /// With the parameters as they are now, in a medium that resists by so much.
    pub(super) fn law(&self, resistance: f64) -> SpringLaw {
        let [k, l] = [&self.log_k, &self.log_l].map(|log| log.double_value(&[]).exp());
        SpringLaw { k, l, resistance }
    }

    /// Accelerations of the two bodies, `[batch, 4]`.
    pub(super) fn acceleration(&self, state: &State) -> Tensor {
        let d = state.position(0) - state.position(1);
        let n = d.square().sum_dim_intlist([1i64].as_slice(), true, None).clamp_min(LEAST_SQUARE).sqrt();
        let force = self.log_k.exp() * (&n - self.log_l.exp() * 2.0) * d / (n + SOFTENING);
        Tensor::cat(&[-&force, force], 1)
    }
}

impl Cell for Spring {
    fn substep(&self, state: &State, _action: Option<&Tensor>, h: f64) -> State {
        euler(state, &self.acceleration(state), h)
    }

    fn plain_double(&self) -> Option<Box<dyn PlainCell<f64>>> {
        Some(Box::new(Euler::new(self.law(0.0))))
    }
}

/// The spring, and a medium that resists, in plain numbers.
#[derive(Debug)]
pub(super) struct SpringLaw {
    k: f64,
    l: f64,
    resistance: f64,
}

impl Law for SpringLaw {
    fn accelerate(&self, positions: &[f64], velocities: &[f64], _action: &[f64], into: &mut [f64]) {
        let [x0, y0, x1, y1] = columns(positions);
        let [a0, b0, a1, b1] = columns_mut(into);
        for i in 0..x0.len() {
            let (x, y) = (x0[i] - x1[i], y0[i] - y1[i]);
            let n = (x * x + y * y).sqrt();
            let force = self.k * (n - 2.0 * self.l) / (n + SOFTENING);
            (a0[i], b0[i], a1[i], b1[i]) = (-force * x, -force * y, force * x, force * y);
        }
        if self.resistance != 0.0 {
            into.iter_mut().zip(velocities).for_each(|(faster, velocity)| *faster -= self.resistance * velocity);
        }
    }
}
