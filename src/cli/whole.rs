//! Training of a whole other model from the command line: what `video_lstm`, `ddpae` and `planet` call.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::{Command, CommandFactory, FromArgMatches, Parser};
use tch::{Device, Tensor};

use super::ending::{begin_work, exit_code};
use super::{environment, interrupt};
use crate::baselines::whole_models::config::{WholeConfig, WholeModel};
use crate::baselines::whole_models::scores::WholeScores;
use crate::baselines::whole_models::training::{self, WholeData};
use crate::control::reward::{Goal, Reward};
use crate::control::state::ControlState;
use crate::datasets::dataset::Dataset;
use crate::datasets::files::{ClipShape, Split};
use crate::datasets::states::States;
use crate::network::cells::Coordinates;
use crate::support::device;
use crate::tasks::Task;
use crate::training::base::Outcome;
use crate::training::layers::usual_data_folder;
use crate::{say, tasks};

/// The same for all of these models; [`program`] adds what is each one's own.
#[derive(Debug, Parser)]
#[command(version, after_help = "Given again, the same command goes on where it was stopped.")]
struct Arguments {
    #[arg(long, help = format!("What is filmed: a task file (.toml), or one of {}", tasks::names()))]
    task: String,
    /// Folder of the datasets [default: data/datasets; the folder of the task's file where its data.folder is "."]
    #[arg(long)]
    data: Option<PathBuf>,
    /// Run folder [default: runs/TASK/MODEL/seed=N]
    #[arg(long)]
    out: Option<PathBuf>,
    /// Seed of initial values and of the order of the data
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Learning rate of Adam
    #[arg(long, default_value_t = 1e-3)]
    learning_rate: f64,
    /// Clips in a step
    #[arg(long, default_value_t = 25)]
    batch: usize,
    /// Training steps
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
    exit_code(|| run(model, name, Arguments::from_arg_matches(&program(model).get_matches())?))
}

/// A model's program: what it says of itself, and the task that it takes if none is named.
fn program(model: WholeModel) -> Command {
    let (about, task) = match model {
        WholeModel::VideoLstm => (
            "Trains VideoLSTM, a convolutional LSTM that predicts frames and knows of no objects and no physics, for \
             comparison, and scores it on the test clips",
            "spring_color",
        ),
        WholeModel::Ddpae => (
            "Trains DDPAE, which parts frames into components that move and knows of no physics, for comparison, and scores \
             it on the test clips",
            "spring_color",
        ),
        WholeModel::Planet => (
            "Trains a small PlaNet, a latent model of frames, actions and rewards, to be compared in control, and scores it \
             on the test clips. It takes only a driven pendulum, and is told what each training frame is worth by the true \
             angle (the _states.npz beside the clips)",
            "pendulum",
        ),
    };
    Arguments::command().about(about).mut_arg("task", |option| option.required(false).default_value(task))
}

fn run(model: WholeModel, name: &str, arguments: Arguments) -> Result<ExitCode> {
    environment::set();
    let Arguments { task, data, out, seed, learning_rate, batch, steps, checkpoint_every, threads, device } = arguments;
    let device = device::parse(&device)?;
    let filmed = tasks::find(&task)?;
    let data = data.unwrap_or_else(|| usual_data_folder(&filmed, &task).into());
    let config = WholeConfig { model, task, data, seed, learning_rate, batch, steps, checkpoint_every };
    device::set_threads(threads)?;
    interrupt::catch()?;
    let of_task = filmed.name;
    let folder = out.unwrap_or_else(|| Path::new("runs").join(of_task).join(name).join(format!("seed={seed}")));
    if train(&config, &folder, device, &interrupt::asked)? == Outcome::Interrupted {
        say!("stopped; the same command goes on");
        return Ok(interrupt::exit_code());
    }
    if let Some(done) = WholeScores::read(&folder)? {
        let losses = done.scores.losses;
        let extrap = losses.extrap_loss.map_or_else(String::new, |loss| format!(", L_extrap {loss:.4}"));
        say!("{} weights; L_pred {:.4}{extrap}; {}", done.weights, losses.pred_loss, folder.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// Reads the data of a training and goes through it.
///
/// # Errors
/// Data that are missing, do not fit the task or show nothing that moves, and as for [`training::train`].
pub fn train(config: &WholeConfig, folder: &Path, device: Device, stop: &dyn Fn() -> bool) -> Result<Outcome> {
    config.check()?;
    let task = tasks::find(&config.task)?;
    let train_file = config.data.join(&task.train_file);
    let learned = Dataset::open(&train_file, &ClipShape::training(&task))?;
    learned.check_motion(&train_file)?;
    let scored = Dataset::open(&config.data.join(&task.test_file), &ClipShape::test(&task))?;
    let [train, valid] = [Split::Train, Split::Valid].map(|split| learned.clips(split, device));
    let test = scored.clips(Split::Test, device);
    let told = config.model.learns_rewards();
    let rewards = told.then(|| rewards(&task, &train_file, &learned)).transpose()?;
    begin_work();
    let checksums = learned.learned_from();
    let data =
        WholeData { train: &train, rewards: rewards.as_ref(), valid: &valid, test: &test, checksums: &checksums };
    training::train(config, &task.system, data, folder, stop, &mut |record| {
        let error = record.score.unwrap_or(f64::NAN);
        say!("{} - step {}: validation error {error:.4}", folder.display(), record.step);
    })
}

/// Whether a task's frames show a driven pendulum.
fn has_worths(task: &Task) -> bool {
    let cell = task.system.cell;
    cell.can_be_driven() && cell.coordinates == Coordinates::Angle && task.system.objects == 1
}

/// What the frames of the training clips are worth where upright is the goal, `[clips, time]`: what an environment tells
/// who acts in it.
fn rewards(task: &Task, file: &Path, dataset: &Dataset) -> Result<Tensor> {
    ensure!(has_worths(task), "this model learns what frames of a pendulum are worth; task {} has none", task.name);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_program_takes_its_usual_task_and_explains_its_options() {
        for model in [WholeModel::VideoLstm, WholeModel::Ddpae, WholeModel::Planet] {
            let mut program = program(model);
            assert!(program.render_long_help().to_string().starts_with("Trains "), "{model:?} does not say what it is");
            let unexplained: Vec<_> = program.get_arguments().filter(|option| option.get_help().is_none()).collect();
            assert!(unexplained.is_empty(), "{unexplained:?}");
            let given = Arguments::from_arg_matches(&program.try_get_matches_from(["program"]).unwrap()).unwrap();
            let task = tasks::find(&given.task).unwrap();
            assert!(!model.learns_rewards() || has_worths(&task), "{} for {model:?}", task.name);
        }
    }
}
