//! A rod of mass 1 and length 1 that turns about its end, with a torque u from outside:
//! `theta'' = 3/2 g sin(theta) + 3 a u`, theta = 0 upright.
//!
//! g is gravity (lengths in rods), a the actuation coefficient. Paper: section 4.3 (vision-based control); the authors'
//! code for it was never released. Positions and velocities are angles, `[batch, 1]`.

use tch::Tensor;

use super::{Build, Cell, CellKind, Coordinates, PhysicalParameter, State, scalars};

pub static PENDULUM: CellKind = CellKind {
    name: "pendulum",
    scope: "pendulum_ode_cell",
    objects: Some(1),
    coordinates: Coordinates::Angle,
    walls: false,
    actions: true,
    parameters: &[PhysicalParameter::learned("g", "log_g", 0), PhysicalParameter::learned("a", "log_a", 0)],
    build: Build::Rust(|logs, _walls| {
        let [log_g, log_a] = scalars(logs);
        Box::new(Pendulum { log_g, log_a })
    }),
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
        let vel = &state.vel + acceleration * h;
        State { pos: &state.pos + &vel * h, vel }
    }
}
