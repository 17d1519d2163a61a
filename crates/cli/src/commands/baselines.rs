//! Runs the paper's comparison and writes its report. See `paig baselines --help`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use clap::Args;
use paig_experiments::baselines::earlier::Earlier;
use paig_experiments::baselines::list::Comparison;
use paig_experiments::baselines::page;
use paig_experiments::baselines::plan::BaselineFolders;
use paig_experiments::comparison::{Comparing, ComparisonEnd, ComparisonEvent, ComparisonWatch};
use paig_experiments::sweep::{self, parse_seeds};
use paig_terminal::generate_display::GenerateDisplay;
use paig_terminal::{interrupt, say};

use crate::sweep_display::SweepDisplay;
use paig::support::device;
use paig::support::guard::ensure_no_run;

/// Trains other dynamics, other decoders and end-to-end baselines beside the physics, and shows what each predicts.
///
/// Learning rates are searched first. Given again, the same command skips what has finished and goes on with what was cut
/// off; the report is made of all trainings that are there.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  paig baselines --jobs 2\n  paig baselines --task spring_color --model physics --model lstm --seeds 0 \
                  --budget 60\n  paig baselines --report-only --add reports/baselines"
)]
pub struct BaselinesArguments {
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

impl BaselinesArguments {
    pub fn run(&self) -> Result<ExitCode> {
        ensure!(self.jobs > 0 && self.threads > 0, "--jobs and --threads must be at least 1");
        let list = Comparison::read(&self.list)?;
        // Not after trainings that take hours.
        ensure_no_run(&self.out)?;
        page::FILES.check(&self.out)?;
        let comparing = Comparing {
            program: sweep::training_program()?,
            clips: self.clips.unwrap_or(list.clips.train),
            places: BaselineFolders {
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
            let shown = ComparisonDisplay::default();
            let watch = ComparisonWatch { observe: &|event| shown.show(event), stop: &interrupt::asked };
            code = match comparing.train_all(&models, &tasks, &seeds, !self.no_search, self.efficiency, watch)? {
                ComparisonEnd::Finished => ExitCode::SUCCESS,
                ComparisonEnd::Failed => ExitCode::FAILURE,
                ComparisonEnd::Stopped => {
                    say!("stopped; the same command goes on");
                    interrupt::exit_code()
                }
            };
        }
        let count = comparing.report(&reported, &self.out, !self.no_pictures)?;
        say!("{count} trainings; {}", self.out.join("report.md").display());
        Ok(code)
    }
}

/// A comparison on the terminal.
#[derive(Debug, Default)]
struct ComparisonDisplay {
    data: GenerateDisplay,
    runs: Mutex<Option<SweepDisplay>>,
}

impl ComparisonDisplay {
    fn show(&self, event: ComparisonEvent) {
        let mut runs = self.runs.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            ComparisonEvent::Data(event) => self.data.show(event),
            ComparisonEvent::RunsBegin(count) => *runs = Some(SweepDisplay::new(count)),
            ComparisonEvent::Run(event) => runs.iter_mut().for_each(|runs| runs.show(&event)),
            ComparisonEvent::RunsEnd => runs.take().iter().for_each(SweepDisplay::close),
            ComparisonEvent::Validated(folder, record) => {
                let error = record.score.unwrap_or(f64::NAN);
                say!("{} - step {}: validation error {error:.4}", folder.display(), record.step);
            }
            ComparisonEvent::Failed(folder, error) => say!("FAILED {}: {error:#}", folder.display()),
        }
    }
}
