//! Whether a finished run is a success, and whether it reaches what the paper reports.

use serde::Serialize;

use super::protocol::protocol;
use paig::network::physics_models::losses::Loss;
use paig::runs::run::StoredRun;
use paig::runs::summary::Summary;
use paig::tasks::published::published;
use paig::tasks::{Success, Task};

/// What became of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Status {
    /// Finished, and within the task's criterion.
    Succeeded,
    /// Finished, but not within it.
    Missed,
    /// Finished, of a task without a criterion, or of which nothing can be held against it.
    Unjudged,
    Unfinished,
}

pub(super) fn status(run: &StoredRun) -> Status {
    let Some(summary) = &run.summary else { return Status::Unfinished };
    match criterion(&run.config.task).and_then(|limits| keeps(limits, run, summary)) {
        Some(true) => Status::Succeeded,
        Some(false) => Status::Missed,
        None => Status::Unjudged,
    }
}

/// The criterion of a task, if it has one.
pub(super) fn criterion(task: &Task) -> Option<&Success> {
    (!task.success.is_empty()).then_some(&task.success)
}

/// Whether a finished run keeps all limits; none if no limit is for it. A parameter whose truth is not known and what no frame
/// shows (L_extrap, where the test clips end before) are not judged; one that lacks another number does not keep its limit.
fn keeps(limits: &Success, run: &StoredRun, summary: &Summary) -> Option<bool> {
    let learned = run.config.task.system.cell.parameters.iter().filter(|parameter| run.config.learns(parameter));
    let errors = learned.filter_map(|parameter| {
        let limit = *limits.parameters.get(&*parameter.name)?;
        let Some(learned) = summary.parameters.get(&*parameter.name) else { return Some(false) };
        learned.error_percent().map(|error| error.abs() <= limit)
    });
    let losses = &summary.test.scores.losses;
    let losses = limits.losses.iter().filter_map(|(loss, limit)| {
        let clips_end_before = *loss == Loss::Extrap && losses.extrap_loss.is_none();
        (!clips_end_before).then(|| losses.of(*loss).is_some_and(|value| value <= *limit))
    });
    errors.chain(losses).reduce(|all, kept| all && kept)
}

/// Whether a reconstruction with this L_rec shows the objects; none where no yardstick says so.
pub(super) fn objects_found(task: &Task, recons_loss: f64) -> Option<bool> {
    Some(recons_loss < *protocol().yardstick(&task.name)?.get(&Loss::Recons)?)
}

/// Whether a finished run does not show its objects any more; one without L_rec does not.
pub(super) fn lost_objects(task: &Task, summary: &Summary) -> bool {
    objects_found(task, summary.test.scores.losses.of(Loss::Recons).unwrap_or(f64::NAN)) == Some(false)
}

/// Whether a run finished within the yardsticks, and no parameter further from its truth than the paper's. Not where one of these
/// is not known.
pub(super) fn reaches_paper(run: &StoredRun) -> bool {
    let task = &run.config.task;
    let error = |name: &str| Some((name.into(), published().parameter(&task.name, name)?.error_percent().abs()));
    let parameters = task.system.cell.parameters.iter().filter_map(|parameter| error(&parameter.name)).collect();
    let losses = protocol().yardstick(&task.name).cloned().unwrap_or_default();
    let limits = Success { parameters, losses, note: None };
    run.summary.as_ref().is_some_and(|summary| {
        let learned = task.system.cell.parameters.iter().filter(|parameter| run.config.learns(parameter));
        let mut limited = learned.filter(|parameter| limits.parameters.contains_key(&*parameter.name));
        let all_known = limited.all(|parameter| summary.error_percent(&parameter.name).is_some())
            && limits.losses.keys().all(|loss| summary.test.scores.losses.of(*loss).is_some());
        all_known && keeps(&limits, run, summary) == Some(true)
    })
}
