//! Balls in a uniform field of gravity g, pixels per squared time unit, downwards; with or without walls.
//!
//! The systems of the original's grayscale datasets; its release has no cell for them.

use std::borrow::Cow;

use tch::Tensor;

use super::cell::{Cell, scalars};
use super::impact::turned_back;
use super::integrands::euler;
use super::kind::{Build, CellKind};
use super::parameter::PhysicalParameter;
use super::plain::{Euler, Law, PlainCell};
use super::state::{Coordinates, State, Walls};

const PARAMETERS: &[PhysicalParameter] = &[PhysicalParameter::learned("g", "log_g", 1).with_time(-2)];

/// Free fall.
pub static FALLING: CellKind = CellKind {
    name: Cow::Borrowed("falling"),
    scope: "falling_ode_cell",
    objects: None,
    coordinates: Coordinates::Position,
    walls: false,
    actions: false,
    parameters: Cow::Borrowed(PARAMETERS),
    build: Build::Rust(|logs, _walls| {
        let [log_g] = scalars(logs);
        Box::new(Falling { log_g, walls: None })
    }),
    text: Some(
        r#"
acceleration = "vec(0, g)"
parameters.g.unit = [1, -2]
"#,
    ),
};

/// The same, bouncing off all four walls without loss.
pub static FALLING_BOUNCING: CellKind = CellKind {
    name: Cow::Borrowed("falling_bouncing"),
    scope: "falling_bouncing_ode_cell",
    objects: None,
    coordinates: Coordinates::Position,
    walls: true,
    actions: false,
    parameters: Cow::Borrowed(PARAMETERS),
    build: Build::Rust(|logs, walls| {
        let [log_g] = scalars(logs);
        Box::new(Falling { log_g, walls: Some(walls) })
    }),
    text: Some(
        r#"
acceleration = "vec(0, g)"
walls = true
parameters.g.unit = [1, -2]
"#,
    ),
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
        let moved = euler(state, &(self.log_g.exp() * down), h);
        let Some(walls) = self.walls else { return moved };
        let [near, far] = walls.tensors((moved.pos.kind(), moved.pos.device()));
        let before = [&state.pos, &state.vel];
        let [pos, vel] = turned_back(before, [&moved.pos, &moved.vel], [&near, &far], None);
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
