//! Balls on straight lines that bounce off the walls and pass through each other; nothing is learned.
//!
//! Original: `bouncing_ode_cell`. The position moves first; then velocities flip and positions reflect, in the
//! original's order (both walls for the velocity, then both for the position).

use std::borrow::Cow;

use tch::Tensor;

use super::cell::{Cell, scalars};
use super::kind::{Build, CellKind};
use super::state::{Coordinates, State, Walls};

pub static BOUNCING: CellKind = CellKind {
    name: Cow::Borrowed("bouncing"),
    scope: "bouncing_ode_cell",
    objects: None,
    coordinates: Coordinates::Position,
    walls: true,
    actions: false,
    parameters: Cow::Borrowed(&[]),
    build: Build::Rust(|logs, walls| {
        let [] = scalars(logs);
        Box::new(Bouncing { walls })
    }),
    text: Some(
        r#"
acceleration = "vec(0, 0)"
walls = true
"#,
    ),
};

#[derive(Debug)]
struct Bouncing {
    walls: Walls,
}

/// The state after the walls have turned back what has passed them.
fn reflected(pos: Tensor, vel: &Tensor, walls: Walls) -> State {
    let Walls { near, far } = walls;
    let beyond = pos.gt(far);
    let before = pos.lt(near);
    let vel = (-vel).where_self(&beyond, vel);
    let vel = (-&vel).where_self(&before, &vel);
    let pos = (2.0 * far - &pos).where_self(&beyond, &pos);
    let pos = (2.0 * near - &pos).where_self(&pos.lt(near), &pos);
    State { pos, vel }
}

impl Cell for Bouncing {
    fn substep(&self, state: &State, _action: Option<&Tensor>, h: f64) -> State {
        reflected(&state.pos + &state.vel * h, &state.vel, self.walls)
    }
}
