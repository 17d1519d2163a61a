//! How long a run takes to its answer.

use serde::Serialize;

use super::criteria::{self, Status};
use super::groups::RunGroup;
use paig::runs::run::{RunData, StoredRun};
use paig::training::discover;

/// When a finished run had what it was for, in seconds from the start of the training.
#[derive(Debug, Clone, Serialize)]
pub(super) struct TimeToAnswer {
    task: String,
    recipe: String,
    /// Of the generated files.
    data_seed: Option<u64>,
    seed: u64,
    threads: usize,
    succeeded: bool,
    /// The end of `discover`.
    pub seconds_to_objects: Option<f64>,
    /// From then on every learned parameter stays within so much of its truth; none where it does not, or where nothing is
    /// learned.
    pub seconds_to_2_percent: Option<f64>,
    pub seconds_to_half_percent: Option<f64>,
    /// The end of the training.
    pub seconds: f64,
}

impl TimeToAnswer {
    /// Of the finished runs of a group whose course can be read.
    pub(super) fn of(group: &RunGroup) -> Vec<Self> {
        group.finished().filter_map(|(run, _)| Self::of_run(group, run)).collect()
    }

    fn of_run(group: &RunGroup, run: &StoredRun) -> Option<Self> {
        let (summary, course) = (run.summary.as_ref()?, run.course_of_its_weights()?);
        let within = |percent: f64| {
            let reached = group.learned().map(|parameter| {
                let truth = summary.parameters.get(&*parameter.name)?.truth?;
                course.seconds_within(&parameter.name, truth, percent)
            });
            reached.collect::<Option<Vec<f64>>>()?.into_iter().reduce(f64::max)
        };
        Some(TimeToAnswer {
            task: group.task.name.clone(),
            recipe: group.label.clone(),
            data_seed: run.data.as_ref().and_then(RunData::seed),
            seed: run.config.seed,
            threads: summary.threads,
            succeeded: criteria::status(run) == Status::Succeeded,
            seconds_to_objects: summary.phase_seconds.get(discover::NAME).copied(),
            seconds_to_2_percent: within(2.0),
            seconds_to_half_percent: within(0.5),
            seconds: summary.wall_seconds,
        })
    }
}
