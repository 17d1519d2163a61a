//! Trains an end-to-end baseline. See `paig train-baseline --help`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::{Args, ValueEnum};
use paig::Error;
use paig::kernels::Kernels;
use paig::support::device;
use paig::tasks;
use paig::training::base::TrainingOutcome;
use paig::training::layers::usual_data_folder;
use paig_experiments::baselines::end_to_end::config::{EndToEndConfig, EndToEndModel};
use paig_experiments::baselines::end_to_end::scores::EndToEndScores;
use paig_experiments::comparison::end_to_end_run::EndToEndRun;
use paig_terminal::{interrupt, say};

/// The models.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
enum BaselineModel {
    /// A convolutional LSTM that predicts frames, without objects or physics
    VideoLstm,
    /// A decompositional predictive auto-encoder: components that move, without physics
    Ddpae,
    /// A small PlaNet: a latent model of frames, actions and rewards, to be compared in control. Takes a driven pendulum
    /// alone; the rewards of the training frames come from the true angles (the _states.npz beside the clips)
    Planet,
}

impl BaselineModel {
    /// The model and the task that it takes if none is named.
    fn model(self) -> (EndToEndModel, &'static str) {
        match self {
            BaselineModel::VideoLstm => (EndToEndModel::VideoLstm, "spring_color"),
            BaselineModel::Ddpae => (EndToEndModel::Ddpae, "spring_color"),
            BaselineModel::Planet => (EndToEndModel::Planet, "pendulum"),
        }
    }

    /// Of its run folders.
    fn name(self) -> String {
        self.to_possible_value().expect("no model is hidden").get_name().into()
    }
}

/// As `model.kernels` of the physics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum KernelChoice {
    Own,
    Libtorch,
}

impl From<KernelChoice> for Kernels {
    fn from(choice: KernelChoice) -> Self {
        match choice {
            KernelChoice::Own => Kernels::Own,
            KernelChoice::Libtorch => Kernels::Libtorch,
        }
    }
}

/// Trains an end-to-end baseline without physics and scores it on the test clips.
///
/// Given again, the same command goes on where it was stopped.
#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Example:\n  paig train-baseline video_lstm --task spring_color --seed 1"
)]
pub struct TrainBaselineArguments {
    #[arg(value_enum)]
    model: BaselineModel,
    #[arg(long, help = format!(
        "What is filmed: a task file (.toml), or one of {} [default: spring_color; for planet: pendulum]",
        tasks::names()
    ))]
    task: Option<String>,
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
    /// What computes the operations that have kernels: the program's own, or libtorch
    #[arg(long, value_enum, default_value_t = KernelChoice::Own)]
    kernels: KernelChoice,
    /// Threads to compute with; 0 for one a core
    #[arg(long, default_value_t = 0)]
    threads: usize,
    /// cpu, cuda or cuda:n
    #[arg(long, default_value = "cpu")]
    device: String,
}

pub fn run(arguments: TrainBaselineArguments) -> Result<ExitCode> {
    let TrainBaselineArguments {
        task,
        data,
        out,
        seed,
        learning_rate,
        batch,
        steps,
        checkpoint_every,
        threads,
        device,
        ..
    } = arguments;
    let kernels = arguments.kernels.into();
    let (model, usual_task) = arguments.model.model();
    let task = task.unwrap_or_else(|| usual_task.into());
    let device = device::parse(&device)?;
    let filmed = tasks::find(&task)?;
    let data = data.unwrap_or_else(|| usual_data_folder(&filmed, &task).into());
    let config = EndToEndConfig { model, task, data, seed, learning_rate, batch, steps, checkpoint_every, kernels };
    device::set_threads(threads)?;
    interrupt::catch()?;
    let of_task = filmed.name;
    let folder = out
        .unwrap_or_else(|| Path::new("runs").join(of_task).join(arguments.model.name()).join(format!("seed={seed}")));
    let run = EndToEndRun::prepare(&config, device)?;
    let outcome = run.train(&folder, &interrupt::asked, &mut |record| {
        let error = record.score.unwrap_or(f64::NAN);
        say!("{} - step {}: validation error {error:.4}", folder.display(), record.step);
    })?;
    if outcome == TrainingOutcome::Interrupted {
        say!("stopped; the same command goes on");
        return Ok(interrupt::exit_code());
    }
    if let Some(done) = EndToEndScores::read(&folder).map_err(Error::of_work)? {
        let losses = done.scores.losses;
        let extrap = losses.extrap_loss.map_or_else(String::new, |loss| format!(", L_extrap {loss:.4}"));
        say!("{} weights; L_pred {:.4}{extrap}; {}", done.weights, losses.pred_loss, folder.display());
    }
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use paig_experiments::comparison::end_to_end_run::has_worths;

    use super::*;

    #[test]
    fn each_model_takes_its_usual_task() {
        for model in BaselineModel::value_variants() {
            let (model, task) = model.model();
            let task = tasks::find(task).unwrap();
            assert!(!model.learns_rewards() || has_worths(&task), "{} for {model:?}", task.name);
        }
    }
}
