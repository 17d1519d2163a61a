//! What became of the runs of the suite.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};

use super::list::{DataSeed, SuiteScene};
use paig::datasets::settings::NoiseFloor;
use paig::datasets::states::States;
use paig::runs::run::StoredRun;
use paig::runs::summary::LearnedParameter;

/// A limit of a loss where noise sets a floor: the plain task's, and this many floors. What noise leaves of a picture is
/// learned in part, and the floor is itself measured on few frames.
const FLOORS: f64 = 1.1;

/// One run.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct SceneOutcome {
    pub scene: String,
    /// The plain task.
    pub task: String,
    pub data_seed: DataSeed,
    pub seed: u64,
    /// One that has not has no results: whatever it was stopped by, it did not succeed. Earlier files hold finished runs only.
    #[serde(default = "finished_before")]
    pub finished: bool,
    /// Within the plain task's limits, those of losses in proportion to the objects and raised by the floor.
    pub succeeded: bool,
    /// What of it was beyond its limit, or why there are no results.
    pub missed: Vec<String>,
    /// The run's own verdict.
    pub found: bool,
    /// The checks that failed.
    pub failed_checks: Vec<String>,
    pub parameters: BTreeMap<String, LearnedParameter>,
    pub recons_loss: Option<f64>,
    pub pred_loss: Option<f64>,
    pub extrap_loss: Option<f64>,
    /// What noise alone leaves of the losses; none without noise.
    pub noise_floor: Option<NoiseFloor>,
    pub seconds: Option<f64>,
}

fn finished_before() -> bool {
    true
}

impl SceneOutcome {
    /// Of a run that was begun and has no results, and why.
    fn without_results(scene: &SuiteScene, data_seed: DataSeed, seed: u64, why: &str) -> Self {
        SceneOutcome {
            scene: scene.name.clone(),
            task: scene.plain.name.clone(),
            data_seed,
            seed,
            finished: false,
            succeeded: false,
            missed: vec![why.into()],
            found: false,
            failed_checks: Vec::new(),
            parameters: BTreeMap::new(),
            recons_loss: None,
            pred_loss: None,
            extrap_loss: None,
            noise_floor: None,
            seconds: None,
        }
    }
}

/// What became of a run of a scene that was begun with this seed.
///
/// # Errors
/// Damaged settings beside the test file.
pub fn outcome(scene: &SuiteScene, data_seed: DataSeed, seed: u64, run: &Result<StoredRun>) -> Result<SceneOutcome> {
    let Ok(run) = run else { return Ok(SceneOutcome::without_results(scene, data_seed, seed, "unreadable")) };
    let Some(summary) = &run.summary else {
        return Ok(SceneOutcome::without_results(scene, data_seed, seed, "not finished"));
    };
    let noise_floor = noise_floor(run)?;
    let losses = &summary.test.scores.losses;
    let limits = &scene.plain.success;
    let mut missed = Vec::new();
    for (name, limit) in &limits.parameters {
        let learned = summary.parameters.contains_key(name);
        if learned && summary.error_percent(name).is_none_or(|error| error.abs() > *limit) {
            missed.push(name.clone());
        }
    }
    // A loss sums over the frame, so it grows with the objects in it.
    let crowd = scene.task.system.objects as f64 / scene.plain.system.objects as f64;
    for (loss, limit) in &limits.losses {
        let floor = noise_floor.map_or(0.0, |floor| floor.of(*loss));
        if losses.of(*loss).is_none_or(|value| value > crowd * limit + FLOORS * floor) {
            missed.push(loss.symbol().into());
        }
    }
    let verdict = summary.verdict.as_ref();
    Ok(SceneOutcome {
        scene: scene.name.clone(),
        task: scene.plain.name.clone(),
        data_seed,
        seed,
        finished: true,
        succeeded: missed.is_empty(),
        missed,
        found: verdict.is_some_and(|verdict| verdict.found),
        failed_checks: verdict.map_or_else(Vec::new, |it| it.failed().map(|check| check.name.clone()).collect()),
        parameters: summary.parameters.clone(),
        recons_loss: Some(losses.recons_loss),
        pred_loss: Some(losses.pred_loss),
        extrap_loss: losses.extrap_loss,
        noise_floor,
        seconds: Some(summary.wall_seconds),
    })
}

/// The floor that was measured when the run's test file was made.
fn noise_floor(run: &StoredRun) -> Result<Option<NoiseFloor>> {
    let file = Path::new(&run.config.data_folder().unwrap_or_default()).join(&run.config.task.test_file);
    let settings = States::settings_beside(&file)?.with_context(|| {
        format!("{} has lost its dataset {}, which says what noise leaves", run.folder.display(), file.display())
    })?;
    Ok(settings.noise_floor())
}
