//! results.json: the report's numbers for programs.

use std::collections::BTreeMap;

use serde::Serialize;

use super::groups::RunGroup;
use super::times::TimeToAnswer;
use paig::network::cells::PhysicalParameter;
use paig::network::physics_models::losses::Loss;
use paig::runs::scores::FrameSpread;
use paig::support::statistics::Spread;

/// Version of the file's form; to be raised when a reader of today could misread it. Files of before it have none.
const FORMAT: u32 = 1;

/// The whole file.
#[derive(Debug, Serialize)]
pub(super) struct Results {
    format: u32,
    tasks: Vec<TaskResults>,
    /// Of each finished run, when it had its answer.
    rows: Vec<TimeToAnswer>,
}

/// Runs of one task with one recipe. Spreads are over all finished runs, successes or not.
#[derive(Debug, Serialize)]
struct TaskResults {
    task: String,
    /// With what was changed in it: no two entries of a task have the same.
    recipe: String,
    base_recipe: String,
    /// What was changed in the recipe, as `key=value`.
    overrides: Vec<String>,
    seeds: Vec<u64>,
    /// Data sets that the runs learned from.
    datasets: usize,
    tried: usize,
    finished: usize,
    /// Null for a task without a criterion, or where nothing can be held against it.
    succeeded: Option<usize>,
    parameters: BTreeMap<String, ParameterResults>,
    losses: BTreeMap<Loss, Spread>,
    /// Pixels (angles: radians), velocities per time unit.
    state_errors: BTreeMap<&'static str, Spread>,
    predicted_frames: Vec<FrameSpread>,
    wall_seconds: Option<Spread>,
}

#[derive(Debug, Serialize)]
struct ParameterResults {
    truth: Option<f64>,
    #[serde(flatten)]
    learned: Spread,
}

impl Results {
    pub(super) fn of(groups: &[RunGroup]) -> Self {
        Results {
            format: FORMAT,
            tasks: groups.iter().map(TaskResults::of).collect(),
            rows: groups.iter().flat_map(TimeToAnswer::of).collect(),
        }
    }
}

impl TaskResults {
    fn of(group: &RunGroup) -> Self {
        let parameter = |parameter: &PhysicalParameter| {
            let learned = group.value(parameter)?;
            Some((parameter.name.to_string(), ParameterResults { truth: group.truth(parameter), learned }))
        };
        TaskResults {
            task: group.task.name.clone(),
            recipe: group.label.clone(),
            base_recipe: group.recipe.clone(),
            overrides: group.changes.clone(),
            seeds: group.runs.iter().map(|run| run.config.seed).collect(),
            datasets: group.datasets(),
            tried: group.runs.len(),
            finished: group.finished().count(),
            succeeded: group.succeeded(),
            parameters: group.learned().filter_map(parameter).collect(),
            losses: known(group.losses()),
            state_errors: known(group.states()),
            predicted_frames: group.frames(),
            wall_seconds: group.spread(|summary| Some(summary.wall_seconds)),
        }
    }
}

/// The numbers that there are.
fn known<K: Ord, const N: usize>(numbers: [(K, Option<Spread>); N]) -> BTreeMap<K, Spread> {
    numbers.into_iter().filter_map(|(name, spread)| Some((name, spread?))).collect()
}
