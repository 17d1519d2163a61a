//! Training of a whole other model: plain descent, with the safety of any other run.
//!
//! The folder of such a run holds `model.toml` (what is trained), `metrics.jsonl`, `checkpoint.safetensors` (weights, Adam's
//! slots, the step, and the weights of the best validation; replaced in one step), and at the end `scores.json` and
//! `outputs.npz`, of the best weights.

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use tch::{Device, Kind, Tensor};

use super::ddpae::{self, Ddpae};
use super::frame_model::{self, Batch, FrameModel, named_variables, prediction_error};
use super::gaussian::normal_numbers;
use super::planet::{self, Planet};
use super::video_lstm::VideoLstm;
use crate::datasets::iterators::{Clips, ShuffledBatches};
use crate::kernels::{Repeated, own_stream};
use crate::network::System;
use crate::runs::folder::lock;
use crate::runs::metrics::{self, Record};
use crate::runs::names::METRICS;
use crate::runs::scores::Scores;
use crate::runs::weights;
use crate::support::statistics::is_smaller;
use crate::support::{atomic, storage};
use crate::training::base::Outcome;
use crate::training::optimizers::{Optimizer, OptimizerKind};
use crate::viz;

/// The run's files.
const MODEL: &str = "model.toml";
const CHECKPOINT: &str = "checkpoint.safetensors";
const SCORES: &str = "scores.json";
/// Step and seconds in a checkpoint, with step and error of the best validation; and what stands before the name of a slot,
/// and of a weight at the best validation.
const PROGRESS: &str = "progress";
const SLOT: &str = "slot/";
const BEST: &str = "best/";
/// Clips on which a model is validated, at most.
const VALIDATION_CLIPS: usize = 100;
/// Share of the steps after which the rate is divided by this.
const ANNEAL_AT: f64 = 0.75;
const ANNEAL_FACTOR: f64 = 5.0;

/// Which model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WholeModel {
    VideoLstm,
    Ddpae,
    Planet,
}

impl WholeModel {
    /// A fresh model of a system.
    pub fn build(self, system: &System, seed: u64, device: Device) -> Box<dyn FrameModel> {
        match self {
            WholeModel::VideoLstm => Box::new(VideoLstm::new(system, seed, device)),
            WholeModel::Ddpae => Box::new(Ddpae::new(system, seed, device)),
            WholeModel::Planet => Box::new(Planet::new(system, seed, device)),
        }
    }

    /// Of the frames that it takes in, pixels: smaller ones leave nothing of themselves after its last layer.
    fn least_side(self) -> usize {
        match self {
            WholeModel::VideoLstm => 1,
            WholeModel::Ddpae => ddpae::LEAST_SIDE,
            WholeModel::Planet => planet::LEAST_SIDE,
        }
    }

    /// Whether it learns what frames are worth.
    pub fn learns_rewards(self) -> bool {
        self == WholeModel::Planet
    }
}

/// What decides the result of a training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WholeConfig {
    pub model: WholeModel,
    /// Name of the task or its file.
    pub task: String,
    pub data: PathBuf,
    pub seed: u64,
    /// Adam's.
    pub learning_rate: f64,
    /// Clips in a step.
    pub batch: usize,
    pub steps: u64,
    /// Steps from one validation and checkpoint to the next.
    pub checkpoint_every: u64,
}

impl WholeConfig {
    /// # Errors
    /// A number out of range.
    pub fn check(&self) -> Result<()> {
        ensure!(self.learning_rate.is_finite() && self.learning_rate > 0.0, "the learning rate must be positive");
        ensure!(self.batch > 0 && self.steps > 0 && self.checkpoint_every > 0, "batch and steps must be at least 1");
        ensure!(self.seed <= i64::MAX as u64, "seed {}: must be at most {}", self.seed, i64::MAX);
        Ok(())
    }
}

/// What a finished run scores on its test file.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct WholeScores {
    pub config: WholeConfig,
    pub weights: usize,
    pub training_clips: usize,
    pub seconds: f64,
    /// The validation whose weights are scored; none in files of before, which score those of the last step.
    #[serde(default)]
    pub best: Option<Validation>,
    pub scores: Scores,
}

/// One validation: after which step, and the error on all frames after the input.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct Validation {
    pub step: u64,
    pub error: f64,
}

impl WholeScores {
    /// Of the run in a folder; none if it has not finished.
    ///
    /// # Errors
    /// A damaged file.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(SCORES);
        if !path.exists() {
            return Ok(None);
        }
        let read = || Ok::<_, anyhow::Error>(serde_json::from_slice(&fs::read(&path)?)?);
        read().with_context(|| format!("scores {}", path.display())).map(Some)
    }
}

/// The clips of a run.
#[derive(Debug, Clone, Copy)]
pub struct WholeData<'a> {
    pub train: &'a Clips,
    /// What their frames are worth, `[clips, time]`, for a model that learns it.
    pub rewards: Option<&'a Tensor>,
    pub valid: &'a Clips,
    pub test: &'a Clips,
}

impl WholeData<'_> {
    fn batch(&self, chosen: &[i64], noise: Option<Tensor>) -> Batch {
        let device = self.train.device();
        let of_chosen = |rewards: &Tensor| rewards.index_select(0, &Tensor::from_slice(chosen)).to_device(device);
        Batch {
            frames: self.train.batch(chosen, self.train.time()),
            actions: self.train.actions(chosen),
            rewards: self.rewards.map(of_chosen),
            noise: noise.map(|numbers| numbers.to_device(device)),
        }
    }
}

/// The config of the run in a folder; none if there is no such run.
///
/// # Errors
/// A damaged file.
pub fn read_config(folder: &Path) -> Result<Option<WholeConfig>> {
    let path = folder.join(MODEL);
    if !path.exists() {
        return Ok(None);
    }
    let read = || Ok::<_, anyhow::Error>(toml::from_str(&fs::read_to_string(&path)?)?);
    read().with_context(|| format!("config {}", path.display())).map(Some)
}

/// Gives a model the weights of the best validation in a run's folder; of a run of an earlier version those of its last step.
///
/// # Errors
/// No checkpoint, a damaged one, or one of another model.
pub fn load_weights(folder: &Path, model: &dyn FrameModel) -> Result<()> {
    let variables = named_variables(model);
    let mut optimizer = Optimizer::new(OptimizerKind::Adam, None, &variables);
    let progress = read_checkpoint(&folder.join(CHECKPOINT), &variables, &mut optimizer)?;
    progress.best.iter().for_each(|best| best.fill(&variables));
    Ok(())
}

/// Begins a run in its folder, or goes on with it, and scores its best weights at its end. `stop` is asked after every step;
/// `tell` is given each validation.
///
/// # Errors
/// A folder that holds another run, a damaged checkpoint, a loss that is not a number, a full disk.
pub fn train(
    config: &WholeConfig,
    system: &System,
    data: WholeData,
    folder: &Path,
    stop: &dyn Fn() -> bool,
    tell: &mut dyn FnMut(&Record),
) -> Result<Outcome> {
    config.check()?;
    let least = config.model.least_side();
    ensure!(system.side >= least, "frames of {} pixels: this model needs frames of {least} or more", system.side);
    let _lock = open(config, folder)?;
    if WholeScores::read(folder)?.is_some() {
        return Ok(Outcome::Finished);
    }
    let device = data.train.device();
    own_stream(device)?;
    let model = config.model.build(system, config.seed, device);
    let mut run = Running::new(config, model.as_ref(), folder)?;
    if run.descend(system, data, stop, tell)? == Outcome::Interrupted {
        return Ok(Outcome::Interrupted);
    }
    let (seconds, best) = (run.seconds(), run.return_to_best());
    write_results(config, model.as_ref(), system, data, (seconds, best), folder)?;
    Ok(Outcome::Finished)
}

/// Takes a folder for this run, or finds it there; for this program alone while the file is open.
fn open(config: &WholeConfig, folder: &Path) -> Result<File> {
    let text = toml::to_string_pretty(config)?;
    fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let lock = lock(folder)?;
    match read_config(folder)? {
        Some(saved) => {
            ensure!(saved == *config, "{} was begun with other options; choose another folder", folder.display());
        }
        None => atomic::write_file(&folder.join(MODEL), |file| Ok(std::io::Write::write_all(file, text.as_bytes())?))?,
    }
    Ok(lock)
}

fn write_results(
    config: &WholeConfig,
    model: &dyn FrameModel,
    system: &System,
    data: WholeData,
    (seconds, best): (f64, Option<Validation>),
    folder: &Path,
) -> Result<()> {
    let (mut input, mut output) = (Vec::new(), Vec::new());
    let saved = viz::saved_clips(system, data.test.time());
    frame_model::each_prediction(model, system, data.test, saved, |clips, predicted| {
        input.push(clips.shallow_clone());
        output.push(predicted.shallow_clone());
        Ok(())
    })?;
    viz::write_predictions(&folder.join("outputs.npz"), &Tensor::cat(&input, 0), &Tensor::cat(&output, 0))?;
    let scores = WholeScores {
        config: config.clone(),
        weights: frame_model::weights(model),
        training_clips: data.train.len(),
        seconds,
        best,
        scores: frame_model::scores(model, system, data.test, data.test.len())?,
    };
    atomic::write_file(&folder.join(SCORES), |file| Ok(serde_json::to_writer_pretty(file, &scores)?))
}

/// A training under way.
struct Running<'a> {
    config: &'a WholeConfig,
    model: &'a dyn FrameModel,
    folder: &'a Path,
    variables: Vec<(String, Tensor)>,
    optimizer: Optimizer,
    step: u64,
    /// None before the first checkpoint.
    best: Option<Best>,
    /// Seconds of computing before `clock`.
    before: f64,
    clock: Instant,
    metrics: File,
}

impl<'a> Running<'a> {
    /// From the last checkpoint, if there is one.
    fn new(config: &'a WholeConfig, model: &'a dyn FrameModel, folder: &'a Path) -> Result<Self> {
        let variables = named_variables(model);
        let mut optimizer = Optimizer::new(OptimizerKind::Adam, None, &variables);
        let path = folder.join(CHECKPOINT);
        let mut progress = Progress { step: 0, seconds: 0.0, best: None };
        if path.exists() {
            progress = read_checkpoint(&path, &variables, &mut optimizer)?;
        }
        let Progress { step, seconds: before, best } = progress;
        let metrics = open_metrics(&folder.join(METRICS), step)?;
        Ok(Running { config, model, folder, variables, optimizer, step, best, before, clock: Instant::now(), metrics })
    }

    fn seconds(&self) -> f64 {
        self.before + self.clock.elapsed().as_secs_f64()
    }

    /// Descends to the last step, or until it is asked to stop.
    fn descend(
        &mut self,
        system: &System,
        data: WholeData,
        stop: &dyn Fn() -> bool,
        tell: &mut dyn FnMut(&Record),
    ) -> Result<Outcome> {
        let WholeConfig { batch, seed, steps, checkpoint_every, .. } = *self.config;
        let mut batches = ShuffledBatches::new(data.train.len(), batch, seed)?;
        let mut descent = Repeated::on(data.train.device());
        if self.step == 0 {
            self.model.begin(data.train);
            self.validate(system, data.valid, None, tell)?;
        }
        while self.step < steps {
            let chosen = batches.clips_of_step(self.step);
            let draws = self.model.draws(chosen.len(), data.train.time());
            let noise = (draws > 0).then(|| normal_numbers(seed, self.step, draws));
            let batch = data.batch(chosen, noise);
            let annealed = self.step as f64 >= ANNEAL_AT * steps as f64;
            let rate = self.config.learning_rate / if annealed { ANNEAL_FACTOR } else { 1.0 };
            self.optimizer.begin_step(&vec![rate; self.variables.len()]);
            let (model, optimizer, variables) = (self.model, &self.optimizer, &self.variables);
            let loss = descent.call(&batch.parts(), |parts| {
                let loss = model.loss(&batch.with(parts));
                optimizer.descend(&loss, variables);
                Ok(loss.detach())
            })?;
            let value = loss.double_value(&[]);
            if !value.is_finite() {
                bail!("the loss is not finite at step {}; begin again with a lower learning rate", self.step + 1);
            }
            self.step += 1;
            let stop = stop();
            if self.step.is_multiple_of(checkpoint_every) || self.step == steps {
                let error = self.validate(system, data.valid, Some(value), tell)?;
                self.keep_if_best(error);
                self.save()?;
            } else if stop {
                self.save()?;
            }
            if stop && self.step < steps {
                return Ok(Outcome::Interrupted);
            }
        }
        Ok(Outcome::Finished)
    }

    /// Scores the model on validation clips, on all frames after the input, and returns its error.
    fn validate(
        &mut self,
        system: &System,
        valid: &Clips,
        train_loss: Option<f64>,
        tell: &mut dyn FnMut(&Record),
    ) -> Result<f64> {
        let error = prediction_error(self.model, system, valid, VALIDATION_CLIPS)?;
        let record = Record {
            train_loss,
            score: Some(error),
            pred_loss: Some(error),
            seconds: Some(self.seconds()),
            ..Record::new(metrics::Kind::Valid, "train", self.step)
        };
        record.write(&mut self.metrics)?;
        tell(&record);
        Ok(error)
    }

    /// Keeps the weights as they are now if none had a smaller validation error.
    fn keep_if_best(&mut self, error: f64) {
        if self.best.as_ref().is_none_or(|best| is_smaller(error, best.validation.error)) {
            let weights = self.variables.iter().map(|(name, variable)| (name.clone(), variable.detach().copy()));
            self.best = Some(Best { validation: Validation { step: self.step, error }, weights: weights.collect() });
        }
    }

    /// Gives the model the weights of the best validation, as a run of the physics ends, and says which that was.
    fn return_to_best(&self) -> Option<Validation> {
        let best = self.best.as_ref()?;
        best.fill(&self.variables);
        Some(best.validation)
    }

    /// Replaces the checkpoint in one step, after the metrics that belong to it.
    fn save(&mut self) -> Result<()> {
        if let Some(name) = weights::first_not_finite(&self.variables) {
            bail!("variable {name} is not finite after step {}; begin again with a lower learning rate", self.step);
        }
        self.metrics.sync_data().context("cannot write the metrics")?;
        let mut progress = vec![self.step as f64, self.seconds()];
        progress.extend(self.best.iter().flat_map(|Best { validation: it, .. }| [it.step as f64, it.error]));
        let kept = self.best.iter().flat_map(|best| &best.weights);
        let kept = kept.map(|(name, weight)| (format!("{BEST}{name}"), weight.shallow_clone()));
        let slots = self.optimizer.slots().into_iter().map(|(name, slot)| (format!("{SLOT}{name}"), slot));
        let all = self.variables.iter().map(|(name, variable)| (name.clone(), variable.detach())).chain(slots);
        let all: Vec<_> = all.chain(kept).chain([(PROGRESS.to_string(), Tensor::from_slice(&progress))]).collect();
        weights::write(&self.folder.join(CHECKPOINT), &all)
    }
}

/// How far a training has come.
struct Progress {
    step: u64,
    seconds: f64,
    /// None of a checkpoint of an earlier version.
    best: Option<Best>,
}

/// The weights at the least validation error so far.
struct Best {
    validation: Validation,
    weights: Vec<(String, Tensor)>,
}

impl Best {
    /// Gives a model's variables, in their order, these weights.
    fn fill(&self, variables: &[(String, Tensor)]) {
        let _guard = tch::no_grad_guard();
        variables.iter().zip(&self.weights).for_each(|((_, variable), (_, weight))| {
            variable.shallow_clone().copy_(weight);
        });
    }
}

fn read_checkpoint(path: &Path, variables: &[(String, Tensor)], optimizer: &mut Optimizer) -> Result<Progress> {
    let bytes = storage::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let saved = weights::parse(&bytes).with_context(|| path.display().to_string())?.tensors;
    let restored = restore(saved, variables, optimizer);
    restored.with_context(|| format!("checkpoint {} does not fit the model", path.display()))
}

/// Sets variables and slots to what a checkpoint holds.
fn restore(
    saved: Vec<(String, Tensor)>,
    variables: &[(String, Tensor)],
    optimizer: &mut Optimizer,
) -> Result<Progress> {
    let _guard = tch::no_grad_guard();
    let mut saved: BTreeMap<String, Tensor> = saved.into_iter().collect();
    let progress: Vec<f64> = saved.remove(PROGRESS).context("it holds no step")?.to_kind(Kind::Double).try_into()?;
    let (step, seconds, validation) = match progress[..] {
        [step, seconds] => (step, seconds, None),
        [step, seconds, at, error] => (step, seconds, Some(Validation { step: at as u64, error })),
        _ => bail!("its step is no step"),
    };
    let mut take = |name: String, variable: &Tensor| -> Result<Tensor> {
        let value = saved.remove(&name).with_context(|| format!("variable {name} is missing"))?;
        ensure!(value.size() == variable.size(), "variable {name} has shape {:?}", value.size());
        Ok(value)
    };
    let best = |validation: Validation| -> Result<Best> {
        let weight = |(name, variable): &(String, Tensor)| Ok((name.clone(), take(format!("{BEST}{name}"), variable)?));
        Ok(Best { validation, weights: variables.iter().map(weight).collect::<Result<_>>()? })
    };
    let best = validation.map(best).transpose()?;
    for (name, variable) in variables {
        variable.shallow_clone().copy_(&take(name.clone(), variable)?);
    }
    let slot = |(name, value): (String, Tensor)| Some((name.strip_prefix(SLOT)?.to_string(), value));
    optimizer.restore(step as u64, saved.into_iter().filter_map(slot).collect())?;
    Ok(Progress { step: step as u64, seconds, best })
}

/// The metrics up to a step, ready to go on.
fn open_metrics(path: &Path, step: u64) -> Result<File> {
    let kept = if path.exists() { metrics::read(path)? } else { Vec::new() };
    atomic::write_file(path, |file| {
        Record::begin().write(file)?;
        // Without a checkpoint the first validation is made again.
        kept.iter().filter(|record| step > 0 && record.step <= step).try_for_each(|record| record.write(file))
    })?;
    OpenOptions::new().append(true).open(path).with_context(|| format!("cannot open {}", path.display()))
}

#[cfg(test)]
mod tests {
    use ndarray::Array5;

    use super::*;
    use crate::tasks;

    /// With a rate at which it leaps about, so that the last weights are not the best ones; also where it was cut off.
    #[test]
    fn the_weights_of_the_best_validation_are_scored_and_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let plain = tasks::builtin("spring_color").unwrap().system;
        let system = System { side: 16, pred_steps: 3, ..plain };
        let config = WholeConfig {
            model: WholeModel::VideoLstm,
            task: "spring_color".into(),
            data: "noise".into(),
            seed: 4,
            learning_rate: 0.3,
            batch: 2,
            steps: 6,
            checkpoint_every: 1,
        };
        let pixels = Array5::from_shape_fn((6, 8, 16, 16, 3), |(clip, time, y, x, colour)| {
            (clip * 31 + time * 17 + y * x * 7 + colour * 90) as u8
        });
        let clips = Clips::new(&pixels, None, Device::Cpu);
        let data = WholeData { train: &clips, rewards: None, valid: &clips, test: &clips };
        let train = |name: &str, stop: bool| {
            let mut errors = Vec::new();
            let tell = &mut |record: &Record| errors.push(record.score.unwrap());
            let outcome = train(&config, &system, data, &folder.path().join(name), &|| stop, tell).unwrap();
            assert_eq!(outcome == Outcome::Interrupted, stop);
            errors
        };
        let errors = train("whole", false);
        // Stopped after each of its first steps.
        (0..5).for_each(|_| _ = train("cut", true));
        train("cut", false);
        let [best, of_cut] =
            ["whole", "cut"].map(|name| WholeScores::read(&folder.path().join(name)).unwrap().unwrap().best.unwrap());
        assert_eq!((best.step, best.error.to_bits()), (of_cut.step, of_cut.error.to_bits()));
        // The first validation is before the first step.
        let least = errors[1..].iter().copied().fold(f64::INFINITY, f64::min);
        assert!(least < errors[6], "the test shows nothing: {errors:?}");
        assert_eq!((best.error, errors[best.step as usize]), (least, least));
        for name in ["whole", "cut"] {
            let model = config.model.build(&system, 9, Device::Cpu);
            load_weights(&folder.path().join(name), model.as_ref()).unwrap();
            assert_eq!(prediction_error(model.as_ref(), &system, &clips, VALIDATION_CLIPS).unwrap(), least, "{name}");
        }
    }
}
