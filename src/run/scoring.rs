//! A trained model on the test clips, and the run's summary.

use std::collections::BTreeMap;

use anyhow::Result;
use tch::Device;

use super::Program;
use crate::datasets::files::Split;
use crate::evaluation::{self, ScoredClips};
use crate::network::physics_models::PhysicsNet;
use crate::runs::checkpoint::RunState;
use crate::runs::scores::Scores;
use crate::runs::summary::{self, Hardware, LearnedParameter, Summary, TestScores};
use crate::runs::verdict::Verdict;
use crate::support::device::{self, LIBTORCH_VERSION};
use crate::training::config::Config;

/// Test clips and what a model scores on them.
#[derive(Debug)]
pub struct TestResults {
    pub clips: ScoredClips,
    pub scores: Scores,
}

/// Reads the test clips of a run.
pub(super) fn read_test(config: &Config, device: Device) -> Result<ScoredClips> {
    ScoredClips::read(&config.data.test_path(), &config.task, Split::Test, device)
}

/// Scores a model on test clips, whose objects are numbered as the model numbers them.
pub(super) fn scored(model: &PhysicsNet, mut clips: ScoredClips) -> Result<TestResults> {
    let scores = evaluation::evaluate(model, &clips)?;
    clips.number_objects_as(model, scores.states.as_ref().map(|states| &states.objects[..]));
    Ok(TestResults { clips, scores })
}

/// The summary of a finished run; `clips_learned`: training and validation clips.
#[expect(clippy::too_many_arguments, reason = "each is one source of the summary")]
pub(super) fn summarize(
    config: &Config,
    model: &PhysicsNet,
    clips_learned: [usize; 2],
    results: &TestResults,
    verdict: Verdict,
    state: &RunState,
    threads: usize,
    program: Program,
) -> Result<Summary> {
    let TestResults { clips, scores } = results;
    let parameters = model.parameter_values().into_iter();
    Ok(Summary {
        format: summary::FORMAT,
        task: config.task.name.clone(),
        recipe: config.recipe.clone(),
        seed: config.seed,
        parameters: parameters
            .map(|(name, learned)| (name.to_string(), LearnedParameter { learned, truth: clips.truth_of(name) }))
            .collect(),
        test: TestScores { scores: scores.clone(), made_with: clips.made_with.clone() },
        verdict: Some(verdict),
        training_clips: Some(clips_learned[0]),
        validation_clips: Some(clips_learned[1]),
        overrides: config.differences_from_recipe()?,
        steps: state.steps,
        wall_seconds: state.seconds,
        phase_seconds: state.phase_seconds.iter().cloned().collect(),
        device: config.device.clone(),
        threads,
        hardware: Some(Hardware { processor: device::processor(), cores: device::cores() }),
        versions: versions(state, program),
    })
}

/// The program that trained the run, and the one that scored it where that was another build.
fn versions(state: &RunState, program: Program) -> BTreeMap<String, String> {
    let Program { version, commit } = program;
    let trained = if state.commits.is_empty() { "unknown".to_string() } else { state.commits.join(", then ") };
    let scored =
        (state.commits.last().map(String::as_str) != Some(commit)).then(|| ("scored by".to_string(), commit.into()));
    let versions = [
        ("paig".to_string(), version.to_string()),
        ("libtorch".to_string(), LIBTORCH_VERSION.into()),
        ("commit".to_string(), trained),
    ];
    versions.into_iter().chain(scored).collect()
}
