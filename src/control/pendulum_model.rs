//! The pendulum in plain numbers: the same as its cell, without a tensor for each substep.

use anyhow::Result;

use super::environment::{PendulumSettings, STEP};
use super::model::{Model, Plans, Trajectories};
use super::reward::PendulumState;
use crate::generators::simulate::PENDULUM_MAX_SPEED;
use crate::network::cells::SUBSTEPS;

/// `angle'' = gravity sin(angle) + torque u` in Euler steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PendulumModel {
    gravity: f32,
    torque: f32,
    /// Time units of an Euler step, and how many make a frame.
    h: f32,
    substeps: usize,
    /// Where a rate is cut off after each Euler step.
    largest_rate: f32,
}

impl PendulumModel {
    /// As the pendulum's cell with these parameters has it, `dt` time units a frame.
    pub fn of_cell(g: f64, a: f64, dt: f64) -> Self {
        let h = (dt / SUBSTEPS as f64) as f32;
        let [gravity, torque] = [1.5 * g, 3.0 * a].map(|x| x as f32);
        PendulumModel { gravity, torque, h, substeps: SUBSTEPS, largest_rate: f32::INFINITY }
    }

    /// As the environment itself moves.
    pub fn of_environment(settings: &PendulumSettings) -> Self {
        let [gravity, torque] = [settings.gravity_acceleration(), settings.torque_acceleration()].map(|x| x as f32);
        PendulumModel { gravity, torque, h: STEP as f32, substeps: 1, largest_rate: PENDULUM_MAX_SPEED as f32 }
    }
}

impl Model for PendulumModel {
    fn roll_out(&self, start: PendulumState, plans: &Plans) -> Result<Trajectories> {
        let states = plans.candidates() * plans.steps();
        let (mut angles, mut rates) = (Vec::with_capacity(states), Vec::with_capacity(states));
        for torques in plans.torques.chunks_exact(plans.decisions) {
            let (mut angle, mut rate) = (start.angle as f32, start.rate as f32);
            for torque in torques {
                let push = self.torque * torque;
                for _ in 0..plans.hold {
                    for _ in 0..self.substeps {
                        rate += (self.gravity * angle.sin() + push) * self.h;
                        angle += rate * self.h;
                        rate = rate.clamp(-self.largest_rate, self.largest_rate);
                    }
                    angles.push(angle);
                    rates.push(rate);
                }
            }
        }
        Ok(Trajectories { angles, rates })
    }
}
