//! The suite as a whole: its datasets, its runs, its report.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use super::list::{DataSeed, StressList, SuiteScene};
use super::matrix::{SceneOutcome, outcome};
use super::page;
use crate::sweep::{self, SweepEvent};
use paig::Error;
use paig::generators::{GeneratorEvent, generate};
use paig::support::storage;

/// What happens in the suite.
#[derive(Debug)]
pub enum StressEvent<'a> {
    /// Of a dataset.
    Data(GeneratorEvent<'a>),
    /// So many runs begin.
    RunsBegin(usize),
    Run(SweepEvent<'a>),
    RunsEnd,
    /// The report has no results of this run.
    Unfinished(&'a Path),
    /// The report cannot read this run.
    Unreadable {
        scene: &'a str,
        data_seed: DataSeed,
        seed: u64,
        error: &'a anyhow::Error,
    },
}

/// Who watches the suite, from whatever thread, and stops it.
#[derive(Clone, Copy)]
pub struct SuiteWatch<'a> {
    pub observe: &'a (dyn Fn(StressEvent) + Sync),
    pub stop: &'a (dyn Fn() -> bool + Sync),
}

/// How the runs ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SuiteEnd {
    Finished,
    /// A run failed; the others are finished.
    Failed,
    Stopped,
}

/// How many runs a report has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reported {
    pub runs: usize,
    pub succeeded: usize,
}

/// The suite and where it stands.
#[derive(Debug)]
pub struct Suite {
    pub list: StressList,
    pub data_seeds: Vec<DataSeed>,
    /// Folder of the datasets.
    pub data: PathBuf,
    /// Folder of the runs.
    pub runs: PathBuf,
}

impl Suite {
    /// Makes the datasets of these scenes and trains on them, one data seed after the other, `jobs` runs at a time with
    /// one thread each. Finished runs are skipped. `program` is the one that trains.
    ///
    /// # Errors
    /// A dataset that cannot be made, a run folder of another config. A run that fails is an event, and the others go on.
    pub fn train(
        &self,
        program: &Path,
        scenes: &[&SuiteScene],
        jobs: usize,
        watch: SuiteWatch,
    ) -> Result<SuiteEnd, Error> {
        self.trained(program, scenes, jobs, watch).map_err(Error::of_work)
    }

    fn trained(&self, program: &Path, scenes: &[&SuiteScene], jobs: usize, watch: SuiteWatch) -> Result<SuiteEnd> {
        let mut failed = false;
        for &data_seed in &self.data_seeds {
            let mut of_seed = Vec::new();
            for scene in scenes {
                generate(&scene.dataset(&self.data, data_seed)?, &|event| (watch.observe)(StressEvent::Data(event)))?;
                of_seed.extend(scene.plan(&self.data, &self.runs, data_seed, 1).jobs()?);
            }
            (watch.observe)(StressEvent::RunsBegin(of_seed.len()));
            let observe = &mut |event: SweepEvent| (watch.observe)(StressEvent::Run(event));
            let ended = sweep::run(program, &of_seed, jobs, watch.stop, observe)?;
            (watch.observe)(StressEvent::RunsEnd);
            failed |= !ended.failed.is_empty();
            if ended.stopped > 0 {
                return Ok(SuiteEnd::Stopped);
            }
        }
        Ok(if failed { SuiteEnd::Failed } else { SuiteEnd::Finished })
    }

    /// Writes the report of the runs of all scenes into `out`, with the outcomes of `others`, files of other machines; with or
    /// without pictures.
    ///
    /// # Errors
    /// No run at all, a file that cannot be read or written.
    pub fn report(
        &self,
        others: &[PathBuf],
        out: &Path,
        pictures: bool,
        observe: &dyn Fn(StressEvent),
    ) -> Result<Reported, Error> {
        Ok(self.reported(others, out, pictures, observe)?)
    }

    fn reported(
        &self,
        others: &[PathBuf],
        out: &Path,
        pictures: bool,
        observe: &dyn Fn(StressEvent),
    ) -> Result<Reported> {
        let mut outcomes = Vec::new();
        let mut pictured = BTreeMap::new();
        for scene in &self.list.scenes {
            for &data_seed in &self.data_seeds {
                for (seed, run) in scene.runs(&self.data, &self.runs, data_seed)? {
                    outcomes.push(outcome(scene, data_seed, seed, &run)?);
                    match run {
                        Ok(run) if run.summary.is_some() => _ = pictured.entry(scene.name.clone()).or_insert(run),
                        Ok(run) => observe(StressEvent::Unfinished(&run.folder)),
                        Err(error) => {
                            observe(StressEvent::Unreadable { scene: &scene.name, data_seed, seed, error: &error });
                        }
                    }
                }
            }
        }
        others.iter().try_for_each(|file| add(&mut outcomes, file))?;
        let place = |outcome: &SceneOutcome| self.list.scenes.iter().position(|scene| scene.name == outcome.scene);
        outcomes.sort_by_key(|outcome| (place(outcome), outcome.data_seed, outcome.seed));
        ensure!(!outcomes.is_empty(), "{} holds no run of the suite", self.runs.display());
        page::write(out, &self.list, &outcomes, pictures.then_some(&pictured))?;
        let succeeded = outcomes.iter().filter(|outcome| outcome.succeeded).count();
        Ok(Reported { runs: outcomes.len(), succeeded })
    }
}

/// Adds those outcomes of a file whose run is not among them, or has not finished.
fn add(outcomes: &mut Vec<SceneOutcome>, file: &Path) -> Result<()> {
    let read = || Ok::<Vec<SceneOutcome>, anyhow::Error>(serde_json::from_slice(&storage::read(file)?)?);
    let run = |outcome: &SceneOutcome| (outcome.scene.clone(), outcome.data_seed, outcome.seed);
    let others = read().with_context(|| format!("results of another machine, {}", file.display()))?;
    let there: BTreeSet<_> = others.iter().map(run).collect();
    outcomes.retain(|outcome| outcome.finished || !there.contains(&run(outcome)));
    let here: BTreeSet<_> = outcomes.iter().map(run).collect();
    outcomes.extend(others.into_iter().filter(|other| !here.contains(&run(other))));
    Ok(())
}
