//! Runs the stress suite and writes its report. See `paig stress --help`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use anyhow::{Result, ensure};
use clap::Args;
use paig_experiments::stress::page;
use paig_experiments::stress::{Reported, StressEvent, StressList, Suite, SuiteEnd, SuiteWatch};
use paig_experiments::sweep::{self, parse_seeds};
use paig_terminal::generate_display::GenerateDisplay;
use paig_terminal::{interrupt, say};

use crate::sweep_display::SweepDisplay;
use paig::Error;
use paig::support::guard::ensure_no_run;

/// Learns scenes unlike the paper's with the plain recipe, and writes a matrix of what became of them.
///
/// Each scene is filmed once for each data seed and learned from that. Given again, the same command skips what has
/// finished and goes on with what was cut off; the report is made of all runs with these data seeds that are there.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  paig stress --jobs 2\n  paig stress --scene spring_noise_10 --data-seeds 1 --report-only"
)]
pub struct StressArguments {
    /// List of the scenes; their files lie in a folder of its name beside it
    #[arg(long, default_value = "configs/stress.toml")]
    list: PathBuf,
    /// A scene of the list; may be repeated [default: all]
    #[arg(long)]
    scene: Vec<String>,
    /// Seeds of the datasets. What is filmed with seed N is learned with seed N, of scenes that the list marks `nine` also
    /// with N + 100 and N + 200
    #[arg(long, default_value = "1-3")]
    data_seeds: String,
    /// Folder of the datasets
    #[arg(long, default_value = "data/stress")]
    data: PathBuf,
    /// Folder of the runs
    #[arg(long, default_value = "runs/stress")]
    runs: PathBuf,
    /// Folder of the report
    #[arg(long, default_value = "runs/stress/report")]
    out: PathBuf,
    /// The results.json of the suite's runs on another machine, by the same version of the program; may be repeated. Of what
    /// was run here, too, its rows are left out
    #[arg(long)]
    add: Vec<PathBuf>,
    /// Runs at a time, one thread each
    #[arg(long, default_value_t = 1)]
    jobs: usize,
    /// Only write the report of the runs that are there
    #[arg(long)]
    report_only: bool,
    /// Draw no pictures: a report that is small enough to be kept in a repository
    #[arg(long)]
    no_pictures: bool,
}

pub fn run(arguments: &StressArguments) -> Result<ExitCode> {
    ensure!(arguments.jobs > 0, "--jobs must be at least 1");
    let list = StressList::read(&arguments.list)?;
    list.of_names(&arguments.scene)?;
    let data_seeds = parse_seeds(&arguments.data_seeds)?;
    // Not after trainings that take hours.
    ensure_no_run(&arguments.out)?;
    page::FILES.check(&arguments.out)?;
    let suite = Suite { list, data_seeds, data: arguments.data.clone(), runs: arguments.runs.clone() };
    let shown = SuiteDisplay::default();
    let code = if arguments.report_only { ExitCode::SUCCESS } else { train(arguments, &suite, &shown)? };
    let pictures = !arguments.no_pictures;
    let reported = suite.report(&arguments.add, &arguments.out, pictures, &|event| shown.show(event));
    // Where runs were trained, the arguments were sound.
    let Reported { runs, succeeded } = if arguments.report_only { reported } else { reported.map_err(Error::of_work) }?;
    say!("{succeeded} of {runs} runs succeeded; {}", arguments.out.join("report.md").display());
    Ok(code)
}

fn train(arguments: &StressArguments, suite: &Suite, shown: &SuiteDisplay) -> Result<ExitCode> {
    let program = sweep::training_program()?;
    interrupt::catch()?;
    let scenes = suite.list.of_names(&arguments.scene)?;
    let watch = SuiteWatch { observe: &|event| shown.show(event), stop: &interrupt::asked };
    Ok(match suite.train(&program, &scenes, arguments.jobs, watch)? {
        SuiteEnd::Finished => ExitCode::SUCCESS,
        SuiteEnd::Failed => ExitCode::FAILURE,
        SuiteEnd::Stopped => {
            say!("stopped; the same command goes on");
            interrupt::exit_code()
        }
    })
}

/// The suite on the terminal.
#[derive(Debug, Default)]
struct SuiteDisplay {
    data: GenerateDisplay,
    runs: Mutex<Option<SweepDisplay>>,
}

impl SuiteDisplay {
    fn show(&self, event: StressEvent) {
        let mut runs = self.runs.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            StressEvent::Data(event) => self.data.show(event),
            StressEvent::RunsBegin(count) => *runs = Some(SweepDisplay::new(count)),
            StressEvent::Run(event) => runs.iter_mut().for_each(|runs| runs.show(&event)),
            StressEvent::RunsEnd => runs.take().iter().for_each(SweepDisplay::close),
            StressEvent::Unfinished(folder) => say!("{}: not finished", folder.display()),
            StressEvent::Unreadable { scene, data_seed, seed, error } => {
                say!("{scene}, data {data_seed}, seed {seed}: {error:#}");
            }
        }
    }
}
