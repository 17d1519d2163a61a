//! Motion of a scene's objects in continuous coordinates: Euler substeps, walls, and which clips are thrown away.
//!
//! Lengths are pixels, velocities pixels per time unit, masses 1 unless said. All in f64. Original:
//! `nn/datasets/generators.py`; paper: section 4.1 and appendix A.

use anyhow::{Context, Result};
use rand::Rng;

use super::scene::Motion;

/// Draws after which a clip is given up: far more than any clip of the task table needs.
const MAX_DRAWS: usize = 1_000_000;

/// Gap, pixels, that three bodies keep beyond their radius: a closer approach throws more than the frames can show.
const BODY_GAP: f64 = 1.0;

/// Positions `(x, y)` and velocities of all objects at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    pub positions: Vec<[f64; 2]>,
    pub velocities: Vec<[f64; 2]>,
}

/// The box, the law of motion and the clock.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    pub motion: Motion,
    /// Amplitudes of the initial velocity on each axis.
    pub speed: [f64; 2],
    /// Half the width of an object; places the first positions.
    pub radius: f64,
    /// Distance of an object's centre from a wall at which it touches. The radius for balls; less for digits, whose
    /// sprites may hang over the border.
    pub wall_margin: f64,
    /// Side of the square box.
    pub side: f64,
    /// Time units between two frames.
    pub dt: f64,
    /// Euler steps a frame.
    pub substeps: usize,
    /// Frames, from the first, for which [`Motion::Spring`]'s `half_pane` holds.
    pub pane_frames: usize,
}

impl World {
    /// States at the `frames` frames of one clip: the first is the drawn initial state, each next one is `dt` later.
    ///
    /// Draws until a clip obeys the rules: springs and three bodies never touch a wall, at no substep; three bodies
    /// never come within the radius plus 1 px of each other; with `half_pane` both balls lie wholly in the left half
    /// until frame `pane_frames`. The rules also hold for one interval past the last frame, as in the original, and,
    /// unlike there, for the initial state itself (so no first frame shows a ball cut by the border).
    ///
    /// # Errors
    /// No such clip in a million draws: the settings all but rule one out.
    pub fn clip(&self, frames: usize, rng: &mut impl Rng) -> Result<Vec<State>> {
        (0..MAX_DRAWS).find_map(|_| self.try_clip(frames, rng)).with_context(|| {
            format!(
                "no clip of {frames} frames keeps the rules in {MAX_DRAWS} draws with {:?}, speed {:?}, side {}; \
                 lower the speed, enlarge the frame or shorten the spring",
                self.motion, self.speed, self.side
            )
        })
    }

    /// One draw; `None` where it breaks a rule.
    fn try_clip(&self, frames: usize, rng: &mut impl Rng) -> Option<Vec<State>> {
        let mut state = self.draw_initial(rng);
        let mut clip = Vec::with_capacity(frames);
        if !self.allowed(&state, 0) {
            return None;
        }
        for frame in 0..frames {
            clip.push(state.clone());
            for _ in 0..self.substeps {
                self.substep(&mut state);
                if !self.allowed(&state, frame + 1) {
                    return None;
                }
            }
        }
        Some(clip)
    }

    /// Advances by `dt / substeps`: velocity first, then position with the new velocity; between walls (bouncing)
    /// position first, then the reflection.
    pub fn substep(&self, state: &mut State) {
        let h = self.dt / self.substeps as f64;
        match self.motion {
            Motion::Bouncing => {
                drift(state, h);
                self.reflect(state);
            }
            Motion::Spring { k, equil, .. } => {
                let d = difference(state.positions[0], state.positions[1]);
                let length = norm(d);
                // Two bodies in one place have no direction to push in.
                let scale = if length > 0.0 { h * k * (length - 2.0 * equil) / length } else { 0.0 };
                for (axis, d) in d.iter().enumerate() {
                    state.velocities[0][axis] -= scale * d;
                    state.velocities[1][axis] += scale * d;
                }
                drift(state, h);
            }
            Motion::ThreeBodies { g, m } => {
                let pull = |a: usize, b: usize| {
                    let d = difference(state.positions[a], state.positions[b]);
                    let cubed = norm(d).powi(3);
                    [d[0] / cubed, d[1] / cubed]
                };
                let (f01, f12, f20) = (pull(0, 1), pull(1, 2), pull(2, 0));
                // The original leaves out the division by the body's mass; g and m only enter as g m^2.
                let a = h * g * m * m;
                for axis in 0..2 {
                    state.velocities[0][axis] -= a * (f01[axis] - f20[axis]);
                    state.velocities[1][axis] -= a * (f12[axis] - f01[axis]);
                    state.velocities[2][axis] -= a * (f20[axis] - f12[axis]);
                }
                drift(state, h);
            }
        }
    }

    /// Turns back what has passed a wall.
    fn reflect(&self, state: &mut State) {
        let (near, far) = (self.wall_margin, self.side - self.wall_margin);
        for (position, velocity) in state.positions.iter_mut().zip(&mut state.velocities) {
            for axis in 0..2 {
                if position[axis] > far {
                    velocity[axis] = -velocity[axis];
                    position[axis] = 2.0 * far - position[axis];
                }
                if position[axis] < near {
                    velocity[axis] = -velocity[axis];
                    position[axis] = 2.0 * near - position[axis];
                }
            }
        }
    }

    /// Whether a clip may hold this state on its way to `frame` (0 for the initial state).
    fn allowed(&self, state: &State, frame: usize) -> bool {
        match self.motion {
            Motion::Bouncing => true,
            Motion::Spring { half_pane, .. } => {
                let limit = self.side / 2.0 - self.wall_margin;
                let in_pane = || state.positions.iter().all(|position| position[0] < limit);
                self.clear_of_walls(state) && (!half_pane || frame >= self.pane_frames || in_pane())
            }
            Motion::ThreeBodies { .. } => {
                let p = &state.positions;
                let apart = |a: usize, b: usize| norm(difference(p[a], p[b])) > self.radius + BODY_GAP;
                self.clear_of_walls(state) && apart(0, 1) && apart(1, 2) && apart(2, 0)
            }
        }
    }

    fn clear_of_walls(&self, state: &State) -> bool {
        let inside = self.wall_margin..self.side - self.wall_margin;
        state.positions.iter().flatten().all(|&x| x > inside.start && x < inside.end)
    }
}

/// Moves along the velocities for a time `h`.
fn drift(state: &mut State, h: f64) {
    for (position, velocity) in state.positions.iter_mut().zip(&state.velocities) {
        position[0] += h * velocity[0];
        position[1] += h * velocity[1];
    }
}

fn difference(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn norm(d: [f64; 2]) -> f64 {
    (d[0] * d[0] + d[1] * d[1]).sqrt()
}
