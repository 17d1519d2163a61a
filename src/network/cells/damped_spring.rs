//! The spring in a medium that resists: `v0' = -F - c v0`, `v1' = F - c v1`, with the spring's F.
//!
//! Not in the original; the worked example of `docs/own-equation.md`.

use tch::Tensor;

use super::plain::{Euler, PlainCell};
use super::spring::Spring;
use super::{Build, Cell, CellKind, Coordinates, PhysicalParameter, State, scalars};

pub static DAMPED_SPRING: CellKind = CellKind {
    name: "damped_spring",
    scope: "damped_spring_ode_cell",
    objects: Some(2),
    coordinates: Coordinates::Position,
    walls: false,
    actions: false,
    parameters: &[
        PhysicalParameter::learned("k", "log_k", 0).with_time(-2),
        PhysicalParameter::learned("l", "log_l", 1).with_time(0),
        PhysicalParameter::learned("c", "log_c", 0).with_time(-1),
    ],
    build: Build::Rust(|logs, _walls| {
        let [log_k, log_l, log_c] = scalars(logs);
        Box::new(DampedSpring { spring: Spring { log_k, log_l }, log_c })
    }),
};

#[derive(Debug)]
struct DampedSpring {
    spring: Spring,
    log_c: Tensor,
}

impl Cell for DampedSpring {
    fn substep(&self, state: &State, _action: Option<&Tensor>, h: f64) -> State {
        let acceleration = self.spring.acceleration(state) - self.log_c.exp() * &state.vel;
        let vel = &state.vel + acceleration * h;
        State { pos: &state.pos + &vel * h, vel }
    }

    fn plain_double(&self) -> Option<Box<dyn PlainCell<f64>>> {
        Some(Box::new(Euler::new(self.spring.law(self.log_c.double_value(&[]).exp()))))
    }
}
