//! What became of the trainings: the rows of results.json, and the search of learning rates.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use tch::Device;

use super::list::{Comparison, Entry};
use super::plan::{self, Places, Training};
use super::training::WholeScores;
use crate::network::physics_models::{PhysicsNet, VariableGroup};
use crate::runs::course::Course;
use crate::runs::metrics::Kind;
use crate::runs::names::CONFIG;
use crate::runs::run::Run;
use crate::runs::scores::{PredictedFrame, Scores};
use crate::runs::summary::LearnedParameter;
use crate::training::config::Config;

/// The report's files that hold them: the rows, the search, and the frames of each model that the gallery shows.
pub(super) const RESULTS: &str = "results.json";
pub(super) const SEARCH: &str = "search.json";
pub(super) const FRAMES: &str = "frames";

/// A finished training of the comparison.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    pub task: String,
    pub model: String,
    pub seed: u64,
    /// All of the model's weights, and those that carry it from frame to frame: dynamics, or velocity estimator and
    /// physics; none of a whole other model.
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
    /// Steps and values of what changed in the training, some 60 at most: each physical parameter by its name, or of a whole
    /// other model the validation error as `pred_loss`.
    pub courses: BTreeMap<String, Vec<(f64, f64)>>,
    /// Where its predicted frames are.
    #[serde(skip)]
    pub frames: Option<PredictedFrames>,
}

/// The course of a whole other model's error.
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

impl Row {
    /// Of a training; none if it has not finished.
    ///
    /// # Errors
    /// A damaged run folder.
    pub fn read(places: &Places, list: &Comparison, training: &Training) -> Result<Option<Row>> {
        let folder = places.folder(list, training)?;
        if !folder.exists() {
            return Ok(None);
        }
        let row = if training.entry.whole.is_some() { of_whole(training, &folder) } else { of_run(training, &folder) };
        row.with_context(|| format!("run {}", folder.display()))
    }

    /// Whether it is of this training, at the same rate.
    pub fn is_of(&self, training: &Training) -> bool {
        let Training { entry, task, clips, seed, rate, .. } = training;
        let what = (&self.model, &self.task, self.training_clips, self.seed, self.searched_rate);
        what == (&entry.name, task, *clips, *seed, *rate)
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

fn row(training: &Training, folder: &Path, weights: usize, scores: &Scores) -> Row {
    let of_frames = |score: fn(&PredictedFrame) -> f64| scores.predicted_frames.iter().map(score).collect();
    Row {
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

fn of_run(training: &Training, folder: &Path) -> Result<Option<Row>> {
    let Some(summary) = Run::read(folder)?.summary else { return Ok(None) };
    let config = Config::read(&folder.join(CONFIG))?;
    let model = PhysicsNet::new(&config.task.system, &config.model, Device::Cpu, config.seed)?;
    let count = |counts: &dyn Fn(VariableGroup) -> bool| -> usize {
        let variables = model.named_variables().into_iter().filter(|(name, _)| counts(model.group(name)));
        variables.map(|(_, variable)| variable.numel()).sum()
    };
    let course = Course::read(folder)?;
    let courses = summary.parameters.keys().map(|name| (name.clone(), thinned(&course.points(None, name)))).collect();
    let carries = |group| !matches!(group, VariableGroup::Encoder | VariableGroup::Decoder);
    Ok(Some(Row {
        dynamics_weights: Some(count(&carries)),
        steps: summary.steps,
        seconds: summary.wall_seconds,
        parameters: summary.parameters.clone(),
        courses,
        ..row(training, folder, count(&|_| true), &summary.test.scores)
    }))
}

fn of_whole(training: &Training, folder: &Path) -> Result<Option<Row>> {
    let Some(whole) = WholeScores::read(folder)? else { return Ok(None) };
    let errors = Course::read(folder)?.points(Some(Kind::Valid), VALIDATION_ERROR);
    Ok(Some(Row {
        steps: whole.config.steps,
        seconds: whole.seconds,
        courses: [(VALIDATION_ERROR.into(), thinned(&errors))].into(),
        ..row(training, folder, whole.weights, &whole.scores)
    }))
}

/// The search of one model's learning rate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Searched {
    pub model: String,
    /// The key that was searched.
    pub key: String,
    /// Each rate, and the L_pred on validation clips at the end; none if that run has not finished.
    pub rates: Vec<(f64, Option<f64>)>,
    /// The rate with the least; none before all have finished.
    pub chosen: Option<f64>,
}

impl Searched {
    pub(super) fn new(model: &str, key: &str, rates: Vec<(f64, Option<f64>)>) -> Self {
        let best = rates.iter().filter_map(|(rate, score)| Some((*rate, (*score)?)));
        let best = best.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(rate, _)| rate);
        let all = rates.iter().all(|(_, score)| score.is_some());
        Searched { model: model.into(), key: key.into(), chosen: best.filter(|_| all), rates }
    }

    /// The score of a rate, if that was run.
    pub(super) fn score(&self, rate: f64) -> Option<f64> {
        self.rates.iter().find(|(known, _)| *known == rate)?.1
    }
}

/// What the search found so far, for each model with a rate to search.
///
/// # Errors
/// A damaged run folder.
pub fn searched(places: &Places, list: &Comparison, clips: usize) -> Result<Vec<Searched>> {
    let models: Vec<&Entry> = list.models.iter().collect();
    let trainings = plan::search(list, &models, clips);
    let of_model = |entry: &&Entry| -> Option<Result<Searched>> {
        let key = entry.rate.clone()?;
        let rates = || -> Result<Vec<(f64, Option<f64>)>> {
            let own = trainings.iter().filter(|training| training.entry.name == entry.name);
            own.map(|training| Ok((training.rate.unwrap_or(f64::NAN), validated(places, list, training)?))).collect()
        };
        Some(rates().map(|rates| Searched::new(&entry.name, &key, rates)))
    };
    models.iter().filter_map(of_model).collect()
}

/// L_pred on validation clips at the end of a finished training.
fn validated(places: &Places, list: &Comparison, training: &Training) -> Result<Option<f64>> {
    let folder = places.folder(list, training)?;
    let finished = Row::read(places, list, training)?;
    finished.map_or(Ok(None), |_| Ok(Course::read(&folder)?.last_validation(VALIDATION_ERROR)))
}
