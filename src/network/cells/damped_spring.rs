//! The spring in a medium that resists: `v0' = -F - c v0`, `v1' = F - c v1`, with the spring's F.
//!
//! Not in the original; the worked example of `docs/own-equation.md`.

use std::borrow::Cow;

use tch::Tensor;

use super::cell::{Cell, scalars};
use super::integrands::euler;
use super::kind::{Build, CellKind};
use super::parameter::PhysicalParameter;
use super::plain::{Euler, PlainCell};
use super::spring::Spring;
use super::state::{Coordinates, State};

const PARAMETERS: &[PhysicalParameter] = &[
    PhysicalParameter::learned("k", "log_k", 0).with_time(-2),
    PhysicalParameter::learned("l", "log_l", 1).with_time(0),
    PhysicalParameter::learned("c", "log_c", 0).with_time(-1),
];

pub static DAMPED_SPRING: CellKind = CellKind {
    name: Cow::Borrowed("damped_spring"),
    scope: "damped_spring_ode_cell",
    objects: Some(2),
    coordinates: Coordinates::Position,
    walls: false,
    actions: false,
    parameters: Cow::Borrowed(PARAMETERS),
    build: Build::Rust(|logs, _walls| {
        let [log_k, log_l, log_c] = scalars(logs);
        Box::new(DampedSpring { spring: Spring { log_k, log_l }, log_c })
    }),
    text: Some(
        r#"
acceleration = "others(-k * (norm(p - q) - 2*l) * (p - q) / (norm(p - q) + 1e-4)) - c * v"
parameters.c.unit = [0, -1]
parameters.k.unit = [0, -2]
parameters.l.unit = [1, 0]
"#,
    ),
};

#[derive(Debug)]
struct DampedSpring {
    spring: Spring,
    log_c: Tensor,
}

impl Cell for DampedSpring {
    fn substep(&self, state: &State, _action: Option<&Tensor>, h: f64) -> State {
        euler(state, &(self.spring.acceleration(state) - self.log_c.exp() * &state.vel), h)
    }

    fn plain_double(&self) -> Option<Box<dyn PlainCell<f64>>> {
        Some(Box::new(Euler::new(self.spring.law(self.log_c.double_value(&[]).exp()))))
    }
}
