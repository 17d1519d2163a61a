//! What is controlled, at one instant.

use std::f64::consts::TAU;

/// Coordinates of all objects and their velocities, as the task's equation has them: one angle (0 is upright, positive is
/// clockwise on the screen; radians, turns included), or x and y of each object, pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct ControlState {
    pub positions: Vec<f64>,
    /// Per time unit.
    pub velocities: Vec<f64>,
    /// The frames before, the last one last, as far as they are known and a model asks for them: an equation does not.
    pub before: Vec<PastFrame>,
}

/// A frame that has passed.
#[derive(Debug, Clone, PartialEq)]
pub struct PastFrame {
    pub positions: Vec<f64>,
    /// What acted from then to the next frame.
    pub action: f64,
}

impl ControlState {
    /// Of which nothing is known of before.
    pub fn new(positions: Vec<f64>, velocities: Vec<f64>) -> Self {
        ControlState { positions, velocities, before: Vec::new() }
    }

    /// Of one angle and its rate.
    pub fn turning(angle: f64, rate: f64) -> Self {
        Self::new(vec![angle], vec![rate])
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
