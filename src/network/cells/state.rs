//! Positions and velocities of a batch, what they are measured in, and where walls stand.

use serde::{Deserialize, Serialize};
use tch::{Device, Kind, Tensor};

/// Most objects of a system.
pub const MOST_OBJECTS: usize = 32;

/// What an equation calls the position of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Coordinates {
    /// x and y, pixels.
    Position,
    /// The angle about the frame's centre: 0 is up, positive is clockwise on the screen; radians.
    Angle,
}

impl Coordinates {
    /// Numbers for one object.
    pub fn per_object(self) -> usize {
        match self {
            Coordinates::Position => 2,
            Coordinates::Angle => 1,
        }
    }

    /// Short name of the unit they are measured in.
    pub fn unit(self) -> &'static str {
        match self {
            Coordinates::Position => "px",
            Coordinates::Angle => "rad",
        }
    }
}

/// Positions and velocities of all objects, each `[batch, coordinates * objects]`.
#[derive(Debug)]
pub struct State {
    pub pos: Tensor,
    pub vel: Tensor,
}

impl State {
    /// Splits `[batch, 2 * coordinates * objects]`, positions then velocities.
    pub fn from_joined(joined: &Tensor) -> Self {
        let halves = joined.chunk(2, 1);
        State { pos: halves[0].shallow_clone(), vel: halves[1].shallow_clone() }
    }

    /// `[batch, 2 * coordinates * objects]`, positions then velocities.
    pub fn joined(&self) -> Tensor {
        Tensor::cat(&[&self.pos, &self.vel], 1)
    }

    /// States after each other, `[batch, time, 2 * coordinates * objects]`.
    pub fn sequence<'s>(states: impl IntoIterator<Item = &'s State>) -> Tensor {
        Tensor::stack(&states.into_iter().map(State::joined).collect::<Vec<_>>(), 1)
    }

    /// Their positions alone, `[batch, time, coordinates * objects]`.
    pub fn positions(states: &[State]) -> Tensor {
        Tensor::stack(&states.iter().map(|state| &state.pos).collect::<Vec<_>>(), 1)
    }

    pub fn detach(&self) -> Self {
        State { pos: self.pos.detach(), vel: self.vel.detach() }
    }

    /// Position of one object in the plane, `[batch, 2]`.
    pub fn position(&self, object: i64) -> Tensor {
        self.pos.narrow(1, 2 * object, 2)
    }
}

/// The walls of a square frame, the same on both axes: where a ball's centre turns, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Walls {
    pub near: f64,
    pub far: f64,
}

impl Walls {
    /// In a frame of side `side`, both `margin` pixels from its edges.
    pub fn new(side: usize, margin: f64) -> Self {
        Walls { near: margin, far: side as f64 - margin }
    }

    /// Near and far, `[1]` each.
    pub(super) fn tensors(self, options: (Kind, Device)) -> [Tensor; 2] {
        [self.near, self.far].map(|place| Tensor::full([1], place, options))
    }
}
