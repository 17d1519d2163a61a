//! What is controlled, at one instant.

use std::f64::consts::TAU;

/// Coordinates of all objects and their velocities, as the task's equation has them: one angle (0 is upright, positive is
/// clockwise on the screen; radians, turns included), or x and y of each object, pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlState {
    pub positions: Vec<f64>,
    /// Per time unit.
    pub velocities: Vec<f64>,
}

impl ControlState {
    /// Of one angle and its rate.
    pub fn turning(angle: f64, rate: f64) -> Self {
        ControlState { positions: vec![angle], velocities: vec![rate] }
    }

    pub fn is_finite(&self) -> bool {
        self.positions.iter().chain(&self.velocities).all(|number| number.is_finite())
    }

    /// Coordinates of all objects.
    pub fn coordinates(&self) -> usize {
        self.positions.len()
    }
}

/// An angle as one between half a turn to the left and half a turn to the right, radians.
pub fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}
