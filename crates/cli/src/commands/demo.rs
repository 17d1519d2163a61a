//! Generates and learns a small spring. See `paig demo --help`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use paig::generators::{Counts, DatasetJob, generate};
use paig::run::{Ending, Mode, Request};
use paig::tasks;
use paig::training::layers::Overrides;
use paig_terminal::generate_display::GenerateDisplay;
use paig_terminal::run::interrupted;
use paig_terminal::screen::Screen;
use paig_terminal::{interrupt, say};

use crate::PROGRAM;

const TASK: &str = "spring_color";
/// Clips of the demonstration: enough for the spring, and generated in a second.
const CLIPS: Counts = Counts { train: 1000, valid: 100, test: 100 };

/// Generates 1000 clips of two balls on a spring and learns them, in about a minute.
///
/// The run ends with the spring constant k and half the rest length l beside the true ones. It continues where it stopped.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  paig demo --out spring")]
pub struct DemoArguments {
    /// Folder for the clips (data) and the run (run)
    #[arg(long, value_name = "DIR", default_value = "paig-demo")]
    out: PathBuf,
    /// Seed of initial values and of the order of the data
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// cpu, cuda or cuda:n
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Threads to compute with; 0 for one a core
    #[arg(long, default_value_t = 0)]
    threads: usize,
}

pub fn run(arguments: &DemoArguments) -> Result<ExitCode> {
    let (data, out) = (arguments.out.join("data"), arguments.out.join("run"));
    let display = GenerateDisplay::default();
    let job = DatasetJob { counts: CLIPS, ..DatasetJob::plain(&tasks::find(TASK)?, data.clone())? };
    generate(&job, &|event| display.show(event))?;
    let mode = if out.join("config.toml").exists() { Mode::Resume } else { Mode::Begin };
    let overrides = Overrides {
        task: Some(TASK.into()),
        seed: Some(arguments.seed),
        device: Some(arguments.device.clone()),
        threads: Some(arguments.threads),
        data: Some(data),
        ..Overrides::default()
    };
    let mut screen = Screen::new(PROGRAM);
    let run = Request { overrides, out: Some(out), mode, ..Request::default() }.open()?.prepare(&mut screen)?;
    interrupt::catch()?;
    match run.execute(PROGRAM, &mut screen, &interrupt::asked)? {
        Ending::Finished(summary) => {
            summary.verdict.iter().for_each(|verdict| say!("{verdict}"));
            Ok(ExitCode::SUCCESS)
        }
        Ending::Scored => Ok(ExitCode::SUCCESS),
        Ending::Interrupted { steps } => Ok(interrupted(steps, &run)),
    }
}
