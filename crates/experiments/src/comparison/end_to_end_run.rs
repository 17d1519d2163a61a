//! The training of an end-to-end baseline from its files.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use paig::Error;
use paig::datasets::dataset::Dataset;
use paig::datasets::files::{ClipShape, Split};
use paig::datasets::iterators::Clips;
use paig::datasets::states::States;
use paig::network::cells::Coordinates;
use paig::runs::metrics::Record;
use paig::tasks::{self, Task};
use paig::training::base::TrainingOutcome;
use tch::{Device, Tensor};

use crate::baselines::end_to_end::config::EndToEndConfig;
use crate::baselines::end_to_end::training::{self, EndToEndData};
use crate::control::reward::{GoalPath, Reward};
use crate::control::state::ControlState;

/// A training that has its data.
#[derive(Debug)]
pub struct EndToEndRun {
    config: EndToEndConfig,
    task: Task,
    train: Clips,
    valid: Clips,
    test: Clips,
    /// What each training frame is worth, `[clips, time]`, where the model learns rewards.
    rewards: Option<Tensor>,
    checksums: String,
}

impl EndToEndRun {
    /// Reads the data.
    ///
    /// # Errors
    /// A config or data that do not fit the task, that are missing, or that show nothing that moves.
    pub fn prepare(config: &EndToEndConfig, device: Device) -> Result<Self, Error> {
        Ok(Self::prepared(config, device)?)
    }

    fn prepared(config: &EndToEndConfig, device: Device) -> Result<Self> {
        config.check()?;
        let task = tasks::find(&config.task)?;
        let train_file = config.data.join(&task.train_file);
        let learned = Dataset::open(&train_file, &ClipShape::training(&task))?;
        learned.check_motion(&train_file)?;
        let scored = Dataset::open(&config.data.join(&task.test_file), &ClipShape::test(&task))?;
        let [train, valid] = [Split::Train, Split::Valid].map(|split| learned.clips(split, device));
        let test = scored.clips(Split::Test, device);
        let rewards = config.model.learns_rewards().then(|| rewards(&task, &train_file, &learned)).transpose()?;
        let checksums = learned.learned_from();
        Ok(EndToEndRun { config: config.clone(), task, train, valid, test, rewards, checksums })
    }

    /// Trains, and scores on the test clips; `observe` sees each validation.
    ///
    /// # Errors
    /// As for [`training::train`].
    pub fn train(
        &self,
        folder: &Path,
        stop: &dyn Fn() -> bool,
        observe: &mut dyn FnMut(&Record),
    ) -> Result<TrainingOutcome, Error> {
        let EndToEndRun { config, task, train, valid, test, rewards, checksums } = self;
        let data = EndToEndData { train, rewards: rewards.as_ref(), valid, test, checksums };
        Ok(training::train(config, &task.system, data, folder, stop, observe)?)
    }
}

/// Whether a task's frames show a driven pendulum.
pub fn has_worths(task: &Task) -> bool {
    let cell = &task.system.cell;
    cell.can_be_driven() && cell.coordinates == Coordinates::Angle && task.system.objects == 1
}

/// What the frames of the training clips are worth where upright is the goal, `[clips, time]`: what an environment tells
/// who acts in it.
fn rewards(task: &Task, file: &Path, dataset: &Dataset) -> Result<Tensor> {
    ensure!(has_worths(task), "this model learns what frames of a pendulum are worth; task {} has none", task.name);
    let states = States::read(file, dataset)?.with_context(|| {
        let beside = States::path_beside(file);
        format!("{} is missing: the model is told what each frame is worth, by the true angle", beside.display())
    })?;
    let upright = Reward::Goal(GoalPath::angle(0.0));
    let worth = |angle: &f32| {
        let state = ControlState::turning(f64::from(*angle), 0.0);
        upright.of(0, &state, 0.0, &state) as f32
    };
    let positions = &states.train.positions;
    let worths: Vec<f32> = positions.iter().map(worth).collect();
    Ok(Tensor::from_slice(&worths).reshape([positions.dim().0 as i64, positions.dim().1 as i64]))
}
