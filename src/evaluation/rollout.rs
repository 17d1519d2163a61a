//! Rolling a learned system out from the first frames of one clip, as far as asked.

use std::fs;
use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use tch::{Device, Tensor};

use crate::network::cells::{Actions, Coordinates, State};
use crate::network::physics_models::PhysicsNet;
use crate::support::atomic;
use crate::tasks::Task;
use crate::viz;

/// Frames that fit into the memory of a laptop and into a picture.
const MOST_FRAMES: usize = 10_000;

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
    let input = model.task.input_steps as i64;
    ensure!(clip.size()[0] >= input, "the clip has {} frames, the input alone takes {input}", clip.size()[0]);
    ensure!(
        (1..=MOST_FRAMES).contains(&frames),
        "{frames} frames to predict: there must be at least one frame, and at most {MOST_FRAMES}"
    );
    let (_, positions) = model.encode(&clip.narrow(0, 0, input).unsqueeze(0));
    let initial = model.initial_state(&positions, actions);
    let rolled_out = model.cell.roll_out(&initial, &actions.since(input as usize - 1), model.task.dt, frames);
    let states: Vec<_> = std::iter::once(&initial).chain(&rolled_out).map(State::joined).collect();
    let states = Tensor::cat(&states, 0);
    let halves = states.chunk(2, 1);
    let predicted = model.decoder.forward(&halves[0].narrow(0, 1, frames as i64)).frames;
    let pixels = |x: &Tensor| (x * model.length_per_unit()).to_device(Device::Cpu);
    Ok(Rollout {
        clip: clip.to_device(Device::Cpu),
        frames: predicted.to_device(Device::Cpu),
        positions: pixels(&halves[0]),
        velocities: pixels(&halves[1]),
    })
}

/// Writes a roll-out into a folder.
///
/// * `frames.png`: all frames, the clip above the model, and `animation.gif`, the same in motion;
/// * `states.csv`: a line for each frame from the last input frame on: its place in the clip, the time since the last
///   input frame, then x, y (pixels), vx, vy (pixels per time unit) of each object, or its angle and rate (radians);
/// * `rollout.npz`: float32 `positions` and `velocities` `[1 + frames, coordinates * N]`, `frames` `[frames, S, S, C]` in \[0, 1\].
///
/// # Errors
/// A folder that cannot be written, frames with neither 1 nor 3 channels.
pub fn write(folder: &Path, task: &Task, rollout: &Rollout) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    viz::rollout::write_strip(&folder.join("frames.png"), task, rollout)?;
    viz::rollout::write_animation(&folder.join("animation.gif"), task, rollout)?;
    atomic::write_file(&folder.join("states.csv"), |file| Ok(file.write_all(table(task, rollout).as_bytes())?))?;
    let frames = rollout.frames.permute([0, 2, 3, 1]);
    let (positions, velocities) = (rollout.positions.shallow_clone(), rollout.velocities.shallow_clone());
    let arrays = [("positions", positions), ("velocities", velocities), ("frames", frames)];
    viz::arrays::write(&folder.join("rollout.npz"), &arrays)
}

fn table(task: &Task, rollout: &Rollout) -> String {
    let (positions, velocities): (&[&str], &[&str]) = match task.cell.coordinates {
        Coordinates::Position => (&["x", "y"], &["vx", "vy"]),
        Coordinates::Angle => (&["angle"], &["rate"]),
    };
    let mut lines = vec!["frame,time".to_string()];
    for object in 0..task.objects {
        for name in positions.iter().chain(velocities) {
            lines[0] += &format!(",{name}{object}");
        }
    }
    let axes = positions.len();
    for place in 0..rollout.positions.size()[0] {
        let frame = task.input_steps as i64 - 1 + place;
        let mut line = format!("{frame},{:.4}", place as f64 * task.dt);
        for object in 0..task.objects {
            for states in [&rollout.positions, &rollout.velocities] {
                for axis in 0..axes {
                    line += &format!(",{:.5}", states.double_value(&[place, (axes * object + axis) as i64]));
                }
            }
        }
        lines.push(line);
    }
    lines.join("\n") + "\n"
}
