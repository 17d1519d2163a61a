//! The pendulum of the paper's section 4.3 and of OpenAI Gym.
//!
//! It differs from the dataset's pendulum in two ways. Its time step is the dataset's, 0.05 between two frames, but it takes
//! it in one Euler step, where the dataset's generator takes ten and the model's cell five. And a rate is cut off at 8,
//! where the generator throws the clip away. The torque has the same scale: `3 a u / (m l^2)`, u within the scene's largest
//! torque to either side; the dataset draws another one for each frame, an agent's is held for two.

use std::f64::consts::{FRAC_PI_2, PI};

use anyhow::{Context, Result, bail, ensure};
use rand::Rng;
use tch::Tensor;

use super::environment::{Environment, FrameFormat, Rules, check_looks, seen};
use super::model::PlainModel;
use super::reward::{GoalPath, Reward};
use super::state::ControlState;
use paig::generators::render::Bar;
use paig::generators::simulate::PENDULUM_MAX_SPEED;
use paig::network::cells::PlainPendulum;
use paig::support::random::named_generator;
use paig::tasks::Task;
use paig::tasks::scene::{BAR_HALF_WIDTH, BAR_VIEW, Look, Motion};

/// 64 x 64 pixels in colour, 0.05 time units apart.
pub const FORMAT: FrameFormat = FrameFormat { side: 64, channels: 3, dt: 0.05 };
/// The largest torque to either side, of the paper's pendulum.
pub const MAX_TORQUE: f64 = 2.0;

/// The numbers of a pendulum, and where its episodes begin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PendulumSettings {
    /// Strength of gravity; 0 and above.
    pub gravity: f64,
    /// Of the rod; above 0, and not beyond the frame's border.
    pub length: f64,
    /// Above 0.
    pub mass: f64,
    /// A torque u acts as so many u.
    pub actuation: f64,
    /// An episode begins with an angle (radians) and a rate (radians per time unit) of up to so much to either side.
    pub largest_angle: f64,
    pub largest_rate: f64,
    /// Or with this rate, in either direction.
    pub rate: Option<f64>,
}

impl Default for PendulumSettings {
    /// The paper's: from the upper half.
    fn default() -> Self {
        PendulumSettings {
            gravity: 10.0,
            length: 1.0,
            mass: 1.0,
            actuation: 1.0,
            largest_angle: FRAC_PI_2,
            largest_rate: 2.0,
            rate: None,
        }
    }
}

impl PendulumSettings {
    /// Those of a task's scene.
    ///
    /// # Errors
    /// A scene of another motion, or one that is not drawn as this environment draws.
    pub fn of(task: &Task) -> Result<Self> {
        let scene = task.scene.as_ref().with_context(|| format!("task {} has no scene", task.name))?;
        let Motion::Pendulum { g, m, length, a, torque, angle, spin } = scene.motion else {
            bail!("task {}: its scene is no pendulum's", task.name);
        };
        let in_task = || format!("task {}", task.name);
        ensure!(scene.look == Look::Bar, "task {}: control draws a pendulum as a bar, look = \"bar\"", task.name);
        check_looks(scene).with_context(in_task)?;
        FORMAT.check(&task.system).with_context(in_task)?;
        ensure!(
            torque.is_finite() && torque > 0.0,
            "task {}: nothing can act; scene.motion.torque must be above 0",
            task.name
        );
        Ok(PendulumSettings {
            gravity: g,
            length,
            mass: m,
            actuation: a,
            largest_angle: angle,
            largest_rate: spin,
            rate: None,
        })
    }

    /// Gymnasium's start.
    pub fn gymnasium() -> Self {
        PendulumSettings { largest_angle: PI, largest_rate: 1.0, ..Self::default() }
    }

    /// Angular acceleration of gravity on a rod that lies flat, `3 g / (2 l)`.
    pub fn gravity_acceleration(&self) -> f64 {
        1.5 * self.gravity / self.length
    }

    /// Angular acceleration for a torque of 1, `3 a / (m l^2)`.
    pub fn torque_acceleration(&self) -> f64 {
        3.0 * self.actuation / (self.mass * self.length.powi(2))
    }

    /// The environment's own equation, as it steps.
    pub fn model(&self) -> PlainModel {
        let [gravity, torque] = [self.gravity_acceleration(), self.torque_acceleration()].map(|x| x as f32);
        let largest_rate = PENDULUM_MAX_SPEED as f32;
        PlainModel { cell: Box::new(PlainPendulum { gravity, torque, substeps: 1, largest_rate }), dt: FORMAT.dt }
    }

    fn check(&self) -> Result<()> {
        let Self { gravity, length, mass, actuation, largest_angle, largest_rate, rate } = *self;
        let longest = BAR_VIEW - BAR_HALF_WIDTH;
        ensure!(gravity.is_finite() && gravity >= 0.0, "gravity must be a number from 0 on, not {gravity}");
        ensure!(length >= 0.1 && length <= longest, "the length must be 0.1 to {longest}, not {length}");
        ensure!(mass.is_finite() && mass >= 0.01, "the mass must be at least 0.01, not {mass}");
        ensure!(actuation.is_finite() && actuation > 0.0, "the actuation a must be above 0, not {actuation}");
        ensure!(largest_angle.is_finite(), "the largest first angle must be a number, not {largest_angle}");
        let rate = rate.unwrap_or(largest_rate);
        ensure!(rate.abs() <= PENDULUM_MAX_SPEED, "the first rate must be at most {PENDULUM_MAX_SPEED}, not {rate}");
        Ok(())
    }
}

impl Rules {
    /// The paper's: 50 steps, rewarded for being near a goal; at most 50 in all. With the first frame there are the four that
    /// the model's input takes.
    pub fn pendulum(goal: GoalPath) -> Self {
        let (reward, frames_before) = (Reward::Goal(goal), 3);
        Rules { steps: 50, hold: 2, largest_action: MAX_TORQUE, reward, frames_before }
    }

    /// Gymnasium's cost and 200 steps. An action is held for two steps, as in the other one; there for one.
    pub fn gymnasium() -> Self {
        let (reward, frames_before) = (Reward::Gymnasium, 3);
        Rules { steps: 200, hold: 2, largest_action: MAX_TORQUE, reward, frames_before }
    }
}

/// A pendulum that is drawn as the dataset's, a bar about a hub.
#[derive(Debug, Clone)]
pub struct PendulumEnvironment {
    settings: PendulumSettings,
    rules: Rules,
    angle: f64,
    rate: f64,
    /// Steps since the episode began.
    step: usize,
    bar: Bar,
    canvas: Vec<f64>,
}

impl PendulumEnvironment {
    /// At rest, upright, until it is reset.
    ///
    /// # Errors
    /// Settings out of their ranges.
    pub fn new(settings: PendulumSettings, rules: Rules) -> Result<Self> {
        settings.check()?;
        let (steps, hold) = (rules.steps, rules.hold);
        ensure!((1..=steps).contains(&hold), "an action is held for {hold} steps of an episode's {steps}");
        let bar = Bar::new(FORMAT.side, settings.length);
        let canvas = bar.canvas();
        Ok(PendulumEnvironment { settings, rules, angle: 0.0, rate: 0.0, step: 0, bar, canvas })
    }

    /// Goes on from another state.
    pub fn place(&mut self, angle: f64, rate: f64) {
        (self.angle, self.rate) = (angle, rate);
    }
}

impl Environment for PendulumEnvironment {
    fn reset(&mut self, seed: u64) {
        let mut random = named_generator(seed, "pendulum's start");
        let mut either_side = |largest: f64| largest * (2.0 * random.random::<f64>() - 1.0);
        self.angle = either_side(self.settings.largest_angle);
        let rate = either_side(self.settings.largest_rate);
        self.rate = self.settings.rate.map_or(rate, |given| given.copysign(rate));
        self.step = 0;
    }

    fn go_back(&mut self, steps: usize) {
        for _ in 0..steps {
            self.angle -= self.rate * FORMAT.dt;
            self.rate -= self.settings.gravity_acceleration() * self.angle.sin() * FORMAT.dt;
        }
    }

    fn observe(&mut self) -> Option<Tensor> {
        Some(seen(&self.bar.levels(self.angle, &mut self.canvas), FORMAT))
    }

    fn show(&mut self, positions: &[f64]) -> Option<Tensor> {
        self.place(positions[0], 0.0);
        self.observe()
    }

    fn empty_frame(&self) -> Tensor {
        seen(&vec![1.0; FORMAT.channels * FORMAT.side.pow(2)], FORMAT)
    }

    fn step(&mut self, action: f64) -> f64 {
        let torque = self.rules.within_limits(action);
        let before = self.true_state();
        let acceleration =
            self.settings.gravity_acceleration() * self.angle.sin() + self.settings.torque_acceleration() * torque;
        let rate = self.rate + acceleration * FORMAT.dt;
        // The angle goes on with the rate as it was before it is cut off.
        self.angle += rate * FORMAT.dt;
        self.rate = rate.clamp(-PENDULUM_MAX_SPEED, PENDULUM_MAX_SPEED);
        self.step += 1;
        self.rules.reward.of(self.step - 1, &before, torque, &self.true_state())
    }

    fn true_state(&self) -> ControlState {
        ControlState::turning(self.angle, self.rate)
    }

    fn rules(&self) -> &Rules {
        &self.rules
    }

    fn format(&self) -> FrameFormat {
        FORMAT
    }
}
