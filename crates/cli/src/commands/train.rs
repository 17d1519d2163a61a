//! Trains and scores PAIG on any task, and measures videos. See `paig train --help`.

use std::collections::BTreeMap;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use paig::runs::verdict::Verdict;
use paig::tasks;
use paig_terminal::progress::write_text;
use paig_terminal::run::{RunArgs, interrupted};
use paig_terminal::screen::Screen;
use paig_terminal::{interrupt, say};
use paig_video::run::{VideoRunEnding, execute};

use crate::PROGRAM;
use crate::measure_display::print_measurement;

/// Learns objects, positions and physical parameters from unlabelled video: trains, scores, writes pictures.
///
/// Of a task that `paig import` made, the run ends with a measurement: parameters with intervals.
#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:\n  paig train --task spring_color --seed 1\n  \
                  paig train --task 3bp_color --set join.max_steps=400 --out runs/longer\n  \
                  paig train --resume --out runs/spring_color/fast/seed=1"
)]
pub struct TrainArguments {
    #[arg(long, help = format!(
        "The system to learn: a task file (.toml), or one of {}. Required, unless --config names it, or --resume or \
         --test-mode takes the run in --out",
        tasks::names()
    ))]
    task: Option<String>,
    #[command(flatten)]
    run: RunArgs,
}

pub fn run(arguments: &TrainArguments) -> Result<ExitCode> {
    let task = arguments.task.as_deref();
    if arguments.run.printed_config(task)? {
        return Ok(ExitCode::SUCCESS);
    }
    let mut screen = Screen::new(PROGRAM);
    let run = arguments.run.open(task)?.prepare(&mut screen)?;
    interrupt::catch()?;
    match execute(&run, PROGRAM, &mut screen, &interrupt::asked)? {
        VideoRunEnding::Finished { summary, measurement: None } => {
            summary.verdict.iter().for_each(|verdict| write_text(&format!("{verdict}\n")));
            Ok(ExitCode::SUCCESS)
        }
        VideoRunEnding::Finished { summary, measurement: Some(measured) } => {
            measured.iter().for_each(|measurement| {
                print_measurement(measurement);
                say!("look at {}", run.folder.path().join("measurement.html").display());
            });
            // What is to be quoted are the measurement's intervals, not those of short clips in pixels of small frames.
            summary.verdict.iter().for_each(|verdict| {
                write_text(&format!("{}\n", Verdict { intervals: BTreeMap::new(), ..verdict.clone() }));
            });
            Ok(measured.map(|_| ExitCode::SUCCESS)?)
        }
        VideoRunEnding::Scored => Ok(ExitCode::SUCCESS),
        VideoRunEnding::Interrupted { steps } => Ok(interrupted(steps, &run)),
    }
}
