//! Runs the paper's comparison and writes its report. See `baselines --help`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use clap::Parser;
use paig::baselines::earlier::Earlier;
use paig::baselines::list::Comparison;
use paig::baselines::plan::Places;
use paig::cli::arguments::parse_seeds;
use paig::cli::comparison::Comparing;
use paig::cli::ending::exit_code;
use paig::cli::{environment, interrupt};
use paig::support::device;

/// Trains other dynamics, other decoders and whole other models beside the physics, and shows what each predicts.
///
/// Learning rates are searched first. Given again, the same command skips what has finished and goes on with what was cut
/// off; the report is made of all trainings that are there.
#[derive(Parser)]
#[command(
    version,
    after_help = "Examples:\n  baselines --jobs 2\n  baselines --task spring_color --model physics --model lstm --seeds 0 \
                  --budget 60\n  baselines --report-only --add reports/baselines"
)]
struct Arguments {
    /// What is compared
    #[arg(long, default_value = "configs/baselines.toml")]
    list: PathBuf,
    /// A task of the list; may be repeated [default: all]
    #[arg(long)]
    task: Vec<String>,
    /// A model of the list; may be repeated [default: all]
    #[arg(long)]
    model: Vec<String>,
    /// Seeds [default: those of the list]
    #[arg(long)]
    seeds: Option<String>,
    /// Training clips of each dataset [default: those of the list]
    #[arg(long)]
    clips: Option<usize>,
    /// Do not search learning rates; take those that are known already
    #[arg(long)]
    no_search: bool,
    /// Also train on the list's smaller numbers of clips
    #[arg(long)]
    efficiency: bool,
    /// Folder of the datasets
    #[arg(long, default_value = "data/baselines")]
    data: PathBuf,
    /// Folder of the runs
    #[arg(long, default_value = "runs/baselines")]
    runs: PathBuf,
    /// Folder of the report
    #[arg(long, default_value = "runs/baselines/report")]
    out: PathBuf,
    /// Folder of an earlier report, of another machine or of runs that are gone; may be repeated. What it holds is not trained
    /// again; of what was trained here, too, its rows are left out
    #[arg(long)]
    add: Vec<PathBuf>,
    /// Runs at a time
    #[arg(long, default_value_t = 1)]
    jobs: usize,
    /// cpu, cuda or cuda:n
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Threads of each run
    #[arg(long, default_value_t = 1)]
    threads: usize,
    /// Minutes after which what runs is saved and stopped [default: none]
    #[arg(long)]
    budget: Option<u64>,
    /// Only write the report of the trainings that are there
    #[arg(long)]
    report_only: bool,
    /// Draw no figures: a report that is small enough to be kept in a repository
    #[arg(long)]
    no_pictures: bool,
}

fn main() -> ExitCode {
    exit_code(|| Arguments::parse().run())
}

impl Arguments {
    fn run(&self) -> Result<ExitCode> {
        environment::set();
        ensure!(self.jobs > 0 && self.threads > 0, "--jobs and --threads must be at least 1");
        let list = Comparison::read(&self.list)?;
        let comparing = Comparing {
            clips: self.clips.unwrap_or(list.clips.train),
            places: Places {
                data: self.data.clone(),
                runs: self.runs.clone(),
                threads: self.threads,
                device: self.device.clone(),
            },
            device: device::parse(&self.device)?,
            earlier: Earlier::read(&self.add)?,
            jobs: self.jobs,
            began: Instant::now(),
            budget: self.budget.map(|minutes| Duration::from_secs(minutes.saturating_mul(60))),
            list,
        };
        let seeds = self.seeds.as_deref().map_or_else(|| Ok(comparing.list.seeds.clone()), parse_seeds)?;
        let reported = comparing.list.seeds_with(&seeds)?;
        let mut code = ExitCode::SUCCESS;
        if !self.report_only {
            interrupt::catch()?;
            let (models, tasks) = (comparing.models(&self.model)?, comparing.tasks(&self.task)?);
            code = comparing.train_all(&models, &tasks, &seeds, !self.no_search, self.efficiency)?;
        }
        comparing.report(&reported, &self.out, !self.no_pictures)?;
        Ok(code)
    }
}
