//! Scores a run on a dataset file. See `evaluate --help`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Parser;
use paig::datasets::files::Split;
use paig::datasets::states::States;
use paig::evaluation::{self, Evaluation};
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
    let dataset = evaluation::read_dataset(&file, &model.task)?;
    let states = States::read(&file, &dataset)?;
    let truth = states.as_ref().map(|states| states.split(split));
    let scores = evaluation::evaluate(&model, &dataset, truth, split, device)?;
    println!("{} on the {} clips of {} ({})\n", arguments.run.display(), scores.clips, file.display(), split.name());
    print(&scores);
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

fn print(scores: &Evaluation) {
    let losses = &scores.losses;
    println!("L_rec {:.4}   L_pred {:.4}", losses.recons_loss, losses.pred_loss);
    if let Some(loss) = losses.extrap_loss {
        println!("L_extrap {loss:.4}");
    }
    println!("\n{:>5}  {:<6}{:>14}{:>10}", "frame", "", "squared error", "SSIM");
    let mut extrapolated = false;
    for frame in &scores.predicted_frames {
        if frame.extrapolated && !extrapolated {
            extrapolated = true;
            println!("------ end of T_pred, T_ext begins");
        }
        let part = if frame.extrapolated { "T_ext" } else { "T_pred" };
        println!("{:>5}  {part:<6}{:>14.4}{:>10.4}", frame.frame, frame.squared_error, frame.ssim);
    }
    let Some(states) = &scores.states else { return };
    println!("\n{:<38}{:>10}{:>22}", "root mean square error, pixels", "", "without the offset");
    let row = |name: &str, error: f64, without: f64| println!("{name:<38}{error:>10.4}{without:>22.4}");
    row("encoded positions", states.encoded, states.encoded_without_offset);
    row("predicted positions, T_pred", states.predicted, states.predicted_without_offset);
    if let (Some(error), Some(without)) = (states.extrapolated, states.extrapolated_without_offset) {
        row("predicted positions, T_ext", error, without);
    }
    println!("velocity at the last input frame      {:>10.4} pixels per time unit", states.initial_velocity);
    println!("velocity, T_pred                      {:>10.4} pixels per time unit", states.predicted_velocity);
}
