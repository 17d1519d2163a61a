//! Converts a model's weights to and from PyTorch and TensorFlow. See `convert --help`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Result, ensure};
use clap::Parser;
use paig::convert::convert;
use paig::tasks;

/// Exit code for bad input.
const BAD_INPUT: u8 = 2;

/// Converts a model's weights between a run's checkpoint or a PyTorch state_dict (.safetensors; both have the same names)
/// and TensorFlow's named variables (.npz). The variables must be exactly those of a model of the task.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:\n  convert --task spring_color runs/demo weights.npz\n  \
                  convert --task spring_color weights.npz weights.safetensors"
)]
struct Arguments {
    /// System that the model was made for
    #[arg(long, value_parser = tasks::TASKS.iter().map(|task| task.key).collect::<Vec<_>>())]
    task: String,
    /// The model has the velocity estimator of --alt_vel
    #[arg(long)]
    alt_vel: bool,
    /// Replace the file to write if it is there
    #[arg(long)]
    force: bool,
    /// What to read: a run folder, a checkpoint, a .safetensors or a .npz file
    from: PathBuf,
    /// File to write: .safetensors or .npz
    to: PathBuf,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(BAD_INPUT)
        }
    }
}

fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { from, to, .. } = arguments;
    ensure!(arguments.force || !to.exists(), "{} is there already; --force replaces it", to.display());
    let count = convert(tasks::find(&arguments.task)?, arguments.alt_vel, from, to)?;
    println!("{count} variables from {} to {}", from.display(), to.display());
    Ok(())
}
