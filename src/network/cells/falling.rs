//! Balls in a uniform field of gravity g, pixels per squared time unit, downwards; with or without walls.
//!
//! The systems of the original's grayscale datasets; its release has no cell for them.

use tch::Tensor;

use super::impact::turned_back;
use super::plain::{Euler, Law, PlainCell};
use super::{Build, Cell, CellKind, Coordinates, PhysicalParameter, State, Walls, scalars};

const PARAMETERS: &[PhysicalParameter] = &[PhysicalParameter::learned("g", "log_g", 1).with_time(-2)];

/// Free fall.
pub static FALLING: CellKind = CellKind {
    name: "falling",
    scope: "falling_ode_cell",
    objects: None,
    coordinates: Coordinates::Position,
    walls: false,
    actions: false,
    parameters: PARAMETERS,
    build: Build::Rust(|logs, _walls| {
        let [log_g] = scalars(logs);
        Box::new(Falling { log_g, walls: None })
    }),
};

/// The same, bouncing off all four walls without loss.
pub static FALLING_BOUNCING: CellKind = CellKind {
    name: "falling_bouncing",
    scope: "falling_bouncing_ode_cell",
    objects: None,
    coordinates: Coordinates::Position,
    walls: true,
    actions: false,
    parameters: PARAMETERS,
    build: Build::Rust(|logs, walls| {
        let [log_g] = scalars(logs);
        Box::new(Falling { log_g, walls: Some(walls) })
    }),
};

#[derive(Debug)]
struct Falling {
    log_g: Tensor,
    walls: Option<Walls>,
}

impl Cell for Falling {
    fn substep(&self, state: &State, _action: Option<&Tensor>, h: f64) -> State {
        // (0, 1) for each object: y points down.
        let down = Tensor::arange(state.vel.size()[1], (state.vel.kind(), state.vel.device())).remainder(2.0);
        let vel = &state.vel + self.log_g.exp() * down * h;
        let pos = &state.pos + &vel * h;
        let [pos, vel] = match self.walls {
            Some(walls) => {
                let [near, far] = walls.tensors((pos.kind(), pos.device()));
                turned_back([&state.pos, &state.vel], [pos, vel], [&near, &far], None)
            }
            None => [pos, vel],
        };
        State { pos, vel }
    }

    fn plain_double(&self) -> Option<Box<dyn PlainCell<f64>>> {
        let free = self.walls.is_none();
        free.then(|| Box::new(Euler::new(FallingLaw { g: self.log_g.double_value(&[]).exp() })) as _)
    }
}

/// Free fall in plain numbers.
#[derive(Debug)]
struct FallingLaw {
    g: f64,
}

impl Law for FallingLaw {
    fn accelerate(&self, _positions: &[f64], _velocities: &[f64], action: &[f64], into: &mut [f64]) {
        for (coordinate, column) in into.chunks_exact_mut(action.len()).enumerate() {
            column.fill(if coordinate % 2 == 0 { 0.0 } else { self.g });
        }
    }
}
