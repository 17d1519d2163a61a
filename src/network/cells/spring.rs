//! Two bodies of unit mass joined by a spring.
//!
//! With d = p0 - p1 and n = |d|, `F = k (n - 2 l) d / n`, `v0' = -F`, `v1' = F`; l is half the rest length.
//! Original: `spring_ode_cell`; paper: section 4.1.

use tch::Tensor;

use super::{Build, Cell, CellKind, Coordinates, PhysicalParameter, State, scalars};

pub static SPRING: CellKind = CellKind {
    name: "spring",
    scope: "spring_ode_cell",
    objects: Some(2),
    coordinates: Coordinates::Position,
    walls: false,
    actions: false,
    parameters: &[
        PhysicalParameter::learned("k", "log_k", 0).with_time(-2),
        PhysicalParameter::learned("l", "log_l", 1).with_time(0),
    ],
    build: Build::Rust(|logs, _walls| {
        let [log_k, log_l] = scalars(logs);
        Box::new(Spring { log_k, log_l })
    }),
};

/// Keeps the direction finite when the bodies meet.
const SOFTENING: f64 = 1e-4;

#[derive(Debug)]
pub(super) struct Spring {
    pub log_k: Tensor,
    pub log_l: Tensor,
}

impl Spring {
    /// Accelerations of the two bodies, `[batch, 4]`.
    pub(super) fn acceleration(&self, state: &State) -> Tensor {
        let d = state.position(0) - state.position(1);
        let n = d.square().sum_dim_intlist([1i64].as_slice(), true, None).sqrt();
        let force = self.log_k.exp() * (&n - self.log_l.exp() * 2.0) * d / (n + SOFTENING);
        Tensor::cat(&[-&force, force], 1)
    }
}

impl Cell for Spring {
    fn substep(&self, state: &State, _action: Option<&Tensor>, h: f64) -> State {
        let vel = &state.vel + self.acceleration(state) * h;
        State { pos: &state.pos + &vel * h, vel }
    }
}
