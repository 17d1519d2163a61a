//! Clips that are scored, with what is known of them.

use std::path::Path;

use anyhow::{Result, ensure};
use tch::Device;

use crate::datasets::dataset::Dataset;
use crate::datasets::files::{ClipShape, Split};
use crate::datasets::iterators::Clips;
use crate::datasets::settings::Provenance;
use crate::datasets::states::{SplitStates, States};
use crate::network::System;
use crate::network::physics_models::PhysicsNet;
use crate::runs::checkpoint::DataChecksums;
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
    /// Of the file: of its test clips, or of those that a run learns from.
    checksums: DataChecksums,
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
        let checksums = match split {
            Split::Test => DataChecksums { test: dataset.scored_on(), ..DataChecksums::default() },
            Split::Train | Split::Valid => DataChecksums { clips: dataset.learned_from(), ..DataChecksums::default() },
        };
        let clips = dataset.clips(split, device);
        Ok(ScoredClips { clips, states, truth, made_with, notes, checksums })
    }

    /// Checks that the clips are those that a run was begun with, as far as they are known.
    ///
    /// # Errors
    /// Other clips; a run without checkpoint, or whose last one is damaged.
    pub fn ensure_of_run(&self, run: &Path) -> Result<()> {
        let same = self.checksums.is_as(&DataChecksums::of_run(run)?).into_iter().all(|same| same);
        ensure!(same, "its clips are not those that {} was begun with", run.display());
        Ok(())
    }

    /// Gives the truths of what each object has of its own (`m1`, `m2`, ..) the numbers that the model has given the objects:
    /// where the equation does not tell these apart, an encoder numbers them as it likes, and the true states alone say how.
    /// Without states such truths are not known. `order`: the model's object for each true one.
    pub fn number_objects_as(&mut self, model: &PhysicsNet, order: Option<&[usize]>) {
        let System { cell, objects, .. } = &model.system;
        if self.truth.is_empty() || *objects == 1 || cell.of_each().is_empty() || model.tells_objects_apart() {
            return;
        }
        let place = |name: &str| cell.parameters.iter().position(|parameter| parameter.name == name);
        let numbered = |truth: &TrueParameter| {
            let place = place(&truth.name)?;
            let Some(first) = cell.of_each().iter().find(|first| (**first..**first + objects).contains(&place)) else {
                return Some(truth.clone());
            };
            let object = *order?.get(place - first)?;
            Some(TrueParameter { name: cell.parameters[first + object].name.to_string(), ..truth.clone() })
        };
        self.truth = self.truth.iter().filter_map(numbered).collect();
        self.notes.extend(match order {
            None => Some(
                "without true states nobody knows which object is which: their own parameters have no truths".into(),
            ),
            Some(order) => (!order.is_sorted()).then(|| {
                let numbers: Vec<_> = order.iter().map(|object| (object + 1).to_string()).collect();
                let (count, numbers) = (order.len(), numbers.join(", "));
                format!("the objects 1 to {count} of the clips are the model's {numbers}, and so are their parameters")
            }),
        });
    }

    /// The true value of a parameter, if it is known.
    pub fn truth_of(&self, name: &str) -> Option<f64> {
        self.truth.iter().find(|truth| truth.name == name).map(|truth| truth.value)
    }
}

/// The true parameters of a dataset file: what was written beside it; else the task's, if it is one of the task's own
/// files (the authors' have the same names).
fn truth(path: &Path, task: &Task, states: Option<&States>) -> Vec<TrueParameter> {
    if let Some(Provenance::Settings(settings)) = states.map(|states| &states.settings)
        && settings.task != task.name
    {
        // Of another task's file the same symbol may be another quantity: it counts where the motion is the task's own, and the
        // clips follow the equation that they were made for.
        let follow = states.and_then(|states| states.truth.as_ref()).is_none_or(|values| !values.is_empty());
        let known = |parameter: &TrueParameter| {
            let value = settings.scene.truth(&task.system.cell, &parameter.name)?;
            Some(TrueParameter { value, ..parameter.clone() })
        };
        return if follow { task.truth.iter().filter_map(known).collect() } else { Vec::new() };
    }
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

#[cfg(test)]
mod tests {
    use ndarray::Array5;

    use super::*;
    use crate::network::physics_models::ModelOptions;

    /// Three bodies of unequal mass that the model has numbered otherwise.
    #[test]
    fn truths_of_each_object_go_by_the_models_numbers() {
        let task = Task::from_toml(include_str!("../../configs/gallery/gravity_masses.toml")).unwrap();
        let model = PhysicsNet::new(&task.system, &ModelOptions::original(), Device::Cpu, 1).unwrap();
        let numbered = |order: Option<&[usize]>| {
            let clips = Clips::new(&Array5::zeros([1, 12, 36, 36, 3]), None, Device::Cpu);
            let (truth, notes) = (task.truth.clone(), Vec::new());
            let checksums = DataChecksums::default();
            let mut scored = ScoredClips { clips, states: None, truth, made_with: None, notes, checksums };
            scored.number_objects_as(&model, order);
            (["m1", "m2", "m3"].map(|name| scored.truth_of(name)), scored.notes)
        };
        assert_eq!(numbered(Some(&[0, 1, 2])), ([60.0, 30.0, 90.0].map(Some), vec![]));
        // The first of the clips, of mass 60, is the model's third.
        let (truths, notes) = numbered(Some(&[2, 0, 1]));
        assert_eq!(truths, [30.0, 90.0, 60.0].map(Some));
        assert!(notes[0].contains("the model's 3, 1, 2"), "{notes:?}");
        let (truths, notes) = numbered(None);
        assert_eq!((truths, notes.len()), ([None; 3], 1));
    }
}
