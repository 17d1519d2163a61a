//! Motion of a scene's objects in continuous coordinates: Euler substeps, walls, and which clips are thrown away.
//!
//! Lengths are pixels, velocities pixels per time unit, masses 1 unless said; the pendulum's angle is in radians. All in
//! f64. Original: `nn/datasets/generators.py`; paper: section 4.1 and appendix A.

use std::sync::Arc;

use anyhow::{Context, Result};
use rand::Rng;
use tch::Tensor;

use crate::network::cells::text::SingleEquation;
use crate::network::cells::{Build, CellKind, State, Walls};
use crate::tasks::scene::{Begin, Motion};

/// Draws after which a clip is given up: far more than any clip of a built-in task needs.
const MAX_DRAWS: usize = 1_000_000;

/// Gap, pixels, that three bodies keep beyond their radius: a closer approach throws more than the frames can show.
const BODY_GAP: f64 = 1.0;

/// Largest angular speed of a pendulum, radians per time unit. OpenAI Gym cuts the speed off there; a clip that gets
/// faster is redrawn instead, so that all clips obey the equation.
pub const PENDULUM_MAX_SPEED: f64 = 8.0;

/// All objects at one instant: x0, y0, x1, y1, ..; or one angle for each object, where it turns.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneState {
    pub positions: Vec<f64>,
    pub velocities: Vec<f64>,
    /// What acts from outside until the next frame, or the time for an equation that names it; otherwise 0.
    pub action: f64,
}

impl SceneState {
    /// Of objects that move in the plane, `(x, y)` each.
    pub fn in_plane(positions: Vec<[f64; 2]>, velocities: Vec<[f64; 2]>) -> Self {
        Self { positions: positions.into_flattened(), velocities: velocities.into_flattened(), action: 0.0 }
    }

    /// Positions of objects that move in the plane.
    pub fn points(&self) -> &[[f64; 2]] {
        self.positions.as_chunks().0
    }
}

/// An equation that moves the objects, and where they begin.
#[derive(Debug, Clone, PartialEq)]
pub struct InitialValueProblem {
    pub equation: Arc<CellKind>,
    /// Its unconstrained parameters.
    pub unconstrained: Vec<f64>,
    /// How much acts from outside at most, to either side.
    pub push: f64,
    pub begin: Option<Begin>,
}

impl InitialValueProblem {
    /// The state of objects between these walls a time `h` later.
    fn substep(&self, state: &mut SceneState, walls: Walls, h: f64) {
        match &self.equation.build {
            Build::Text(equation) | Build::Named(equation) => {
                let values = self
                    .equation
                    .parameters
                    .iter()
                    .zip(&self.unconstrained)
                    .map(|(it, unconstrained)| it.bounds.value(*unconstrained));
                let mut equation = SingleEquation::new(equation, &values.collect::<Vec<_>>(), walls);
                equation.substep(&mut state.positions, &mut state.velocities, state.action, h);
            }
            Build::Rust(_) => self.substep_by_tensors(state, walls, h),
        }
        if self.equation.tells_time() {
            state.action += h;
        }
    }

    fn substep_by_tensors(&self, state: &mut SceneState, walls: Walls, h: f64) {
        let _guard = tch::no_grad_guard();
        let unconstrained: Vec<_> =
            self.unconstrained.iter().map(|unconstrained| Tensor::from(*unconstrained)).collect();
        let row = |numbers: &[f64]| Tensor::from_slice(numbers).unsqueeze(0);
        let now = State { pos: row(&state.positions), vel: row(&state.velocities) };
        let action = self.equation.actions.then(|| Tensor::from_slice(&[state.action]).unsqueeze(0));
        let next = self.equation.cell(&unconstrained, walls).substep(&now, action.as_ref(), h);
        let numbers = |x: Tensor| Vec::try_from(x.select(0, 0)).expect("a float64 vector");
        (state.positions, state.velocities) = (numbers(next.pos), numbers(next.vel));
    }
}

/// The box, the law of motion and the clock.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    pub motion: Motion,
    /// What [`Motion::Equation`] follows.
    pub law: Option<InitialValueProblem>,
    /// Moving objects.
    pub objects: usize,
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
    /// Draws until a clip obeys the rules: springs, three bodies, the ball in free fall and what follows an
    /// equation without walls never touch a wall, at no
    /// substep; three bodies never come within the radius plus 1 px of each other; with `half_pane` both balls lie wholly
    /// in the left half until frame `pane_frames`; a pendulum never exceeds [`PENDULUM_MAX_SPEED`]. The rules also hold for
    /// one interval past the last frame, as in the original, and, unlike there, for the initial state itself (so no first
    /// frame shows a ball cut by the border).
    ///
    /// # Errors
    /// No such clip in a million draws: the settings all but rule one out.
    pub fn clip(&self, frames: usize, rng: &mut impl Rng) -> Result<Vec<SceneState>> {
        (0..MAX_DRAWS).find_map(|_| self.try_clip(frames, rng)).with_context(|| {
            format!(
                "no clip of {frames} frames keeps the rules in {MAX_DRAWS} draws with {:?}, speed {:?}, side {}; \
                 lower the speed, enlarge the frame or weaken what drives the motion",
                self.motion, self.speed, self.side
            )
        })
    }

    /// One draw; `None` where it breaks a rule.
    fn try_clip(&self, frames: usize, rng: &mut impl Rng) -> Option<Vec<SceneState>> {
        let mut state = self.draw_initial(rng);
        let mut clip = Vec::with_capacity(frames);
        if !self.allowed(&state, 0) {
            return None;
        }
        for frame in 0..frames {
            state.action = self.held(frame, rng);
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

    /// What the dataset holds for a frame.
    fn held(&self, frame: usize, rng: &mut impl Rng) -> f64 {
        match &self.law {
            Some(law) if law.equation.tells_time() => frame as f64 * self.dt,
            _ => self.draw_action(rng),
        }
    }

    /// The states of a clip from another start, with the same actions and whatever rule they break.
    pub(crate) fn replay(&self, clip: &[SceneState], positions: &[f64], velocities: &[f64]) -> Vec<SceneState> {
        let mut state = SceneState { positions: positions.to_vec(), velocities: velocities.to_vec(), action: 0.0 };
        let frame = |as_before: &SceneState| {
            state.action = as_before.action;
            let now = state.clone();
            (0..self.substeps).for_each(|_| self.substep(&mut state));
            now
        };
        clip.iter().map(frame).collect()
    }

    /// Advances by `dt / substeps`: velocity first, then position with the new velocity; between walls (bouncing)
    /// position first, then the reflection.
    pub fn substep(&self, state: &mut SceneState) {
        let h = self.dt / self.substeps as f64;
        match self.motion {
            Motion::Equation {} => {
                let walls = Walls { near: self.wall_margin, far: self.side - self.wall_margin };
                self.law.iter().for_each(|law| law.substep(state, walls, h));
            }
            Motion::Bouncing {} => {
                drift(state, h);
                self.reflect(state);
            }
            Motion::Spring { k, equil, damping, .. } => {
                let d = difference(state.points()[0], state.points()[1]);
                let length = norm(d);
                // Two bodies in one place have no direction to push in.
                let scale = if length > 0.0 { h * k * (length - 2.0 * equil) / length } else { 0.0 };
                for (axis, d) in d.iter().enumerate() {
                    let [first, second] = [axis, 2 + axis].map(|entry| h * damping * state.velocities[entry]);
                    state.velocities[axis] -= scale * d;
                    state.velocities[axis] -= first;
                    state.velocities[2 + axis] += scale * d;
                    state.velocities[2 + axis] -= second;
                }
                drift(state, h);
            }
            Motion::ThreeBodies { g, m } => {
                let pull = |a: usize, b: usize| {
                    let d = difference(state.points()[a], state.points()[b]);
                    let cubed = norm(d).powi(3);
                    [d[0] / cubed, d[1] / cubed]
                };
                let (f01, f12, f20) = (pull(0, 1), pull(1, 2), pull(2, 0));
                // The original leaves out the division by the body's mass; g and m only enter as g m^2.
                let a = h * g * m * m;
                for axis in 0..2 {
                    state.velocities[axis] -= a * (f01[axis] - f20[axis]);
                    state.velocities[2 + axis] -= a * (f12[axis] - f01[axis]);
                    state.velocities[4 + axis] -= a * (f20[axis] - f12[axis]);
                }
                drift(state, h);
            }
            Motion::Falling { g, bounces } => {
                state.velocities.iter_mut().skip(1).step_by(2).for_each(|down| *down += h * g);
                drift(state, h);
                if bounces {
                    self.reflect(state);
                }
            }
            Motion::Pendulum { g, m, length, a, .. } => {
                let torque = a * state.action / (m * length * length);
                let accelerations = state.positions.iter().map(|angle| 1.5 * g / length * angle.sin() + 3.0 * torque);
                for (velocity, acceleration) in state.velocities.iter_mut().zip(accelerations) {
                    *velocity += h * acceleration;
                }
                drift(state, h);
            }
        }
    }

    /// Turns back what has passed a wall.
    fn reflect(&self, state: &mut SceneState) {
        let (near, far) = (self.wall_margin, self.side - self.wall_margin);
        for (position, velocity) in state.positions.iter_mut().zip(&mut state.velocities) {
            if *position > far {
                *velocity = -*velocity;
                *position = 2.0 * far - *position;
            }
            if *position < near {
                *velocity = -*velocity;
                *position = 2.0 * near - *position;
            }
        }
    }

    /// Whether a clip may hold this state on its way to `frame` (0 for the initial state).
    fn allowed(&self, state: &SceneState, frame: usize) -> bool {
        match self.motion {
            Motion::Bouncing {} | Motion::Falling { bounces: true, .. } => true,
            Motion::Falling { bounces: false, .. } => self.clear_of_walls(state),
            Motion::Equation {} if self.law.as_ref().is_some_and(|law| law.equation.walls) => {
                state.positions.iter().chain(&state.velocities).all(|number| number.is_finite())
            }
            Motion::Equation {} => self.clear_of_walls(state),
            Motion::Pendulum { .. } => state.velocities.iter().all(|speed| speed.abs() <= PENDULUM_MAX_SPEED),
            Motion::Spring { half_pane, .. } => {
                let limit = self.side / 2.0 - self.wall_margin;
                let in_pane = || state.points().iter().all(|position| position[0] < limit);
                self.clear_of_walls(state) && (!half_pane || frame >= self.pane_frames || in_pane())
            }
            Motion::ThreeBodies { .. } => {
                let p = state.points();
                let apart = |a: usize, b: usize| norm(difference(p[a], p[b])) > self.radius + BODY_GAP;
                self.clear_of_walls(state) && apart(0, 1) && apart(1, 2) && apart(2, 0)
            }
        }
    }

    fn clear_of_walls(&self, state: &SceneState) -> bool {
        let inside = self.wall_margin..self.side - self.wall_margin;
        state.positions.iter().all(|&x| x > inside.start && x < inside.end)
    }
}

/// Moves along the velocities for a time `h`.
fn drift(state: &mut SceneState, h: f64) {
    for (position, velocity) in state.positions.iter_mut().zip(&state.velocities) {
        *position += h * velocity;
    }
}

fn difference(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn norm(d: [f64; 2]) -> f64 {
    (d[0] * d[0] + d[1] * d[1]).sqrt()
}
