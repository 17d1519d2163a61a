//! What a step of a pendulum is worth.

use std::f64::consts::{PI, TAU};

/// A pendulum at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PendulumState {
    /// 0 is upright, positive is clockwise on the screen; radians, turns included.
    pub angle: f64,
    /// Radians per time unit.
    pub rate: f64,
}

impl PendulumState {
    pub fn is_finite(self) -> bool {
        self.angle.is_finite() && self.rate.is_finite()
    }
}

/// What a step is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reward {
    /// `1 - |angle - goal| / pi` of the state after the step, the difference wrapped to half a turn: 0..1. The goal is in
    /// radians.
    Goal(f64),
    /// Gymnasium's `-(angle^2 + 0.1 rate^2 + 0.001 torque^2)` of the state before the step, the angle wrapped to half a
    /// turn: about -16.3..0.
    Gymnasium,
}

impl Reward {
    /// The reward of one step under a torque.
    pub fn of(self, before: PendulumState, torque: f64, after: PendulumState) -> f64 {
        match self {
            Reward::Goal(goal) => 1.0 - wrapped(after.angle - goal).abs() / PI,
            Reward::Gymnasium => -(wrapped(before.angle).powi(2) + 0.1 * before.rate.powi(2) + 0.001 * torque.powi(2)),
        }
    }
}

/// An angle as one between half a turn to the left and half a turn to the right, radians.
pub fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}
