//! Runs the paper's comparison and writes its report. See `baselines --help`.

use std::panic::resume_unwind;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use clap::Parser;
use paig::baselines::earlier::Earlier;
use paig::baselines::list::{Comparison, Entry};
use paig::baselines::page::Report;
use paig::baselines::plan::{self, Places, Training};
use paig::baselines::results::{Row, Searched, searched};
use paig::cli::arguments::parse_seeds;
use paig::cli::ending::exit_code;
use paig::cli::generate_display::Display;
use paig::cli::sweep_display::SweepDisplay;
use paig::cli::{interrupt, whole};
use paig::generators::generate;
use paig::say;
use paig::support::device;
use paig::sweep::{self, Job};
use tch::Device;

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
    #[arg(long, default_value = "reports/baselines")]
    out: PathBuf,
    /// Folder of an earlier report, of another machine or of runs that are gone; may be repeated. What it holds is not trained
    /// again; of what was trained here, too, its rows are left out
    #[arg(long)]
    add: Vec<PathBuf>,
    /// Runs at a time; whole other models are trained one after the other on the CPU, so many at a time on a GPU
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
}

fn main() -> ExitCode {
    exit_code(|| Arguments::parse().run())
}

/// What is asked for.
struct Comparing {
    list: Comparison,
    places: Places,
    earlier: Earlier,
    clips: usize,
    jobs: usize,
    device: Device,
    began: Instant,
    budget: Option<Duration>,
}

impl Arguments {
    fn run(&self) -> Result<ExitCode> {
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
            budget: self.budget.map(|minutes| Duration::from_secs(60 * minutes)),
            list,
        };
        let seeds = self.seeds.as_deref().map_or_else(|| Ok(comparing.list.seeds.clone()), parse_seeds)?;
        let mut code = ExitCode::SUCCESS;
        if !self.report_only {
            interrupt::catch()?;
            let (models, tasks) = (comparing.models(&self.model)?, comparing.tasks(&self.task)?);
            code = comparing.train_all(&models, &tasks, &seeds, !self.no_search, self.efficiency)?;
        }
        comparing.report(&self.out)?;
        Ok(code)
    }
}

impl Comparing {
    fn models(&self, names: &[String]) -> Result<Vec<&Entry>> {
        if names.is_empty() {
            return Ok(self.list.models.iter().collect());
        }
        names.iter().map(|name| self.list.model(name)).collect()
    }

    fn tasks(&self, names: &[String]) -> Result<Vec<String>> {
        let known = &self.list.tasks;
        for name in names {
            ensure!(known.contains(name), "no task {name:?} in the comparison; its tasks are {}", known.join(", "));
        }
        Ok(if names.is_empty() { known.clone() } else { names.to_vec() })
    }

    fn stop(&self) -> bool {
        interrupt::asked() || self.budget.is_some_and(|budget| self.began.elapsed() > budget)
    }

    fn train_all(
        &self,
        models: &[&Entry],
        tasks: &[String],
        seeds: &[u64],
        search: bool,
        efficiency: bool,
    ) -> Result<ExitCode> {
        let mut failed = false;
        if search {
            let mut trainings = plan::search(&self.list, models, self.clips);
            trainings.retain(|training| !self.earlier.has_searched(training));
            failed |= self.train(&trainings)?;
        }
        let mut trainings = self.trainings(models, tasks, seeds, self.clips)?;
        if efficiency {
            let efficiency = &self.list.efficiency;
            let models: Vec<&Entry> =
                models.iter().copied().filter(|entry| efficiency.models.contains(&entry.name)).collect();
            for &clips in &efficiency.train {
                trainings.extend(self.trainings(&models, std::slice::from_ref(&efficiency.task), seeds, clips)?);
            }
        }
        trainings.retain(|training| self.earlier.row(training).is_none());
        failed |= self.train(&trainings)?;
        if self.stop() {
            say!("stopped; the same command goes on");
            return Ok(interrupt::exit_code());
        }
        Ok(if failed { ExitCode::FAILURE } else { ExitCode::SUCCESS })
    }

    /// What the search has found, here and earlier.
    fn searched(&self) -> Result<Vec<Searched>> {
        let here = searched(&self.places, &self.list, self.clips)?;
        Ok(here.into_iter().map(|searched| self.earlier.completed(searched)).collect())
    }

    /// The trainings on so many clips, with the rates that the search has found.
    fn trainings<'a>(
        &self,
        models: &[&'a Entry],
        tasks: &[String],
        seeds: &[u64],
        clips: usize,
    ) -> Result<Vec<Training<'a>>> {
        let found = self.searched()?;
        let rate = |entry: &Entry| found.iter().find(|search| search.model == entry.name)?.chosen;
        let mut trainings = Vec::new();
        for task in tasks {
            for &seed in seeds {
                trainings.extend(models.iter().map(|&entry| Training {
                    entry,
                    task: task.clone(),
                    clips,
                    seed,
                    rate: rate(entry),
                    searched: false,
                }));
            }
        }
        Ok(trainings)
    }

    /// Makes the data, finds the objects, trains. Whether anything failed.
    fn train(&self, trainings: &[Training]) -> Result<bool> {
        let mut objects: Vec<Job> = Vec::new();
        for training in trainings {
            let display = Display::default();
            let dataset = self.places.dataset(&training.task, self.list.clips, training.clips)?;
            generate(&dataset, &|event| display.show(event))?;
            let job = self.places.objects(&self.list, training)?;
            objects.extend(job.filter(|job| !objects.contains(job)));
        }
        let mut failed = self.sweep(&objects)?;
        let (whole, own): (Vec<&Training>, Vec<_>) =
            trainings.iter().partition(|training| training.entry.whole.is_some());
        let jobs = own.iter().map(|training| self.places.job(&self.list, training)).collect::<Result<Vec<_>>>()?;
        failed |= self.sweep(&jobs)?;
        self.train_whole(&whole)?;
        Ok(failed)
    }

    /// Trains whole other models: in turn on the CPU, each with all threads; side by side on a GPU, of which each needs little.
    fn train_whole(&self, trainings: &[&Training]) -> Result<()> {
        let Comparing { jobs, places: Places { threads, .. }, .. } = self;
        let (at_once, threads) = if self.device == Device::Cpu { (1, jobs * threads) } else { (*jobs, *threads) };
        device::set_threads(threads)?;
        let next = AtomicUsize::new(0);
        let work = || {
            while let Some(training) = trainings.get(next.fetch_add(1, Ordering::Relaxed)).filter(|_| !self.stop()) {
                let (config, folder) =
                    (self.places.whole(&self.list, training)?, self.places.folder(&self.list, training)?);
                whole::train(&config, &folder, self.device, &|| self.stop())?;
            }
            Ok(())
        };
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..at_once).map(|_| scope.spawn(work)).collect();
            threads.into_iter().try_for_each(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic)))
        })
    }

    fn sweep(&self, jobs: &[Job]) -> Result<bool> {
        if jobs.is_empty() || self.stop() {
            return Ok(false);
        }
        let this = std::env::current_exe().context("cannot find this program's own place")?;
        let program = this.with_file_name("run_physics");
        ensure!(program.exists(), "{} is missing; build it with `cargo build --release`", program.display());
        let mut display = SweepDisplay::new(jobs.len());
        let ended = sweep::run(&program, jobs, self.jobs, &|| self.stop(), &mut |event| display.show(event))?;
        display.close();
        Ok(!ended.failed.is_empty())
    }

    /// Writes the report of all trainings that are there.
    fn report(&self, out: &std::path::Path) -> Result<()> {
        let models = self.models(&[])?;
        let mut trainings = self.trainings(&models, &self.list.tasks, &self.list.seeds, self.clips)?;
        for &clips in self.list.efficiency.train.iter().filter(|clips| **clips != self.clips) {
            trainings.extend(self.trainings(
                &models,
                std::slice::from_ref(&self.list.efficiency.task),
                &self.list.seeds,
                clips,
            )?);
        }
        let mut rows = Vec::new();
        for training in &trainings {
            let here = Row::read(&self.places, &self.list, training)?;
            rows.extend(here.or_else(|| self.earlier.row(training).cloned()));
        }
        ensure!(!rows.is_empty(), "{} holds no finished training of the comparison", self.places.runs.display());
        let searched = self.searched()?;
        let count = rows.len();
        Report { list: &self.list, rows, searched, clips: self.clips }.write(out)?;
        say!("{count} trainings; {}", out.join("report.md").display());
        Ok(())
    }
}
