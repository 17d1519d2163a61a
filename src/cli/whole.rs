//! Training of a whole other model from the command line: what `video_lstm`, `ddpae` and `planet` call.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use tch::{Device, Tensor};

use super::ending::{begin_work, exit_code};
use super::{environment, interrupt};
use crate::baselines::training::{self, WholeConfig, WholeData, WholeModel, WholeScores};
use crate::control::reward::{Goal, Reward};
use crate::control::state::ControlState;
use crate::datasets::dataset::Dataset;
use crate::datasets::files::{ClipShape, Split};
use crate::datasets::states::States;
use crate::network::cells::Coordinates;
use crate::support::device;
use crate::tasks::Task;
use crate::training::base::Outcome;
use crate::{say, tasks};

/// Trains a model of frames without objects and physics, for comparison, and scores it on the test clips.
///
/// Given again, the same command goes on where it was stopped.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    /// The task: a task file (.toml), or the name of a built-in one
    #[arg(long, default_value = "spring_color")]
    task: String,
    /// Folder of the datasets
    #[arg(long, default_value = "data/datasets")]
    data: PathBuf,
    /// Run folder [default: runs/TASK/MODEL/seed=N]
    #[arg(long)]
    out: Option<PathBuf>,
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Adam's
    #[arg(long, default_value_t = 1e-3)]
    learning_rate: f64,
    /// Clips in a step
    #[arg(long, default_value_t = 25)]
    batch: usize,
    #[arg(long, default_value_t = 6000)]
    steps: u64,
    /// Steps from one validation and checkpoint to the next
    #[arg(long, default_value_t = 250)]
    checkpoint_every: u64,
    /// Threads to compute with; 0 for one a core
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// cpu, cuda or cuda:n
    #[arg(long, default_value = "cpu")]
    device: String,
}

/// Entry of a model's runner; `name` is that of its folder.
pub fn main(model: WholeModel, name: &str) -> ExitCode {
    exit_code(|| run(model, name, Arguments::parse()))
}

fn run(model: WholeModel, name: &str, arguments: Arguments) -> Result<ExitCode> {
    environment::set();
    let Arguments { task, data, out, seed, learning_rate, batch, steps, checkpoint_every, threads, device } = arguments;
    let device = device::parse(&device)?;
    let config = WholeConfig { model, task, data, seed, learning_rate, batch, steps, checkpoint_every };
    device::set_threads(threads)?;
    interrupt::catch()?;
    let of_task = tasks::find(&config.task)?.name;
    let folder = out.unwrap_or_else(|| Path::new("runs").join(of_task).join(name).join(format!("seed={seed}")));
    if train(&config, &folder, device, &interrupt::asked)? == Outcome::Interrupted {
        say!("stopped; the same command goes on");
        return Ok(interrupt::exit_code());
    }
    if let Some(done) = WholeScores::read(&folder)? {
        let losses = done.scores.losses;
        let extrap = losses.extrap_loss.unwrap_or(f64::NAN);
        say!("{} weights; L_pred {:.4}, L_extrap {extrap:.4}; {}", done.weights, losses.pred_loss, folder.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// Reads the data of a training and goes through it.
///
/// # Errors
/// Data that are missing or do not fit the task, and as for [`training::train`].
pub fn train(config: &WholeConfig, folder: &Path, device: Device, stop: &dyn Fn() -> bool) -> Result<Outcome> {
    config.check()?;
    let task = tasks::find(&config.task)?;
    let read = |file: &Path, shape: &ClipShape| Dataset::open(&config.data.join(file), shape);
    let learned = read(task.train_file.as_ref(), &ClipShape::training(&task))?;
    let scored = read(task.test_file.as_ref(), &ClipShape::test(&task))?;
    let [train, valid] = [Split::Train, Split::Valid].map(|split| learned.clips(split, device));
    let test = scored.clips(Split::Test, device);
    let told = config.model.learns_rewards();
    let rewards = told.then(|| rewards(&task, &config.data.join(&task.train_file), &learned)).transpose()?;
    begin_work();
    let data = WholeData { train: &train, rewards: rewards.as_ref(), valid: &valid, test: &test };
    training::train(config, &task.system, data, folder, stop, &mut |record| {
        let error = record.score.unwrap_or(f64::NAN);
        say!("{} - step {}: validation error {error:.4}", folder.display(), record.step);
    })
}

/// What the frames of the training clips are worth where upright is the goal, `[clips, time]`: what an environment tells
/// who acts in it.
fn rewards(task: &Task, file: &Path, dataset: &Dataset) -> Result<Tensor> {
    let cell = task.system.cell;
    ensure!(
        cell.can_be_driven() && cell.coordinates == Coordinates::Angle && task.system.objects == 1,
        "this model learns what frames of a pendulum are worth; task {} has none",
        task.name
    );
    let states = States::read(file, dataset)?.with_context(|| {
        let beside = States::path_beside(file);
        format!("{} is missing: the model is told what each frame is worth, by the true angle", beside.display())
    })?;
    let upright = Reward::Goal(Goal::angle(0.0));
    let worth = |angle: &f32| {
        let state = ControlState::turning(f64::from(*angle), 0.0);
        upright.of(0, &state, 0.0, &state) as f32
    };
    let positions = &states.train.positions;
    let worths: Vec<f32> = positions.iter().map(worth).collect();
    Ok(Tensor::from_slice(&worths).reshape([positions.dim().0 as i64, positions.dim().1 as i64]))
}
