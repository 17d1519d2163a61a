//! What run is asked for: a new one, or an earlier one that goes on or is scored.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use super::Run;
use crate::runs::folder::RunFolder;
use crate::support::error::Error;
use crate::support::run_names::CONFIG;
use crate::tasks;
use crate::training::config::Config;
use crate::training::layers::Overrides;

/// What is done with a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    #[default]
    Begin,
    /// Goes on from the last checkpoint, to the same bits as if it had never stopped (with as many threads).
    Resume,
    /// Scores the last checkpoint; trains nothing.
    Score,
}

/// A run as a user asks for it.
#[derive(Debug, Clone, Default)]
pub struct Request {
    /// A config file with what differs from the recipe.
    pub config: Option<PathBuf>,
    /// What is given besides the file.
    pub overrides: Overrides,
    /// The run's folder; by default `runs/TASK/RECIPE/seed=N`.
    pub out: Option<PathBuf>,
    pub mode: Mode,
}

/// Where a run goes.
#[derive(Debug)]
pub(super) enum RunPlace {
    /// A folder that is free.
    New(PathBuf),
    Earlier(RunFolder),
}

impl Request {
    /// The config of a new run.
    ///
    /// # Errors
    /// A file that cannot be read, keys or values that no config has.
    pub fn config(&self) -> Result<Config, Error> {
        Ok(Config::load(self.config.as_deref(), &self.overrides)?)
    }

    /// Finds the run's folder and config.
    ///
    /// # Errors
    /// As [`Self::config`], a folder that is not free, no run to resume, or one with another config.
    pub fn open(&self) -> Result<Run, Error> {
        Ok(self.find()?)
    }

    fn find(&self) -> Result<Run> {
        let own = |c: Config| Path::new("runs").join(&c.task.name).join(&c.recipe).join(format!("seed={}", c.seed));
        if self.mode == Mode::Begin {
            let out = self.out.clone().map_or_else(|| self.config().map(own), Ok)?;
            RunFolder::ensure_free(&out)?;
            return Ok(Run { config: self.config()?, place: RunPlace::New(out), mode: self.mode });
        }
        let which = "say which run with --out, or with the options that it was begun with";
        let out = self.out.clone().map_or_else(|| self.config().map(own).context(which), Ok)?;
        let folder = RunFolder::reopen(&out)?;
        let saved = Config::read(&out.join(CONFIG))?;
        if let Some(task) = &self.overrides.task {
            let (asked, name) = (tasks::find(task)?, &saved.task.name);
            ensure!(*name == asked.name, "{} holds a run of task {name}, not of {}", out.display(), asked.name);
        }
        Ok(Run { config: self.resumed(&saved, &out)?, place: RunPlace::Earlier(folder), mode: self.mode })
    }

    /// The config of an earlier run with what may change: where it computes and where its data lie. Anything else that is
    /// given must be as it was.
    fn resumed(&self, saved: &Config, out: &Path) -> Result<Config> {
        let given = &self.overrides;
        let mut config = saved.clone();
        config.device = given.device.clone().unwrap_or(config.device);
        config.threads = given.threads.unwrap_or(config.threads);
        config.data.folder = given.data.clone().unwrap_or(config.data.folder);
        let recipe = given.recipe.clone().unwrap_or(saved.recipe.clone());
        let seed = given.seed.unwrap_or(saved.seed);
        let changes = self.config.is_some() || !given.set.is_empty();
        let task = match &given.task {
            Some(task) if changes || tasks::builtin(task).is_none() => tasks::find(task)?,
            // The name of a built-in task, alone, changes nothing in the task that the run may have begun with.
            _ => saved.task.clone(),
        };
        let asked = if changes {
            let given = Overrides { task: None, recipe: Some(recipe), seed: Some(seed), ..given.clone() };
            Config::load_task(task, self.config.as_deref(), &given)?
        } else {
            // Nor does nothing given change its recipe.
            Config { task, recipe, seed, ..saved.clone() }
        };
        let (begun, asked) = (saved.differences(&asked), asked.differences(saved));
        ensure!(
            begun.is_empty() && asked.is_empty(),
            "{0} was begun with another config ({0}/config.toml: [{1}], asked for: [{2}]); resume it with --out {0} and no \
             option but --device, --threads, --data, or choose another folder",
            out.display(),
            begun.join(", "),
            asked.join(", ")
        );
        Ok(config)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_with_a_changed_task_goes_on_by_the_tasks_name() {
        let request = |set: &[&str]| Request {
            overrides: Overrides {
                task: Some("spring_color".into()),
                set: set.iter().map(ToString::to_string).collect(),
                ..Overrides::default()
            },
            ..Request::default()
        };
        let saved = request(&["task.system.dt=0.2"]).config().unwrap();
        let resumed = |set: &[&str]| request(set).resumed(&saved, Path::new("r"));
        assert_eq!(resumed(&[]).unwrap(), saved);
        assert_eq!(resumed(&["task.system.dt=0.2"]).unwrap(), saved);
        let error = resumed(&["task.system.dt=0.1"]).unwrap_err().to_string();
        assert!(error.contains("begun with another config") && error.contains("dt"), "{error}");
    }
}
