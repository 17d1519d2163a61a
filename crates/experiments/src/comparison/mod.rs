//! The paper's comparison, from its list to its report.

pub mod end_to_end_run;

use std::collections::BTreeSet;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use paig::Error;
use paig::generators::{GeneratorEvent, generate};
use paig::runs::folder::RunFolder;
use paig::runs::metrics::Record;
use paig::support::device;
use tch::Device;

use self::end_to_end_run::EndToEndRun;
use crate::baselines::earlier::Earlier;
use crate::baselines::list::{BaselineEntry, Comparison};
use crate::baselines::page::Report;
use crate::baselines::plan::{self, BaselineFolders, Training};
use crate::baselines::results::{BaselineRow, Searched, searched};
use crate::sweep::{self, SweepEvent, SweepJob};

/// What happens in a comparison.
#[derive(Debug)]
pub enum ComparisonEvent<'a> {
    /// Of a dataset.
    Data(GeneratorEvent<'a>),
    /// So many runs begin.
    RunsBegin(usize),
    Run(SweepEvent<'a>),
    RunsEnd,
    /// A validation of an end-to-end baseline.
    Validated(&'a Path, &'a Record),
    /// An end-to-end baseline could not be trained.
    Failed(&'a Path, &'a anyhow::Error),
}

/// Who watches a comparison, from whatever thread, and stops it.
#[derive(Clone, Copy)]
pub struct ComparisonWatch<'a> {
    pub observe: &'a (dyn Fn(ComparisonEvent) + Sync),
    pub stop: &'a (dyn Fn() -> bool + Sync),
}

/// How a comparison ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ComparisonEnd {
    Finished,
    /// A training failed; the others are finished.
    Failed,
    Stopped,
}

/// What is asked for.
#[derive(Debug)]
pub struct Comparing {
    /// The program that trains.
    pub program: PathBuf,
    pub list: Comparison,
    pub places: BaselineFolders,
    pub earlier: Earlier,
    /// Training clips of each dataset.
    pub clips: usize,
    /// Runs at a time.
    pub jobs: usize,
    pub device: Device,
    pub began: Instant,
    /// After which what runs is saved and stopped.
    pub budget: Option<Duration>,
}

impl Comparing {
    /// Those of these names, or all, in the order of the list.
    ///
    /// # Errors
    /// A name that is not in the list.
    pub fn models(&self, names: &[String]) -> Result<Vec<&BaselineEntry>> {
        let chosen = names.iter().map(|name| self.list.model(name)).collect::<Result<Vec<_>>>()?;
        let is_chosen =
            |entry: &&BaselineEntry| names.is_empty() || chosen.iter().any(|chosen| chosen.name == entry.name);
        Ok(self.list.models.iter().filter(is_chosen).collect())
    }

    /// The same of tasks.
    ///
    /// # Errors
    /// A name that is not in the list.
    pub fn tasks(&self, names: &[String]) -> Result<Vec<String>> {
        let known = &self.list.tasks;
        for name in names {
            ensure!(known.contains(name), "no task {name:?} in the comparison; its tasks are {}", known.join(", "));
        }
        Ok(known.iter().filter(|task| names.is_empty() || names.contains(task)).cloned().collect())
    }

    fn stop(&self, watch: ComparisonWatch) -> bool {
        (watch.stop)() || self.budget.is_some_and(|budget| self.began.elapsed() > budget)
    }

    /// Searches learning rates, then trains, also on fewer clips where `efficiency` asks for it. What is there is not made again.
    ///
    /// # Errors
    /// Data or programs that are missing. A training that fails is an event, and the others go on.
    pub fn train_all(
        &self,
        models: &[&BaselineEntry],
        tasks: &[String],
        seeds: &[u64],
        search: bool,
        efficiency: bool,
        watch: ComparisonWatch,
    ) -> Result<ComparisonEnd, Error> {
        let mut failed = false;
        if search {
            let mut trainings = plan::search(&self.list, models, self.clips);
            trainings.retain(|training| !self.earlier.has_searched(&self.list, training));
            failed |= self.train(&trainings, watch)?;
        }
        let mut trainings = self.trainings(models, tasks, seeds, self.clips)?;
        if efficiency {
            let efficiency = &self.list.efficiency;
            let models: Vec<&BaselineEntry> =
                models.iter().copied().filter(|entry| efficiency.models.contains(&entry.name)).collect();
            for &clips in &efficiency.train {
                trainings.extend(self.trainings(&models, std::slice::from_ref(&efficiency.task), seeds, clips)?);
            }
        }
        trainings.retain(|training| self.earlier.row(&self.list, training).is_none());
        failed |= self.train(&trainings, watch)?;
        Ok(match (self.stop(watch), failed) {
            (true, _) => ComparisonEnd::Stopped,
            (false, true) => ComparisonEnd::Failed,
            (false, false) => ComparisonEnd::Finished,
        })
    }

    /// What the search has found, here and earlier.
    fn searched(&self) -> Result<Vec<Searched>> {
        let here = searched(&self.places, &self.list, self.clips)?;
        Ok(here.into_iter().map(|searched| self.earlier.completed(searched)).collect())
    }

    /// The trainings on so many clips, with the rates that the search has found.
    fn trainings<'a>(
        &self,
        models: &[&'a BaselineEntry],
        tasks: &[String],
        seeds: &[u64],
        clips: usize,
    ) -> Result<Vec<Training<'a>>> {
        let found = self.searched()?;
        let rate = |entry: &BaselineEntry| found.iter().find(|search| search.model == entry.name)?.chosen;
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
    fn train(&self, trainings: &[Training], watch: ComparisonWatch) -> Result<bool> {
        let (mut objects, mut made): (Vec<SweepJob>, _) = (Vec::new(), BTreeSet::new());
        for training in trainings {
            if made.insert((&training.task, training.clips)) {
                let dataset = self.places.dataset(&training.task, self.list.clips, training.clips)?;
                generate(&dataset, &|event| (watch.observe)(ComparisonEvent::Data(event)))?;
            }
            let job = self.places.objects(&self.list, training)?;
            objects.extend(job.filter(|job| !objects.contains(job)));
        }
        let mut failed = self.sweep(&objects, watch)?;
        let (whole, own): (Vec<&Training>, Vec<_>) =
            trainings.iter().partition(|training| training.entry.whole.is_some());
        let jobs = own.iter().map(|training| self.places.job(&self.list, training)).collect::<Result<Vec<_>>>()?;
        failed |= self.sweep(&jobs, watch)?;
        failed |= self.train_whole(&whole, watch)?;
        Ok(failed)
    }

    /// Trains end-to-end baselines, so many at a time. Whether one failed, which stops no other one.
    fn train_whole(&self, trainings: &[&Training], watch: ComparisonWatch) -> Result<bool> {
        if trainings.is_empty() {
            return Ok(false);
        }
        let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
        let work = || {
            // libtorch keeps it for each thread of the program.
            device::set_threads(self.places.threads)?;
            while let Some(training) = trainings.get(next.fetch_add(1, Ordering::Relaxed)).filter(|_| !self.stop(watch))
            {
                let (config, folder) =
                    (self.places.whole(&self.list, training)?, self.places.folder(&self.list, training)?);
                sweep::forget_failure(&folder)?;
                let observe = &mut |record: &Record| (watch.observe)(ComparisonEvent::Validated(&folder, record));
                let run = EndToEndRun::prepare(&config, self.device);
                if let Err(error) = run.and_then(|run| run.train(&folder, &|| self.stop(watch), observe)) {
                    let error = anyhow::Error::from(error);
                    (watch.observe)(ComparisonEvent::Failed(&folder, &error));
                    // One that another process has under way did not fail.
                    if !RunFolder::is_in_use(&folder) {
                        sweep::note_failure(&folder, &error);
                    }
                    failed.store(true, Ordering::Relaxed);
                }
            }
            Ok::<_, anyhow::Error>(())
        };
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..self.jobs.min(trainings.len())).map(|_| scope.spawn(work)).collect();
            threads.into_iter().try_for_each(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic)))
        })?;
        Ok(failed.into_inner())
    }

    fn sweep(&self, jobs: &[SweepJob], watch: ComparisonWatch) -> Result<bool> {
        if jobs.is_empty() || self.stop(watch) {
            return Ok(false);
        }
        (watch.observe)(ComparisonEvent::RunsBegin(jobs.len()));
        let observe = &mut |event: SweepEvent| (watch.observe)(ComparisonEvent::Run(event));
        let ended = sweep::run(&self.program, jobs, self.jobs, &|| self.stop(watch), observe)?;
        (watch.observe)(ComparisonEvent::RunsEnd);
        Ok(!ended.failed.is_empty())
    }

    /// Writes the report of all trainings with these seeds that are there, with or without figures. Returns how many there are.
    ///
    /// # Errors
    /// None that has finished, a folder that cannot be written.
    pub fn report(&self, seeds: &[u64], out: &Path, pictures: bool) -> Result<usize, Error> {
        Ok(self.reported(seeds, out, pictures)?)
    }

    fn reported(&self, seeds: &[u64], out: &Path, pictures: bool) -> Result<usize> {
        let models = self.models(&[])?;
        let mut trainings = self.trainings(&models, &self.list.tasks, seeds, self.clips)?;
        for &clips in self.list.efficiency.train.iter().filter(|clips| **clips != self.clips) {
            trainings.extend(self.trainings(
                &models,
                std::slice::from_ref(&self.list.efficiency.task),
                seeds,
                clips,
            )?);
        }
        let mut rows = Vec::new();
        for training in &trainings {
            let here = BaselineRow::read(&self.places, &self.list, training)?;
            rows.extend(here.or_else(|| self.earlier.row(&self.list, training).cloned()));
        }
        ensure!(!rows.is_empty(), "{} holds no finished training of the comparison", self.places.runs.display());
        let searched = self.searched()?;
        let count = rows.len();
        Report { list: &self.list, seeds, rows, searched, clips: self.clips, pictures }.write(out)?;
        Ok(count)
    }
}
