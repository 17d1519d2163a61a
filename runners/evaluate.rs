//! Scores a run on a dataset file. See `evaluate --help`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Parser;
use paig::datasets::files::Split;
use paig::evaluation::{self, ScoredClips, TestLosses};
use paig::run::{self, exit_code};
use paig::{device, durable, viz};
use serde_json::json;

/// Scores the last checkpoint of a run on any dataset file of its task.
///
/// Prints L_rec, L_pred and L_extrap, squared error and SSIM of every predicted frame, and, where the true states lie
/// beside the file, the errors of positions and velocities.
#[derive(Parser)]
#[command(version, after_help = "Example:\n  evaluate runs/spring_color/fast/seed=0 --json scores.json")]
struct Arguments {
    /// Run folder
    run: PathBuf,
    /// Dataset file [default: the run's test file]
    #[arg(long)]
    file: Option<PathBuf>,
    /// Part of the file
    #[arg(long, default_value = "test", value_parser = Split::ALL.map(Split::name))]
    split: String,
    /// Write the numbers to this file, too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Plot SSIM and squared error over the predicted frames to this PNG
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// cpu, cuda or cuda:n
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Threads to compute with; 0 for one a core
    #[arg(long, default_value_t = 0)]
    threads: usize,
}

fn main() -> ExitCode {
    device::wait_passively();
    exit_code(execute(&Arguments::parse()))
}

fn execute(arguments: &Arguments) -> Result<ExitCode> {
    let device = device::parse(&arguments.device)?;
    device::set_threads(arguments.threads);
    let (config, model) = run::load_model(&arguments.run, device)?;
    let own = || config.data.folder.join(&config.data.test_file);
    let file = arguments.file.clone().unwrap_or_else(own);
    let split = Split::ALL.into_iter().find(|split| split.name() == arguments.split).context("unknown split")?;
    let clips = ScoredClips::read(&file, &model.task, split, device)?;
    let scores = evaluation::evaluate(&model, &clips)?;
    println!("{} on the {} clips of {} ({})\n", arguments.run.display(), scores.clips, file.display(), split.name());
    print_losses(&scores.losses);
    evaluation::print_frames_and_states(&model.task, &scores);
    if let Some(path) = &arguments.picture {
        viz::write_frame_scores(path, &model.task, &scores.predicted_frames)?;
    }
    if let Some(path) = &arguments.json {
        let all = json!({
            "task": config.task, "run": arguments.run, "file": file, "split": split.name(),
            "parameters": model.parameter_values().into_iter().collect::<std::collections::BTreeMap<_, _>>(),
            "scores": scores,
        });
        durable::write_file(path, |file| Ok(serde_json::to_writer_pretty(file, &all)?))?;
    }
    Ok(ExitCode::SUCCESS)
}

fn print_losses(losses: &TestLosses) {
    println!("L_rec {:.4}   L_pred {:.4}", losses.recons_loss, losses.pred_loss);
    if let Some(loss) = losses.extrap_loss {
        println!("L_extrap {loss:.4}");
    }
    println!();
}
