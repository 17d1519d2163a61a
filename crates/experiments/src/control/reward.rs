//! What a step is worth.

use std::f32::consts::{FRAC_1_PI, TAU};
use std::f64::consts::PI;

use super::plans::{Plans, Trajectories};
use super::state::{ControlState, wrapped};
use paig::support::fast_math::nearest;

/// Where to be, at each step of an episode.
#[derive(Debug, Clone, PartialEq)]
pub struct GoalPath {
    /// One angle, radians, or x and y of the first object, pixels.
    pub place: Vec<f64>,
    /// The distance at which a step is worth nothing: half a turn, or the side of the frame.
    pub scale: f64,
    /// By how much a moving goal swings to either side of its place, along its first coordinate.
    pub swing: f64,
    /// Steps of a full swing.
    pub period: f64,
}

impl GoalPath {
    /// An angle, radians.
    pub fn angle(angle: f64) -> Self {
        GoalPath { place: vec![angle], scale: PI, swing: 0.0, period: 1.0 }
    }

    /// A point in a frame of this side, pixels.
    pub fn point(place: [f64; 2], side: f64) -> Self {
        GoalPath { place: place.to_vec(), scale: side, swing: 0.0, period: 1.0 }
    }

    /// The same goal on the move.
    pub fn swinging(self, swing: f64, period: f64) -> Self {
        GoalPath { swing, period, ..self }
    }

    /// A coordinate of it after so many steps of an episode.
    pub fn at(&self, coordinate: usize, step: usize) -> f64 {
        let swings = coordinate == 0 && self.swing != 0.0;
        let swing = if swings { self.swing * (2.0 * PI * step as f64 / self.period).sin() } else { 0.0 };
        self.place[coordinate] + swing
    }

    /// How far a state is from it after so many steps, radians or pixels.
    pub fn distance(&self, state: &ControlState, step: usize) -> f64 {
        match self.place.len() {
            1 => wrapped(state.positions[0] - self.at(0, step)).abs(),
            _ => (state.positions[0] - self.at(0, step)).hypot(state.positions[1] - self.at(1, step)),
        }
    }
}

/// What a step is worth.
#[derive(Debug, Clone, PartialEq)]
pub enum Reward {
    /// `1 - distance / scale` of the state after the step. Of an angle: `1 - |angle - goal| / pi`, 0..1, the difference
    /// wrapped to half a turn.
    Goal(GoalPath),
    /// Gymnasium's `-(angle^2 + 0.1 rate^2 + 0.001 torque^2)` of the state before the step, the angle wrapped to half a
    /// turn: about -16.3..0.
    Gymnasium,
}

impl Reward {
    /// The reward of an episode's step number `step`, from 0 on, under an action.
    pub fn of(&self, step: usize, before: &ControlState, action: f64, after: &ControlState) -> f64 {
        match self {
            Reward::Goal(goal) => 1.0 - goal.distance(after, step + 1) / goal.scale,
            Reward::Gymnasium => {
                let (angle, rate) = (wrapped(before.positions[0]), before.velocities[0]);
                -(angle.powi(2) + 0.1 * rate.powi(2) + 0.001 * action.powi(2))
            }
        }
    }

    /// What plans are worth that begin at this step in this state and lead along these trajectories; `returns`
    /// (`[candidates]`) are replaced. Not a number where a trajectory is none.
    pub fn returns(
        &self,
        step: usize,
        start: &ControlState,
        plans: &Plans,
        trajectories: &Trajectories,
        returns: &mut [f32],
    ) {
        returns.fill(0.0);
        for ahead in 0..plans.steps() {
            match self {
                Reward::Goal(goal) => {
                    let off = |coordinate: usize| goal.at(coordinate, step + ahead + 1) as f32;
                    let scale = (1.0 / goal.scale) as f32;
                    match goal.place.len() {
                        1 => near_angle(trajectories.position(ahead, 0), off(0), returns),
                        _ => {
                            let [x, y] = [0, 1].map(|axis| trajectories.position(ahead, axis));
                            near_point([x, y], [off(0), off(1)], scale, returns);
                        }
                    }
                }
                Reward::Gymnasium => {
                    let torques = plans.at(ahead);
                    if ahead == 0 {
                        let [angle, rate] = [start.positions[0], start.velocities[0]].map(|x| x as f32);
                        returns.iter_mut().zip(torques).for_each(|(sum, torque)| *sum -= cost(angle, rate, *torque));
                        continue;
                    }
                    let [angles, rates] = [trajectories.position(ahead - 1, 0), trajectories.velocity(ahead - 1, 0)];
                    for (((sum, angle), rate), torque) in returns.iter_mut().zip(angles).zip(rates).zip(torques) {
                        *sum -= cost(*angle, *rate, *torque);
                    }
                }
            }
        }
    }
}

fn near_angle(angles: &[f32], goal: f32, returns: &mut [f32]) {
    for (sum, angle) in returns.iter_mut().zip(angles) {
        *sum += 1.0 - turned_back(*angle - goal).abs() * FRAC_1_PI;
    }
}

fn near_point([x, y]: [&[f32]; 2], goal: [f32; 2], scale: f32, returns: &mut [f32]) {
    for ((sum, x), y) in returns.iter_mut().zip(x).zip(y) {
        let (x, y) = (x - goal[0], y - goal[1]);
        *sum += 1.0 - (x * x + y * y).sqrt() * scale;
    }
}

/// Gymnasium's cost of a step.
fn cost(angle: f32, rate: f32, torque: f32) -> f32 {
    let angle = turned_back(angle);
    angle * angle + 0.1 * rate * rate + 0.001 * torque * torque
}

/// As [`wrapped`], several at a time.
fn turned_back(angle: f32) -> f32 {
    angle - TAU * nearest(angle * (0.5 * FRAC_1_PI))
}
