//! Where an agent acts: it sees frames and sends torques.
//!
//! The pendulum of the paper's section 4.3 and of OpenAI Gym. It differs from the dataset's pendulum in two ways. Its
//! time step is the dataset's, 0.05 between two frames, but it takes it in one Euler step, where the dataset's generator
//! takes ten and the model's cell five. And a rate is cut off at 8, where the generator throws the clip away. The torque has
//! the same scale: `3 u / (m l^2)`, u within 2 to either side; the dataset draws another one for each frame, an agent's is
//! held for two.

use std::f64::consts::{FRAC_PI_2, PI};

use anyhow::{Result, ensure};
use rand::Rng;
use tch::{Kind, Tensor};

use super::reward::{PendulumState, Reward};
use crate::generators::film::quantise;
use crate::generators::render::Bar;
use crate::generators::simulate::PENDULUM_MAX_SPEED;
use crate::support::random::named_generator;
use crate::tasks::scene::{BAR_HALF_WIDTH, BAR_VIEW};

/// Side of the frames, pixels, and their channels.
pub const SIDE: usize = 64;
pub const CHANNELS: usize = 3;
/// Time units of one step, from frame to frame.
pub const STEP: f64 = 0.05;
/// The largest torque to either side.
pub const MAX_TORQUE: f64 = 2.0;

/// A world of which frames are seen.
pub trait Environment {
    /// Begins an episode; equal seeds begin equally.
    fn reset(&mut self, seed: u64);
    /// What is seen now: float32 `[channels, S, S]` in \[0, 1\], in grey levels as a dataset's frames.
    fn observe(&mut self) -> Tensor;
    /// Acts for one step, from this frame to the next, and returns the step's reward. An action beyond the limits acts as
    /// the nearest one within; one that is no number as 0.
    fn step(&mut self, action: f64) -> f64;
    /// For scores and for the planners that are bounds; nothing that sees may read it.
    fn true_state(&self) -> PendulumState;
    /// Steps of an episode.
    fn steps(&self) -> usize;
    /// Steps for which an action is held.
    fn hold(&self) -> usize;
    fn reward(&self) -> Reward;
}

/// The numbers of a pendulum and of its episodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PendulumSettings {
    /// Strength of gravity; 0 and above.
    pub gravity: f64,
    /// Of the rod; above 0, and not beyond the frame's border.
    pub length: f64,
    /// Above 0.
    pub mass: f64,
    /// An episode begins with an angle (radians) and a rate (radians per time unit) of up to so much to either side.
    pub largest_angle: f64,
    pub largest_rate: f64,
    /// Steps of an episode, and for how many of them an action is held.
    pub steps: usize,
    pub hold: usize,
    pub reward: Reward,
}

impl PendulumSettings {
    /// The paper's: 50 steps from the upper half, rewarded for being near a goal (radians). At most 50 in all.
    pub fn to_goal(goal: f64) -> Self {
        let (largest_angle, largest_rate) = (FRAC_PI_2, 2.0);
        let (gravity, length, mass, reward) = (10.0, 1.0, 1.0, Reward::Goal(goal));
        PendulumSettings { gravity, length, mass, largest_angle, largest_rate, steps: 50, hold: 2, reward }
    }

    /// Gymnasium's start, cost and 200 steps. An action is held for two steps, as in the other one; there for one.
    pub fn gymnasium() -> Self {
        let upright = Self::to_goal(0.0);
        PendulumSettings { largest_angle: PI, largest_rate: 1.0, steps: 200, reward: Reward::Gymnasium, ..upright }
    }

    /// Angular acceleration of gravity on a rod that lies flat, `3 g / (2 l)`.
    pub fn gravity_acceleration(&self) -> f64 {
        1.5 * self.gravity / self.length
    }

    /// Angular acceleration for a torque of 1, `3 / (m l^2)`.
    pub fn torque_acceleration(&self) -> f64 {
        3.0 / (self.mass * self.length.powi(2))
    }

    fn check(&self) -> Result<()> {
        let Self { gravity, length, mass, steps, hold, .. } = *self;
        let longest = BAR_VIEW - BAR_HALF_WIDTH;
        ensure!(gravity.is_finite() && gravity >= 0.0, "gravity must be a number from 0 on, not {gravity}");
        ensure!(length >= 0.1 && length <= longest, "the length must be 0.1 to {longest}, not {length}");
        ensure!(mass.is_finite() && mass >= 0.01, "the mass must be at least 0.01, not {mass}");
        ensure!((1..=steps).contains(&hold), "an action is held for {hold} steps of an episode's {steps}");
        Ok(())
    }
}

/// A pendulum that is drawn as the dataset's, a bar about a hub.
#[derive(Debug, Clone)]
pub struct PendulumEnvironment {
    settings: PendulumSettings,
    state: PendulumState,
    bar: Bar,
    canvas: Vec<f64>,
}

impl PendulumEnvironment {
    /// At rest, upright, until it is reset.
    ///
    /// # Errors
    /// Settings out of their ranges.
    pub fn new(settings: PendulumSettings) -> Result<Self> {
        settings.check()?;
        let bar = Bar::new(SIDE, settings.length);
        let canvas = bar.canvas();
        Ok(PendulumEnvironment { settings, state: PendulumState { angle: 0.0, rate: 0.0 }, bar, canvas })
    }

    /// Goes on from another state.
    pub fn place(&mut self, state: PendulumState) {
        self.state = state;
    }
}

impl Environment for PendulumEnvironment {
    fn reset(&mut self, seed: u64) {
        let mut random = named_generator(seed, "pendulum's start");
        let mut either_side = |largest: f64| largest * (2.0 * random.random::<f64>() - 1.0);
        let angle = either_side(self.settings.largest_angle);
        self.state = PendulumState { angle, rate: either_side(self.settings.largest_rate) };
    }

    fn observe(&mut self) -> Tensor {
        let levels = self.bar.levels(self.state.angle, &mut self.canvas);
        let mut pixels = vec![0; SIDE * SIDE * CHANNELS];
        quantise(&levels, CHANNELS, &mut pixels);
        let pixels = Tensor::from_slice(&pixels).reshape([SIDE as i64, SIDE as i64, CHANNELS as i64]);
        pixels.permute([2, 0, 1]).contiguous().to_kind(Kind::Float) / 255.0
    }

    fn step(&mut self, action: f64) -> f64 {
        let torque = if action.is_nan() { 0.0 } else { action.clamp(-MAX_TORQUE, MAX_TORQUE) };
        let (settings, before) = (&self.settings, self.state);
        let acceleration =
            settings.gravity_acceleration() * before.angle.sin() + settings.torque_acceleration() * torque;
        let rate = before.rate + acceleration * STEP;
        // The angle goes on with the rate as it was before it is cut off.
        let angle = before.angle + rate * STEP;
        self.state = PendulumState { angle, rate: rate.clamp(-PENDULUM_MAX_SPEED, PENDULUM_MAX_SPEED) };
        settings.reward.of(before, torque, self.state)
    }

    fn true_state(&self) -> PendulumState {
        self.state
    }

    fn steps(&self) -> usize {
        self.settings.steps
    }

    fn hold(&self) -> usize {
        self.settings.hold
    }

    fn reward(&self) -> Reward {
        self.settings.reward
    }
}
