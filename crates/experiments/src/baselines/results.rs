//! What became of the trainings: the rows of results.json, and the search of learning rates.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use tch::Device;

use super::end_to_end::scores::EndToEndScores;
use super::list::{BaselineEntry, Comparison, RateSearch};
use super::plan::{self, BaselineFolders, Training};
use crate::sweep;
use paig::network::dynamics::DynamicsKind;
use paig::network::physics_models::{PhysicsNet, VariableGroup};
use paig::runs::course::Course;
use paig::runs::metrics::RecordKind;
use paig::runs::run::StoredRun;
use paig::runs::scores::{PredictedFrame, Scores};
use paig::runs::summary::LearnedParameter;
use paig::support::run_names::CONFIG;
use paig::training::config::Config;

/// The report's files that hold them: the rows, the search, and the frames of each model that the gallery shows.
pub(super) const RESULTS: &str = "results.json";
pub(super) const SEARCH: &str = "search.json";
pub(super) const FRAMES: &str = "frames";

/// A finished training of the comparison.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BaselineRow {
    pub task: String,
    pub model: String,
    pub seed: u64,
    /// All of the model's weights, and those that carry it from frame to frame: dynamics, or velocity estimator and
    /// physics; none of an end-to-end baseline.
    pub weights: usize,
    pub dynamics_weights: Option<usize>,
    /// None of a model that does not reconstruct.
    pub recons_loss: Option<f64>,
    pub pred_loss: f64,
    pub extrap_loss: Option<f64>,
    /// Of each predicted frame, the first one right after the input.
    pub ssim: Vec<f64>,
    pub squared_error: Vec<f64>,
    /// Clips that it was trained on, and tested on.
    pub training_clips: usize,
    pub test_clips: usize,
    pub steps: u64,
    pub seconds: f64,
    /// That the search chose; none where nothing was searched.
    pub searched_rate: Option<f64>,
    pub parameters: BTreeMap<String, LearnedParameter>,
    /// Steps and values of what changed in the training, some 60 at most: each physical parameter by its name; of a black box
    /// L_pred of the validations, of an end-to-end baseline their error, as `pred_loss`.
    pub courses: BTreeMap<String, Vec<(f64, f64)>>,
    /// Where its predicted frames are.
    #[serde(skip)]
    pub frames: Option<PredictedFrames>,
}

/// The course of a black box's or an end-to-end baseline's error.
pub(super) const VALIDATION_ERROR: &str = "pred_loss";
/// Points of a course that are kept, at most.
const POINTS: usize = 60;

/// Where the predicted frames of a training are.
#[derive(Debug, Clone, PartialEq)]
pub enum PredictedFrames {
    /// In the folder of its run.
    Run(PathBuf),
    /// In the folder of a report: those that its gallery shows.
    Report(PathBuf),
}

impl BaselineRow {
    /// Of a training; none if it has not finished.
    ///
    /// # Errors
    /// A damaged run folder.
    pub fn read(places: &BaselineFolders, list: &Comparison, training: &Training) -> Result<Option<BaselineRow>> {
        let folder = places.folder(list, training)?;
        let row = if training.entry.whole.is_some() { of_whole(training, &folder) } else { of_run(training, &folder) };
        row.with_context(|| format!("run {}", folder.display()))
    }

    /// Whether it is of this training, at the same rate, and of an end-to-end baseline of as many steps.
    pub fn is_of(&self, list: &Comparison, training: &Training) -> bool {
        let Training { entry, task, clips, seed, rate, .. } = training;
        let what = (&self.model, &self.task, self.training_clips, self.seed, self.searched_rate);
        let as_long = entry.whole.is_none() || self.steps == list.steps(entry, task);
        as_long && what == (&entry.name, task, *clips, *seed, *rate)
    }

    /// The scores of its frames, for figures.
    pub fn frame_scores(&self, input: usize, pred: usize) -> Vec<PredictedFrame> {
        let scores = self.ssim.iter().zip(&self.squared_error).enumerate();
        scores
            .map(|(place, (&ssim, &squared_error))| PredictedFrame {
                frame: input + place,
                extrapolated: place >= pred,
                squared_error,
                ssim,
            })
            .collect()
    }

    /// The first predicted frame, counted from the clip's first, whose similarity is below a limit.
    pub fn falls_below(&self, limit: f64, input: usize) -> Option<usize> {
        self.ssim.iter().position(|ssim| *ssim < limit).map(|place| input + place)
    }
}

fn row(training: &Training, folder: &Path, weights: usize, scores: &Scores) -> BaselineRow {
    let of_frames = |score: fn(&PredictedFrame) -> f64| scores.predicted_frames.iter().map(score).collect();
    BaselineRow {
        task: training.task.clone(),
        model: training.entry.name.clone(),
        seed: training.seed,
        weights,
        dynamics_weights: None,
        recons_loss: Some(scores.losses.recons_loss).filter(|loss| !loss.is_nan()),
        pred_loss: scores.losses.pred_loss,
        extrap_loss: scores.losses.extrap_loss,
        ssim: of_frames(|frame| frame.ssim),
        squared_error: of_frames(|frame| frame.squared_error),
        training_clips: training.clips,
        test_clips: scores.clips,
        steps: 0,
        seconds: 0.0,
        searched_rate: training.rate,
        parameters: BTreeMap::new(),
        courses: BTreeMap::new(),
        frames: Some(PredictedFrames::Run(folder.into())),
    }
}

/// Some of a course's points, the first and the last among them.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let (last, kept) = (points.len().saturating_sub(1), points.len().min(POINTS));
    (0..kept).map(|place| points[place * last / (kept - 1).max(1)]).collect()
}

fn of_run(training: &Training, folder: &Path) -> Result<Option<BaselineRow>> {
    // What was stopped while its data were read has printed something, and no more.
    if !folder.join(CONFIG).exists() {
        return Ok(None);
    }
    let Some(summary) = StoredRun::read(folder)?.summary else { return Ok(None) };
    let config = Config::read(&folder.join(CONFIG))?;
    let model = PhysicsNet::new(&config.task.system, &config.model, Device::Cpu, config.seed)?;
    let count = |counts: &dyn Fn(VariableGroup) -> bool| -> usize {
        let variables = model.named_variables().into_iter().filter(|(name, _)| counts(model.group(name)));
        variables.map(|(_, variable)| variable.numel()).sum()
    };
    let course = Course::read(folder)?;
    let mut courses: BTreeMap<String, Vec<(f64, f64)>> =
        summary.parameters.keys().map(|name| (name.clone(), thinned(&course.points(None, name)))).collect();
    if config.model.dynamics != DynamicsKind::Physics {
        let errors = course.points(Some(RecordKind::Valid), VALIDATION_ERROR);
        courses.insert(VALIDATION_ERROR.into(), thinned(&errors));
    }
    let carries = |group| !matches!(group, VariableGroup::Encoder | VariableGroup::Decoder);
    Ok(Some(BaselineRow {
        dynamics_weights: Some(count(&carries)),
        steps: summary.steps,
        seconds: summary.wall_seconds,
        parameters: summary.parameters.clone(),
        courses,
        ..row(training, folder, count(&|_| true), &summary.test.scores)
    }))
}

fn of_whole(training: &Training, folder: &Path) -> Result<Option<BaselineRow>> {
    let Some(whole) = EndToEndScores::read(folder)? else { return Ok(None) };
    let errors = Course::read(folder)?.points(Some(RecordKind::Valid), VALIDATION_ERROR);
    Ok(Some(BaselineRow {
        steps: whole.config.steps,
        seconds: whole.seconds,
        courses: [(VALIDATION_ERROR.into(), thinned(&errors))].into(),
        ..row(training, folder, whole.weights, &whole.scores)
    }))
}

/// By which trainings a search was made: others say nothing of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SearchedOn {
    task: String,
    seed: u64,
    training_clips: usize,
    /// Of an end-to-end baseline.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    steps: Option<u64>,
}

impl SearchedOn {
    /// As a list has it for a model, on so many training clips.
    pub fn new(list: &Comparison, entry: &BaselineEntry, clips: usize) -> Self {
        let RateSearch { task, seed, whole_steps, .. } = &list.search;
        let steps = entry.whole.map(|_| *whole_steps);
        SearchedOn { task: task.clone(), seed: *seed, training_clips: clips, steps }
    }
}

/// The search of one model's learning rate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Searched {
    pub model: String,
    /// The key that was searched.
    pub key: String,
    /// None in reports of before.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub on: Option<SearchedOn>,
    /// Each rate, and the L_pred on validation clips at the end; none if that run has not finished.
    pub rates: Vec<(f64, Option<f64>)>,
    /// Those of them at which the training failed: they are as bad as can be.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<f64>,
    /// The rate with the least; none before all have finished or failed, or where all have failed.
    pub chosen: Option<f64>,
}

impl Searched {
    /// `failed`: rates that failed, those without a score.
    pub(super) fn new(
        (model, key): (&str, &str),
        on: Option<SearchedOn>,
        rates: Vec<(f64, Option<f64>)>,
        failed: &[f64],
    ) -> Self {
        let best = rates.iter().filter_map(|(rate, score)| Some((*rate, (*score)?)));
        let best = best.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(rate, _)| rate);
        let without = rates.iter().filter(|(_, score)| score.is_none()).map(|(rate, _)| *rate);
        let (failed, waiting): (Vec<f64>, Vec<f64>) = without.partition(|rate| failed.contains(rate));
        let chosen = best.filter(|_| waiting.is_empty());
        Searched { model: model.into(), key: key.into(), on, chosen, rates, failed }
    }

    /// The score of a rate, if that was run.
    pub(super) fn score(&self, rate: f64) -> Option<f64> {
        self.rates.iter().find(|(known, _)| *known == rate)?.1
    }

    /// Whether it is known what becomes of a rate.
    pub(super) fn knows(&self, rate: f64) -> bool {
        self.score(rate).is_some() || self.failed.contains(&rate)
    }
}

/// What the search found so far, for each model with a rate to search.
///
/// # Errors
/// A damaged run folder.
pub fn searched(places: &BaselineFolders, list: &Comparison, clips: usize) -> Result<Vec<Searched>> {
    let models: Vec<&BaselineEntry> = list.models.iter().collect();
    let trainings = plan::search(list, &models, clips);
    let of_model = |entry: &&BaselineEntry| -> Option<Result<Searched>> {
        let key = entry.rate.clone()?;
        let of_rates = || -> Result<Searched> {
            let (mut rates, mut failed) = (Vec::new(), Vec::new());
            for training in trainings.iter().filter(|training| training.entry.name == entry.name) {
                let rate = training.rate.unwrap_or(f64::NAN);
                rates.push((rate, validated(places, list, training)?));
                failed.extend(sweep::failure(&places.folder(list, training)?).map(|_| rate));
            }
            Ok(Searched::new((&entry.name, &key), Some(SearchedOn::new(list, entry, clips)), rates, &failed))
        };
        Some(of_rates())
    };
    models.iter().filter_map(of_model).collect()
}

/// L_pred on validation clips of the weights that a finished training ended with.
fn validated(places: &BaselineFolders, list: &Comparison, training: &Training) -> Result<Option<f64>> {
    let folder = places.folder(list, training)?;
    if BaselineRow::read(places, list, training)?.is_none() {
        return Ok(None);
    }
    let last = |course: Course| course.last_validation(VALIDATION_ERROR);
    if training.entry.whole.is_some() {
        return match EndToEndScores::read(&folder)?.and_then(|whole| whole.best) {
            Some(best) => Ok(Some(best.error)),
            // A run of before was scored with its last weights.
            None => Ok(last(Course::read(&folder)?)),
        };
    }
    Ok(StoredRun::read(&folder)?.course_of_its_weights().and_then(last))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use anyhow::anyhow;

    use super::*;

    fn list() -> Comparison {
        Comparison::read(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/baselines.toml"))).unwrap()
    }

    #[test]
    fn a_run_that_only_printed_something_has_no_row_yet() {
        let folder = tempfile::tempdir().unwrap();
        let (list, place) = (list(), folder.path().to_path_buf());
        let places = BaselineFolders { data: place.join("data"), runs: place, threads: 1, device: "cpu".into() };
        for name in ["physics", "video_lstm"] {
            let entry = list.model(name).unwrap();
            let rate = entry.rate.as_ref().map(|_| 1e-3);
            let training = Training { entry, task: "spring_color".into(), clips: 30, seed: 0, rate, searched: false };
            let run = places.folder(&list, &training).unwrap();
            fs::create_dir_all(&run).unwrap();
            fs::write(run.join(sweep::OUTPUT), "reads its data\n").unwrap();
            assert_eq!(BaselineRow::read(&places, &list, &training).unwrap(), None, "{name}");
        }
    }

    #[test]
    fn a_rate_that_failed_is_the_worst_and_one_that_was_not_run_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path();
        assert_eq!(sweep::failure(run), None);
        sweep::note_failure(run, &anyhow!("the loss is not finite"));
        assert_eq!(sweep::failure(run).as_deref(), Some("the loss is not finite"));
        sweep::forget_failure(run).unwrap();
        assert_eq!(sweep::failure(run), None);
        let chosen = |scores: [Option<f64>; 3], failed: &[f64]| {
            let rates = [1e-3, 1e-2, 1e-1].into_iter().zip(scores).collect();
            Searched::new(("lstm", "pretrain.learning_rate"), None, rates, failed).chosen
        };
        assert_eq!(chosen([Some(3.0), Some(2.0), Some(4.0)], &[]), Some(1e-2));
        assert_eq!(chosen([Some(3.0), Some(2.0), None], &[]), None);
        assert_eq!(chosen([Some(3.0), Some(2.0), None], &[1e-1]), Some(1e-2));
        assert_eq!(chosen([Some(3.0), None, None], &[1e-1]), None);
        assert_eq!(chosen([None; 3], &[1e-3, 1e-2, 1e-1]), None);
    }

    #[test]
    fn other_seeds_join_those_of_the_list_but_not_the_searchs() {
        let list = list();
        assert_eq!(list.seeds_with(&[5, 1, 3]).unwrap(), [0, 1, 2, 3, 5]);
        let error = list.seeds_with(&[list.search.seed]).unwrap_err().to_string();
        assert!(error.contains("the search of learning rates"), "{error}");
    }
}
