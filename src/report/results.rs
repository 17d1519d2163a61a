//! results.json: the report's numbers for programs.

use std::collections::BTreeMap;

use serde::Serialize;

use super::frames::{self, FrameSpread};
use super::groups::Group;
use super::runs::Loss;
use super::states;
use super::statistics::Spread;
use crate::viz::seeds::Outcome;

/// The whole file.
#[derive(Debug, Serialize)]
pub(super) struct Results {
    tasks: Vec<TaskResults>,
}

/// Runs of one task with one recipe. Spreads are over all finished runs, successes or not.
#[derive(Debug, Serialize)]
struct TaskResults {
    task: &'static str,
    /// With what was changed in it: no two entries of a task have the same.
    recipe: String,
    base_recipe: String,
    /// What was changed in the recipe, as `key=value`.
    overrides: Vec<String>,
    seeds: Vec<u64>,
    tried: usize,
    finished: usize,
    succeeded: usize,
    parameters: BTreeMap<&'static str, ParameterResults>,
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

pub(super) fn of(groups: &[Group]) -> Results {
    let tasks = groups.iter().map(|group| {
        let parameter =
            |name| Some((name, ParameterResults { truth: group.truth(name), learned: group.parameter(name)? }));
        TaskResults {
            task: group.task.key,
            recipe: group.label.clone(),
            base_recipe: group.recipe.clone(),
            overrides: group.changes.clone(),
            seeds: group.runs.iter().map(|run| run.config.seed).collect(),
            tried: group.runs.len(),
            finished: group.finished().count(),
            succeeded: group.count(Outcome::Succeeded),
            parameters: group.parameters().into_iter().filter_map(parameter).collect(),
            losses: Loss::ALL.into_iter().filter_map(|loss| Some((loss, group.loss(loss)?))).collect(),
            state_errors: states::ERRORS
                .into_iter()
                .filter_map(|(key, _, error)| Some((key, group.state_error(error)?)))
                .collect(),
            predicted_frames: frames::of(group),
            wall_seconds: group.wall_seconds(),
        }
    });
    Results { tasks: tasks.collect() }
}
