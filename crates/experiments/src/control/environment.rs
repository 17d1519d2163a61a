//! Where an agent acts: it sees frames and sends actions.

use anyhow::{Result, ensure};
use tch::{Kind, Tensor};

use super::reward::Reward;
use super::state::ControlState;
use paig::generators::film::quantise;
use paig::network::System;
use paig::tasks::scene::{Background, Scene};

/// What an episode is.
#[derive(Debug, Clone, PartialEq)]
pub struct Rules {
    /// Steps of an episode, and for how many of them an action is held.
    pub steps: usize,
    pub hold: usize,
    /// The largest action, to either side.
    pub largest_action: f64,
    pub reward: Reward,
    /// Frames that the camera has delivered before an episode begins, while nothing acted.
    pub frames_before: usize,
}

/// What a camera delivers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameFormat {
    /// Side of the square frames, pixels, and their channels.
    pub side: usize,
    pub channels: usize,
    /// Time units of one step, from frame to frame.
    pub dt: f64,
}

impl FrameFormat {
    /// Whether a model of such a system can see these frames.
    ///
    /// # Errors
    /// Frames of another side, with other channels, or at other times.
    pub fn check(self, system: &System) -> Result<()> {
        let FrameFormat { side, channels, dt } = self;
        ensure!(
            (system.side, system.channels) == (side, channels),
            "the model sees frames of {0} x {0} with {1} channels; the environment draws {side} x {side} with {channels}",
            system.side,
            system.channels
        );
        ensure!(
            (system.dt - dt).abs() < 1e-9,
            "the model has {} time units from frame to frame, the environment {dt}: velocities would not agree",
            system.dt
        );
        Ok(())
    }
}

/// Whether a scene can be drawn as an agent sees it, one frame after the other: what its dataset's frames show must be what
/// these show.
///
/// # Errors
/// A scene that looks different from frame to frame by more than the motion of its objects.
pub(super) fn check_looks(scene: &Scene) -> Result<()> {
    let changing = [
        (!scene.camera.is_default(), "the effects of scene.camera"),
        (scene.background() == Background::Drifting, "a drifting background"),
        (scene.distractors.iter().any(|distractor| distractor.speed > 0.0), "distractors that move"),
    ];
    let found: Vec<&str> = changing.into_iter().filter_map(|(there, what)| there.then_some(what)).collect();
    ensure!(
        found.is_empty(),
        "control does not draw {}: the model would see other frames than it learned from; control a task without",
        found.join(", ")
    );
    Ok(())
}

/// A world of which frames are seen.
pub trait Environment {
    /// Begins an episode; equal seeds begin equally.
    fn reset(&mut self, seed: u64);
    /// Goes to the first state of an episode, and leaves what a camera draws by chance as it is.
    fn restart(&mut self, seed: u64) {
        self.reset(seed);
    }
    /// Goes back so many steps during which nothing acted; so many [`Self::step`]s with 0 lead to the episode's first state.
    fn go_back(&mut self, steps: usize);
    /// What is seen now: float32 `[channels, S, S]` in \[0, 1\], in grey levels as a dataset's frames. None where the camera
    /// delivers nothing.
    fn observe(&mut self) -> Option<Tensor>;
    /// What would be seen of it at these coordinates, radians or pixels. The episode goes on from there, at rest.
    fn show(&mut self, positions: &[f64]) -> Option<Tensor>;
    /// What would be seen if everything that moves were hidden.
    fn empty_frame(&self) -> Tensor;
    /// Acts for one step, from this frame to the next, and returns the step's reward. An action beyond the limits acts as
    /// the nearest one within; one that is no number as 0.
    fn step(&mut self, action: f64) -> f64;
    /// For scores and for the planners that are bounds; nothing that sees may read it.
    fn true_state(&self) -> ControlState;
    fn rules(&self) -> &Rules;
    fn format(&self) -> FrameFormat;
}

impl Rules {
    /// An action as it acts.
    pub fn within_limits(&self, action: f64) -> f64 {
        if action.is_nan() { 0.0 } else { action.clamp(-self.largest_action, self.largest_action) }
    }
}

/// The levels of a frame, channel by channel, as it is seen: `[channels, S, S]`.
pub(super) fn seen(levels: &[f64], FrameFormat { side, channels, .. }: FrameFormat) -> Tensor {
    let mut pixels = vec![0; side * side * channels];
    quantise(levels, channels, &mut pixels);
    let [side, channels] = [side, channels].map(|count| count as i64);
    let pixels = Tensor::from_slice(&pixels).reshape([side, side, channels]);
    pixels.permute([2, 0, 1]).contiguous().to_kind(Kind::Float) / 255.0
}
