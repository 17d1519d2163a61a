//! Many runs: tasks x seeds, each a process of the training program in a folder of its own.
//!
//! Which folder a run gets is a function of what is asked for alone, and a finished run leaves a marker in it. So the
//! same command may be given again at any time, on one machine or by a scheduler: it goes on where it was cut off.

mod display;
mod processes;

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use crate::training::config::{Config, Overrides};

pub use processes::{Summary, run};

/// File that marks the folder of a run that has finished.
pub const DONE: &str = "DONE";
/// What a run printed, in its folder.
pub const OUTPUT: &str = "output.log";

/// What is to be run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
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

/// One run of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    pub task: String,
    pub seed: u64,
    pub folder: PathBuf,
    /// What the run's config must be.
    config: Config,
    /// Arguments of the training program for a run from the start, without the folder.
    arguments: Vec<OsString>,
}

/// How far a job is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    New,
    CutOff,
    Finished,
}

impl Plan {
    /// The runs, all seeds of a task after each other.
    ///
    /// # Errors
    /// An unknown task, recipe or key, an unsound name, a change of the recipe without a name.
    pub fn jobs(&self) -> Result<Vec<Job>> {
        let changed = !self.set.is_empty() || self.config.is_some();
        ensure!(
            !changed || self.name.is_some(),
            "--set and --config change the recipe: give it a name with --name, for its run folders"
        );
        let variant = match &self.name {
            None => self.recipe.clone(),
            Some(name) => {
                let sound = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
                ensure!(
                    !name.is_empty() && name.chars().all(sound),
                    "--name {name:?}: only letters, digits, '.', '_' and '-' can stand in a folder's name"
                );
                format!("{}-{name}", self.recipe)
            }
        };
        let mut jobs = Vec::new();
        for task in &self.tasks {
            for &seed in &self.seeds {
                let config = Config::load(self.config.as_deref(), &self.overrides(task, seed))?;
                let folder = self.out.join(task).join(&variant).join(format!("seed={seed}"));
                let mut arguments = self.shared_arguments(task);
                arguments.extend(["--seed".into(), seed.to_string().into()]);
                arguments.extend(["--threads".into(), self.threads.to_string().into()]);
                jobs.push(Job { task: task.clone(), seed, folder, config, arguments });
            }
        }
        Ok(jobs)
    }

    /// A shell command for each run, for schedulers: a sweep of that run alone, so that it is skipped, resumed and
    /// marked in the same way. `program` is the sweep program.
    ///
    /// # Errors
    /// A path that cannot be quoted.
    pub fn commands(&self, program: &Path) -> Result<Vec<String>> {
        let mut commands = Vec::new();
        for task in &self.tasks {
            for seed in &self.seeds {
                let mut words = vec![program.as_os_str().to_os_string()];
                words.extend(self.shared_arguments(task));
                words.extend(["--seeds".into(), seed.to_string().into()]);
                words.extend(["--threads-per-run".into(), self.threads.to_string().into()]);
                words.extend(["--out".into(), self.out.as_os_str().to_os_string()]);
                if let Some(name) = &self.name {
                    words.extend(["--name".into(), name.into()]);
                }
                commands.push(shell_line(&words)?);
            }
        }
        Ok(commands)
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
    fn shared_arguments(&self, task: &str) -> Vec<OsString> {
        let mut words: Vec<OsString> = vec!["--task".into(), task.into(), "--recipe".into(), (&self.recipe).into()];
        for (option, path) in [("--config", &self.config), ("--data", &self.data)] {
            if let Some(path) = path {
                words.extend([option.into(), path.into()]);
            }
        }
        for assignment in &self.set {
            words.extend(["--set".into(), assignment.into()]);
        }
        if let Some(device) = &self.device {
            words.extend(["--device".into(), device.into()]);
        }
        words
    }
}

impl Job {
    fn stage(&self) -> Result<Stage> {
        let path = self.folder.join("config.toml");
        if !path.exists() {
            return Ok(Stage::New);
        }
        let mut saved = Config::read(&path)?;
        // A run goes on with the threads it was begun with.
        saved.threads = self.config.threads;
        ensure!(
            saved == self.config,
            "{} was begun with another config; choose another --name or --out, or remove the folder",
            self.folder.display()
        );
        Ok(if self.folder.join(DONE).exists() { Stage::Finished } else { Stage::CutOff })
    }
}

/// Seeds as people write them: `0-9`, `1,4,7-8`.
///
/// # Errors
/// Anything else, or a range that runs backwards.
pub fn parse_seeds(text: &str) -> Result<Vec<u64>> {
    let number = |text: &str| {
        let number = text.trim().parse::<u64>().ok();
        number
            .with_context(|| format!("--seeds: {text:?} is not a number from 0 on; seeds are given as 0-9 or 1,4,7-8"))
    };
    let mut seeds = Vec::new();
    for part in text.split(',') {
        match part.split_once('-') {
            None => seeds.push(number(part)?),
            Some((first, last)) => {
                let (first, last) = (number(first)?, number(last)?);
                ensure!(first <= last, "seeds: {part:?} runs backwards");
                seeds.extend(first..=last);
            }
        }
    }
    Ok(seeds)
}

fn shell_line(words: &[OsString]) -> Result<String> {
    let words: Option<Vec<&str>> = words.iter().map(|word| word.to_str()).collect();
    shlex::try_join(words.context("a path that is not UTF-8 cannot stand in a command line")?).context("command line")
}
