//! Measures what a run learned from videos. See `paig measure --help`.

use std::path::PathBuf;

use crate::measure_display::print_measurement;
use anyhow::Result;
use clap::Args;
use paig::support::device;
use paig::tasks::equation_file::EquationFile;
use paig_terminal::environment;
use paig_terminal::say;
use paig_video::measure::{Request, measure};

/// Measures the parameters of a run's videos: fits the equation to every frame as one long trajectory, predicts the last
/// quarter, and says how far all of it can be trusted.
///
/// `paig train` does this at the end of a run on a task that `paig import` made. Writes measurement.json, measurement.html,
/// measurement-positions.png, positions.csv and overlay.gif.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  paig measure runs/my-scene/fast/seed=0\n  \
                  measure runs/my-scene/fast/seed=0 --against configs/gallery/free_pendulum.toml")]
pub struct Arguments {
    /// Run folder
    run: PathBuf,
    /// File with another equation than the run's own, in [system.equation] as in a task
    #[arg(long, value_name = "FILE")]
    equation: Option<PathBuf>,
    /// File with an equation to be compared with; may be repeated
    #[arg(long, value_name = "FILE")]
    against: Vec<PathBuf>,
    /// Folder for the files [default: the run's]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// cpu, cuda or cuda:n
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Threads to compute with; 0 for one a core
    #[arg(long, default_value_t = 0)]
    threads: usize,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    environment::set();
    let device = device::parse(&arguments.device)?;
    device::set_threads(arguments.threads)?;
    let request = Request {
        equation: arguments.equation.as_deref().map(EquationFile::read).transpose()?,
        against: arguments.against.iter().map(|path| EquationFile::read(path)).collect::<Result<_>>()?,
    };
    let out = arguments.out.as_ref().unwrap_or(&arguments.run);
    let measurement = measure(&arguments.run, &request, out, device)?;
    print_measurement(&measurement);
    say!("look at {}", out.join("measurement.html").display());
    Ok(())
}
