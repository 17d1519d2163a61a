//! The pendulum in plain numbers: the same as its cell, without a tensor for each substep.

use std::f32::consts::FRAC_1_PI;

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
        let (candidates, steps) = (plans.candidates(), plans.steps());
        let (mut angles, mut rates) = (vec![0.0; candidates * steps], vec![0.0; candidates * steps]);
        let (mut angle, mut rate) = (vec![start.angle as f32; candidates], vec![start.rate as f32; candidates]);
        let mut push = vec![0.0; candidates];
        // Candidates innermost: several of them fit into a register.
        for step in 0..steps {
            for (push, torques) in push.iter_mut().zip(plans.torques.chunks_exact(plans.decisions)) {
                *push = self.torque * torques[step / plans.hold];
            }
            for _ in 0..self.substeps {
                for ((angle, rate), push) in angle.iter_mut().zip(&mut rate).zip(&push) {
                    let faster = *rate + (self.gravity * sine(*angle) + push) * self.h;
                    *angle += faster * self.h;
                    *rate = faster.clamp(-self.largest_rate, self.largest_rate);
                }
            }
            for (all, now) in [(&mut angles, &angle), (&mut rates, &rate)] {
                all.iter_mut().skip(step).step_by(steps).zip(now).for_each(|(slot, value)| *slot = *value);
            }
        }
        Ok(Trajectories { angles, rates })
    }
}

/// Added and taken off again, this rounds a number of up to some millions to a whole one.
const ROUNDS: f32 = 12_582_912.0;

/// The sine, to some 1e-6 within a hundred turns. Without a branch or a call, so that several are computed at a time: the
/// library's own takes some three times as long, which is most of a plan.
fn sine(x: f32) -> f32 {
    let half_turns = (x * FRAC_1_PI + ROUNDS) - ROUNDS;
    // Pi in two parts: the first has so few digits that its multiples are exact.
    let rest = (x - half_turns * 3.140_625) - half_turns * 9.676_536e-4;
    let odd = (half_turns - 2.0 * ((half_turns * 0.5 + ROUNDS) - ROUNDS)).abs();
    let square = rest * rest;
    // Taylor's series; within a quarter turn the next term is below 1e-7.
    let series = [-1.0 / 39_916_800.0, 1.0 / 362_880.0, -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0];
    (1.0 - 2.0 * odd) * rest * series.into_iter().fold(0.0, |sum, factor| sum * square + factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sine_is_the_sine() {
        for i in -60_000..60_000 {
            let x = i as f32 * 0.01;
            // What is left of a large angle has its rounding: 6e-8 of 600.
            let error = (f64::from(sine(x)) - f64::from(x).sin()).abs();
            assert!(error < 4e-7 + 1e-7 * f64::from(x).abs(), "sine of {x}: off by {error}");
        }
        assert!(sine(f32::NAN).is_nan() && sine(f32::INFINITY).is_nan());
    }
}
