//! Balls on straight lines that bounce off the walls and pass through each other; nothing is learned.
//!
//! Original: `bouncing_ode_cell`. The position moves first; then velocities flip and positions reflect, in the
//! original's order (both walls for the velocity, then both for the position).

use super::{Cell, State};

/// Radius of a ball: how far from a wall its centre turns, pixels.
const RADIUS: f64 = 2.0;

#[derive(Debug)]
pub(super) struct Bouncing {
    /// Position of the far wall, pixels; the near one is at 0.
    pub side: f64,
}

impl Cell for Bouncing {
    fn substep(&self, state: &State, h: f64) -> State {
        let (near, far) = (RADIUS, self.side - RADIUS);
        let pos = &state.pos + &state.vel * h;
        let beyond = pos.gt(far);
        let before = pos.lt(near);
        let vel = (-&state.vel).where_self(&beyond, &state.vel);
        let vel = (-&vel).where_self(&before, &vel);
        let pos = (2.0 * far - &pos).where_self(&beyond, &pos);
        let pos = (2.0 * near - &pos).where_self(&pos.lt(near), &pos);
        State { pos, vel }
    }
}
