//! Loads the model of a run and takes its parts one by one: encodes the first frames of a clip, rolls the state out,
//! decodes it.
//!
//! `cargo run --release --example loaded_model -- runs/demo`

use std::path::PathBuf;

use anyhow::{Context, Result};
use paig::datasets::files::Split;
use paig::evaluation::ScoredClips;
use paig::network::cells::State;
use paig::network::physics_models::losses::frame_error;
use paig::runs::checkpoint::SavedWeights;
use paig::training::saved::load_model;
use tch::Device;

fn main() -> Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).context("give a run folder, such as runs/demo")?);
    let (config, model) = load_model(&folder, SavedWeights::Last, Device::Cpu)?;
    let test = ScoredClips::read(&config.data.test_path(), &config.task, Split::Test, Device::Cpu)?;
    let system = &model.system;
    let _guard = tch::no_grad_guard();

    // The first clip, [1, time, channels, side, side] in 0..1, and what acts on its objects.
    let clip = test.clips.batch(&[0], test.clips.time());
    let actions = test.clips.actions(&[0]);

    // Encoder: positions [1, L, coordinates] of the input frames.
    let input = system.input_steps;
    let (_masks, positions) = model.encode(&clip.narrow(1, 0, input as i64));
    // Velocity estimator and refinement: the state at the last input frame.
    let initial = model.initial_state(&positions, &actions);
    // Physics: the states of the frames that follow.
    let states: Vec<State> = model.cell.roll_out(&initial, &actions.since(input - 1), system.dt, system.pred_steps);
    // Decoder: the frames [1, channels, side, side] that these states look like.
    for (step, state) in states.iter().enumerate() {
        let drawn = model.decoder.forward(&state.pos).frames;
        let truth = clip.select(1, (input + step) as i64);
        let error = frame_error(model.options.kernels, &drawn.unsqueeze(1), &truth.unsqueeze(1)).double_value(&[]);
        let positions: Vec<f64> = state.pos.flatten(0, 1).to_kind(tch::Kind::Double).try_into()?;
        println!("frame {:>2}: positions {positions:.2?}, squared error {error:.3}", input + step);
    }
    Ok(())
}
