//! Clips that are scored, with what is known of them.

use std::path::Path;

use anyhow::Result;
use tch::Device;

use crate::datasets::dataset::Dataset;
use crate::datasets::files::{ClipShape, Split};
use crate::datasets::iterators::Clips;
use crate::datasets::states::{SplitStates, States};
use crate::tasks::{Task, TrueParameter};

/// The clips of one split.
#[derive(Debug)]
pub struct ScoredClips {
    pub clips: Clips,
    /// The true states. None where none lie beside the file.
    pub states: Option<SplitStates>,
    /// What a model of the task should learn from such clips, as far as it is known.
    pub truth: Vec<TrueParameter>,
    /// How the clips were made, in a line.
    pub made_with: Option<String>,
    /// What a reader of the scores should know of the file.
    pub notes: Vec<String>,
}

impl ScoredClips {
    /// Reads one split of a dataset file, with clips as long as in its task's training or test file, and the true states
    /// that lie beside it.
    ///
    /// # Errors
    /// As for [`Dataset::open`] and [`States::read`].
    pub fn read(path: &Path, task: &Task, split: Split, device: Device) -> Result<Self> {
        let dataset = Dataset::open(path, &ClipShape::of_either(task, split))?;
        let states = States::read(path, &dataset)?;
        let truth = truth(path, task, states.as_ref());
        let mut notes = Vec::new();
        if truth.len() < task.truth.len() {
            notes.push(format!("{}: its true parameters are not known, or not those of the model", path.display()));
        }
        if let Some(other) = states.as_ref().and_then(|states| states.settings.task()).filter(|it| *it != task.name) {
            notes.push(format!("{} was made for task {other}, not for {}", path.display(), task.name));
        }
        if let Some(Err(error)) = states.as_ref().map(|states| states.settings.check(&task.system)) {
            notes.push(format!("{} does not fit the task: {error}", path.display()));
        }
        let made_with = states.as_ref().map(|states| states.settings.text());
        let states = states.map(|states| states.split(split).clone());
        let clips = dataset.clips(split, device);
        Ok(ScoredClips { clips, states, truth, made_with, notes })
    }

    /// The true value of a parameter, if it is known.
    pub fn truth_of(&self, name: &str) -> Option<f64> {
        self.truth.iter().find(|truth| truth.name == name).map(|truth| truth.value)
    }
}

/// The true parameters of a dataset file: what was written beside it; else the task's, if it is one of the task's own
/// files (the authors' have the same names).
fn truth(path: &Path, task: &Task, states: Option<&States>) -> Vec<TrueParameter> {
    let own = [&task.train_file, &task.test_file].iter().any(|file| path.ends_with(file));
    match states.and_then(|states| states.truth.as_ref()) {
        // Of another equation's file the numbers are not this one's.
        Some(values) if values.len() != task.truth.len() => Vec::new(),
        Some(values) => {
            let known = task.truth.iter().zip(values);
            known.map(|(parameter, &value)| TrueParameter { value, ..parameter.clone() }).collect()
        }
        None if own => task.truth.clone(),
        None => Vec::new(),
    }
}
