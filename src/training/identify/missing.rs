//! Whether a force is missing in an equation that explains the motion.
//!
//! Each clip has a first state of its own, which takes up much of what a missing force does. The rest grows with the time,
//! unlike what the seeing is off by: so it shows where a whole clip leaves more than its first half alone. `measure` holds a
//! whole video against its pieces in the same way.

use anyhow::Result;

use super::Identify;
use super::encoded_positions::EncodedPositions;
use super::explain::{Explanation, own_residual};
use super::fit::{Fit, FitStart, fit};
use crate::network::physics_models::PhysicsNet;

/// Numbers of a state for each coordinate of a frame: place and velocity.
const STATE: usize = 2;
/// A whole clip leaves more than so many times what its half does, and so many pixels beyond it. Where nothing is missing (90 runs
/// of the tasks, the stress scenes and the gallery) it was up to 1.2 times as much, and where that was more, less than 0.03 px.
const MORE: f64 = 1.3;
const LEAST_MORE: f64 = 0.03;

/// What an equation leaves of positions, each for as many free numbers, in their unit.
#[derive(Debug, Clone, Copy)]
pub struct PositionResiduals {
    /// Of whole clips.
    pub whole: f64,
    /// Of their first halves, where nothing but the states is fitted to them.
    pub half: f64,
    /// A pixel in that unit.
    pub pixel: f64,
}

impl PositionResiduals {
    /// Of what was explained, with the same settings; None where half a clip is too short.
    ///
    /// # Errors
    /// None of a motion that was explained.
    pub fn of(
        config: &Identify,
        model: &PhysicsNet,
        seen: &EncodedPositions,
        explanation: &Explanation,
    ) -> Result<Option<Self>> {
        let Explanation { fit: whole, fitted, trust, .. } = explanation;
        let frames = whole.residuals.size()[1] as usize;
        let half = frames / 2;
        if half <= STATE + 1 {
            return Ok(None);
        }
        let start = FitStart {
            unconstrained: whole.unconstrained.clone(),
            learned: vec![false; whole.unconstrained.len()],
            free_offsets: false,
            states: Some(whole.states.shallow_clone()),
        };
        let config = Identify { horizons: vec![half], ..config.clone() };
        let halves = fit(&config, &model.system, fitted, &seen.actions, &start, trust)?;
        let left = |fit: &Fit, frames: usize| {
            own_residual(&model.system, fit, trust) * (frames as f64 / (frames - STATE) as f64).sqrt()
        };
        let (whole, half) = (left(whole, frames), left(&halves, half));
        Ok(Some(PositionResiduals { whole, half, pixel: seen.pixel(&model.system) }))
    }

    /// Whether a force is missing.
    pub fn misses_a_force(&self) -> bool {
        let more = (self.whole.powi(2) - self.half.powi(2)).max(0.0).sqrt();
        self.whole > MORE * self.half && more > LEAST_MORE * self.pixel
    }
}
