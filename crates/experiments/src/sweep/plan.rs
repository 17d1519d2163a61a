//! Which runs a sweep has, where they go, and how far each is.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use paig::support::command_line::CommandOptions;
use paig::support::run_names::{CONFIG, DONE};
use paig::training::config::Config;
use paig::training::layers::Overrides;

/// What is to be run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SweepPlan {
    pub tasks: Vec<String>,
    pub seeds: Vec<u64>,
    pub recipe: String,
    /// Distinguishes the folders of runs with a changed recipe.
    pub name: Option<String>,
    pub config: Option<PathBuf>,
    /// `section.key=value`, as in [`Overrides`].
    pub set: Vec<String>,
    pub data: Option<PathBuf>,
    pub device: Option<String>,
    /// Threads of each run.
    pub threads: usize,
    /// Runs go to `OUT/TASK/RECIPE/seed=N`, or `OUT/TASK/RECIPE-NAME/seed=N`.
    pub out: PathBuf,
}

/// One run of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepJob {
    pub task: String,
    pub seed: u64,
    pub folder: PathBuf,
    /// What the run's config must be.
    config: Config,
    /// Options of the training program for a run from the start, without the folder.
    pub(super) options: CommandOptions,
}

/// How far a job is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JobStage {
    New,
    CutOff,
    Finished,
}

impl SweepPlan {
    /// The runs, all seeds of a task after each other.
    ///
    /// # Errors
    /// An unknown task, recipe or key, an unsound name, a change of the recipe without a name.
    pub fn jobs(&self) -> Result<Vec<SweepJob>> {
        let changed = !self.set.is_empty() || self.config.is_some();
        ensure!(
            !changed || self.name.is_some(),
            "--set and --config change the recipe: give it a name with --name, for its run folders"
        );
        let variant = match &self.name {
            None => self.recipe.clone(),
            Some(name) => {
                let sound = |c: char| c.is_ascii_alphanumeric() || "._-=".contains(c);
                ensure!(
                    !name.is_empty() && name.chars().all(sound),
                    "--name {name:?}: only letters, digits, '.', '_', '-' and '=' can stand in a folder's name"
                );
                format!("{}-{name}", self.recipe)
            }
        };
        let job = |(task, seed): (&String, u64)| {
            let config = Config::load(self.config.as_deref(), &self.overrides(task, seed))?;
            let folder = self.out.join(&config.task.name).join(&variant).join(format!("seed={seed}"));
            let options = self.shared_options(task).with("seed", seed.to_string());
            let options = options.with("threads", self.threads.to_string());
            Ok(SweepJob { task: task.clone(), seed, folder, config, options })
        };
        self.runs().map(job).collect()
    }

    /// A shell command for each run, for schedulers: a sweep of that run alone, so that it is skipped, resumed and
    /// marked in the same way. `program` is `paig`. The threads are said only where they were asked for: the
    /// machine that will run it may have other cores than this one.
    ///
    /// # Errors
    /// A path that cannot be quoted.
    pub fn commands(&self, program: &Path, threads: Option<usize>) -> Result<Vec<String>> {
        let command = |(task, seed): (&String, u64)| {
            self.shared_options(task)
                .with("seeds", seed.to_string())
                .with_each("threads-per-run", threads.map(|threads| threads.to_string()))
                .with("out", &self.out)
                .with_each("name", &self.name)
                .shell(program, "sweep")
        };
        self.runs().map(command).collect()
    }

    /// All seeds of a task after each other.
    fn runs(&self) -> impl Iterator<Item = (&String, u64)> {
        self.tasks.iter().flat_map(|task| self.seeds.iter().map(move |seed| (task, *seed)))
    }

    fn overrides(&self, task: &str, seed: u64) -> Overrides {
        Overrides {
            task: Some(task.into()),
            recipe: Some(self.recipe.clone()),
            seed: Some(seed),
            device: self.device.clone(),
            threads: Some(self.threads),
            data: self.data.clone(),
            set: self.set.clone(),
        }
    }

    /// What the training and the sweep program call the same.
    fn shared_options(&self, task: &str) -> CommandOptions {
        CommandOptions::default()
            .with("task", task)
            .with("recipe", &self.recipe)
            .with_each("config", &self.config)
            .with_each("data", &self.data)
            .with_each("set", &self.set)
            .with_each("device", &self.device)
    }
}

/// Runs that are asked for twice, once.
///
/// # Errors
/// Two different runs that would share a folder.
pub(super) fn each_once(jobs: Vec<SweepJob>) -> Result<Vec<SweepJob>> {
    let mut distinct: Vec<SweepJob> = Vec::with_capacity(jobs.len());
    let mut places = BTreeMap::new();
    for job in jobs {
        match places.entry(job.folder.clone()) {
            Entry::Vacant(place) => {
                place.insert(distinct.len());
                distinct.push(job);
            }
            Entry::Occupied(place) => {
                let other = &distinct[*place.get()];
                ensure!(
                    other.config == job.config,
                    "{} and {} would share the run folder {}, and differ; give the tasks other names, or sweep one with \
                     another --out",
                    other.task,
                    job.task,
                    job.folder.display()
                );
            }
        }
    }
    Ok(distinct)
}

impl SweepJob {
    pub(super) fn stage(&self) -> Result<JobStage> {
        let path = self.folder.join(CONFIG);
        if !path.exists() {
            return Ok(JobStage::New);
        }
        let mut saved = Config::read(&path)?;
        // A run goes on with the threads it was begun with.
        saved.threads = self.config.threads;
        ensure!(
            saved == self.config,
            "{} was begun with another config; choose another --name or --out, or remove the folder",
            self.folder.display()
        );
        Ok(if self.folder.join(DONE).exists() { JobStage::Finished } else { JobStage::CutOff })
    }
}
