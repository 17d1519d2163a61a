//! Rolling a learned system out from the first frames of one clip, as far as asked.

use anyhow::{Result, ensure};
use tch::{Device, Tensor};

use crate::network::cells::{Actions, State};
use crate::network::physics_models::PhysicsNet;

/// Most frames that are predicted at once: each is drawn into a strip and an animation.
pub const MOST_FRAMES: usize = 10_000;

/// A clip and what the model makes of its beginning, on the CPU.
#[derive(Debug)]
pub struct Rollout {
    /// The whole clip, `[T, C, S, S]` in \[0, 1\].
    pub clip: Tensor,
    /// Predicted frames, the first one right after the L input frames, `[frames, C, S, S]`.
    pub frames: Tensor,
    /// From the last input frame on, `[1 + frames, coordinates * objects]`, pixels or radians.
    pub positions: Tensor,
    /// The same of the velocities, per time unit.
    pub velocities: Tensor,
}

/// Predicts `frames` frames after the input of a clip `[T, C, S, S]`; the clip's later frames are not looked at. `actions`
/// begin at the clip's first frame; where they end nothing acts any more.
///
/// # Errors
/// A clip shorter than the input, no frames to predict or more than 10000.
pub fn roll_out(model: &PhysicsNet, clip: &Tensor, actions: &Actions, frames: usize) -> Result<Rollout> {
    let _guard = tch::no_grad_guard();
    let input = model.system.input_steps as i64;
    ensure!(clip.size()[0] >= input, "the clip has {} frames, the input alone takes {input}", clip.size()[0]);
    ensure!(
        (1..=MOST_FRAMES).contains(&frames),
        "{frames} frames to predict: there must be at least one frame, and at most {MOST_FRAMES}"
    );
    let seen = model.see(&clip.narrow(0, 0, input).unsqueeze(0), input as usize);
    let (initial, rolled_out) = model.roll_out(&seen.positions, actions, frames);
    let states: Vec<_> = std::iter::once(&initial).chain(&rolled_out).map(State::joined).collect();
    let states = Tensor::cat(&states, 0);
    let halves = states.chunk(2, 1);
    let [predicted] = model.decoder.draw([&halves[0].narrow(0, 1, frames as i64)]);
    let pixels = |x: &Tensor| (x * model.length_per_unit()).to_device(Device::Cpu);
    Ok(Rollout {
        clip: clip.to_device(Device::Cpu),
        frames: predicted.to_device(Device::Cpu),
        positions: pixels(&halves[0]),
        velocities: pixels(&halves[1]),
    })
}
