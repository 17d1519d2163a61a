//! Which trainings there are, where they lie, and in which order they are made.
//!
//! First the objects of a task and a seed are found, once; then each model begins with them. Learning rates are searched
//! before.

use std::path::PathBuf;

use anyhow::{Context, Result};

use super::end_to_end::config::EndToEndConfig;
use super::list::{BaselineEntry, Comparison, DatasetClips, OBJECTS};
use crate::sweep::{SweepJob, SweepPlan};
use paig::datasets::settings::Counts;
use paig::generators::DatasetJob;
use paig::generators::source_images::SourceImages;
use paig::generators::variant::Variant;
use paig::support::toml_values::quoted;
use paig::tasks;
use paig_kernels::Kernels;

/// What such a run changes in the recipe: it ends with its first phase.
const ONLY_OBJECTS: [&str; 3] = ["identify.max_iterations=0", "identify.recentre=false", "join.max_steps=0"];
/// Seed of the datasets, as `generate` has it.
const DATA_SEED: u64 = 0;

/// Where everything lies.
#[derive(Debug, Clone)]
pub struct BaselineFolders {
    pub data: PathBuf,
    pub runs: PathBuf,
    /// Threads of each run.
    pub threads: usize,
    /// `cpu`, `cuda` or `cuda:n`.
    pub device: String,
}

/// One training of a model: on which task, from how many clips, with which seed and rate.
#[derive(Debug, Clone)]
pub struct Training<'a> {
    pub entry: &'a BaselineEntry,
    pub task: String,
    /// Training clips.
    pub clips: usize,
    pub seed: u64,
    /// Other than the recipe's, or the end-to-end baseline's.
    pub rate: Option<f64>,
    /// One of the search, and not of the comparison.
    pub searched: bool,
}

impl BaselineFolders {
    /// The datasets of so many training clips.
    fn data_of(&self, clips: usize) -> PathBuf {
        self.data.join(format!("clips={clips}"))
    }

    fn runs_of(&self, clips: usize) -> PathBuf {
        self.runs.join(format!("clips={clips}"))
    }

    /// How the dataset of a task is made.
    ///
    /// # Errors
    /// A task without a scene.
    pub fn dataset(&self, task: &str, counts: DatasetClips, clips: usize) -> Result<DatasetJob> {
        let variant = Variant::new(&tasks::find(task)?, DATA_SEED)?;
        let images = SourceImages::of(&variant)?;
        let counts = Counts { train: clips, valid: counts.valid, test: counts.test };
        Ok(DatasetJob { images, variant, counts, folder: self.data_of(clips), force: false })
    }

    fn sweep(&self, recipe: &str, name: &str, task: &str, clips: usize, seed: u64, set: Vec<String>) -> SweepPlan {
        SweepPlan {
            tasks: vec![task.into()],
            seeds: vec![seed],
            recipe: recipe.into(),
            name: Some(name.into()),
            config: None,
            set,
            data: Some(self.data_of(clips)),
            device: Some(self.device.clone()),
            threads: self.threads,
            out: self.runs_of(clips),
        }
    }

    /// The run that finds the objects with which a training begins; none for a model that needs none.
    ///
    /// # Errors
    /// An unknown task or recipe.
    pub fn objects(&self, list: &Comparison, training: &Training) -> Result<Option<SweepJob>> {
        if training.entry.own_objects || training.entry.whole.is_some() {
            return Ok(None);
        }
        let set = ONLY_OBJECTS.map(String::from).into();
        let plan = self.sweep(&list.recipe, OBJECTS, &training.task, training.clips, training.seed, set);
        Ok(plan.jobs()?.pop())
    }

    /// The run of a model that is no whole other one.
    ///
    /// # Errors
    /// An unknown task, recipe or key.
    pub fn job(&self, list: &Comparison, training: &Training) -> Result<SweepJob> {
        let Training { entry, task, clips, seed, rate, .. } = training;
        let mut set = entry.set.clone();
        if let Some(objects) = self.objects(list, training)? {
            set.push(format!("discover.from={}", quoted(&objects.folder.display().to_string())));
        }
        if let (Some(key), Some(rate)) = (&entry.rate, rate) {
            set.push(format!("{key}={rate:e}"));
        }
        let plan = self.sweep(&list.recipe, &training.folder_name(), task, *clips, *seed, set);
        plan.jobs()?.pop().context("a plan of one run has one")
    }

    /// What an end-to-end baseline is trained by.
    ///
    /// # Errors
    /// A model that is none.
    pub fn whole(&self, list: &Comparison, training: &Training) -> Result<EndToEndConfig> {
        let Training { entry, task, clips, seed, rate, searched } = training;
        let rate = rate.or(entry.learning_rate);
        Ok(EndToEndConfig {
            model: entry.whole.with_context(|| format!("model {} is no end-to-end baseline", entry.name))?,
            task: task.clone(),
            data: self.data_of(*clips),
            seed: *seed,
            learning_rate: rate.with_context(|| format!("model {}: no learning rate was found", entry.name))?,
            batch: list.whole.batch,
            steps: if *searched { list.search.whole_steps } else { list.steps(entry, task) },
            checkpoint_every: list.whole.checkpoint_every,
            kernels: Kernels::Own,
        })
    }

    /// Where a training's run lies.
    ///
    /// # Errors
    /// As for [`Self::job`].
    pub fn folder(&self, list: &Comparison, training: &Training) -> Result<PathBuf> {
        if training.entry.whole.is_none() {
            return Ok(self.job(list, training)?.folder);
        }
        let of_task = self.runs_of(training.clips).join(&training.task).join(training.folder_name());
        Ok(of_task.join(format!("seed={}", training.seed)))
    }
}

impl Training<'_> {
    fn folder_name(&self) -> String {
        let BaselineEntry { name, .. } = self.entry;
        match self.rate {
            Some(rate) => format!("{name}-rate-{rate:e}"),
            None => name.clone(),
        }
    }
}

/// The trainings of the search, for each model with a rate to search.
pub fn search<'a>(list: &'a Comparison, models: &[&'a BaselineEntry], clips: usize) -> Vec<Training<'a>> {
    let searched = models.iter().filter(|entry| entry.rate.is_some());
    let of_model = |entry: &&'a BaselineEntry| {
        let entry = *entry;
        list.rates(entry).iter().map(move |rate| Training {
            entry,
            task: list.search.task.clone(),
            clips,
            seed: list.search.seed,
            rate: Some(*rate),
            searched: true,
        })
    };
    searched.flat_map(of_model).collect()
}
