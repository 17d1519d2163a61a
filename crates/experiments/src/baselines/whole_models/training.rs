//! Training of a whole other model: plain descent, with the safety of any other run.
//!
//! The folder of such a run holds `model.toml` (what is trained), `metrics.jsonl`, `checkpoint.safetensors` (weights, Adam's
//! slots, the step, and the weights of the best validation; replaced in one step), and at the end `scores.json` and
//! `outputs.npz`, of the best weights.

use std::fs::{File, OpenOptions};
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use tch::Tensor;

use super::checkpoint::{self, Best, Progress};
use super::config::{self, MODEL, WholeConfig};
use super::frame_model::{self, Batch, FrameModel, named_variables, prediction_error};
use super::gaussian::normal_numbers;
use super::scores::{SCORES, Validation, WholeScores};
use paig::datasets::dataset::are_the_same;
use paig::datasets::iterators::{Clips, ShuffledBatches};
use paig::network::System;
use paig::runs::folder::lock;
use paig::runs::metrics::{self, Record};
use paig::runs::names::METRICS;
use paig::runs::weights;
use paig::support::atomic;
use paig::support::statistics::is_smaller;
use paig::support::storage::storage;
use paig::training::base::Outcome;
use paig::training::optimizers::{Optimizer, OptimizerKind};
use paig::viz;
use paig_kernels::{Repeated, own_stream};

/// Clips on which a model is validated, at most.
const VALIDATION_CLIPS: usize = 100;
/// Share of the steps after which the rate is divided by this.
const ANNEAL_AT: f64 = 0.75;
const ANNEAL_FACTOR: f64 = 5.0;

/// The clips of a run.
#[derive(Debug, Clone, Copy)]
pub struct WholeData<'a> {
    pub train: &'a Clips,
    /// What their frames are worth, `[clips, time]`, for a model that learns it.
    pub rewards: Option<&'a Tensor>,
    pub valid: &'a Clips,
    pub test: &'a Clips,
    /// Checksums of those for training and validation; empty where nobody says them.
    pub checksums: &'a str,
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

/// Begins a run in its folder, or goes on with it, and scores its best weights at its end. `stop` is asked after every step;
/// `tell` is given each validation.
///
/// # Errors
/// A folder that holds another run or one on other clips, a damaged checkpoint, a loss that is not a number, a full disk.
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
    let model = config.model.build(system, config.kernels, config.seed, device);
    let mut run = Running::new(config, model.as_ref(), data.checksums, folder)?;
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
    storage().create_folder(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let lock = lock(folder)?;
    match config::read(folder)? {
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
    /// Its seconds are those before `clock`.
    progress: Progress,
    clock: Instant,
    metrics: File,
}

impl<'a> Running<'a> {
    /// From the last checkpoint, if there is one. `clips`: their checksums.
    fn new(config: &'a WholeConfig, model: &'a dyn FrameModel, clips: &str, folder: &'a Path) -> Result<Self> {
        let variables = named_variables(model);
        let optimizer = Optimizer::new(OptimizerKind::Adam, None, &variables);
        let mut optimizer = optimizer.with_kernels(config.kernels);
        let mut progress = Progress::default();
        if checkpoint::is_in(folder) {
            progress = checkpoint::read(folder, &variables, &mut optimizer)?;
        }
        if progress.clips.is_empty() {
            progress.clips = clips.into();
        }
        ensure!(
            clips.is_empty() || are_the_same(clips, &progress.clips),
            "{}: the clips are not those that the run was begun with; put them back, or choose another folder",
            folder.display()
        );
        let metrics = open_metrics(&folder.join(METRICS), progress.step)?;
        Ok(Running { config, model, folder, variables, optimizer, progress, clock: Instant::now(), metrics })
    }

    fn seconds(&self) -> f64 {
        self.progress.seconds + self.clock.elapsed().as_secs_f64()
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
        if self.progress.step == 0 {
            self.model.begin(data.train);
            self.validate(system, data.valid, None, tell)?;
        }
        while self.progress.step < steps {
            let chosen = batches.clips_of_step(self.progress.step);
            let draws = self.model.draws(chosen.len(), data.train.time());
            let noise = (draws > 0).then(|| normal_numbers(seed, self.progress.step, draws));
            let batch = data.batch(chosen, noise);
            let annealed = self.progress.step as f64 >= ANNEAL_AT * steps as f64;
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
                bail!(
                    "the loss is not finite at step {}; begin again with a lower learning rate",
                    self.progress.step + 1
                );
            }
            self.progress.step += 1;
            let stop = stop();
            if self.progress.step.is_multiple_of(checkpoint_every) || self.progress.step == steps {
                let error = self.validate(system, data.valid, Some(value), tell)?;
                self.keep_if_best(error);
                self.save()?;
            } else if stop {
                self.save()?;
            }
            if stop && self.progress.step < steps {
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
            ..Record::new(metrics::Kind::Valid, "train", self.progress.step)
        };
        record.write(&mut self.metrics)?;
        tell(&record);
        Ok(error)
    }

    /// Keeps the weights as they are now if none had a smaller validation error.
    fn keep_if_best(&mut self, error: f64) {
        if self.progress.best.as_ref().is_none_or(|best| is_smaller(error, best.validation.error)) {
            self.progress.best = Some(Best::of(Validation { step: self.progress.step, error }, &self.variables));
        }
    }

    /// Gives the model the weights of the best validation, as a run of the physics ends, and says which that was.
    fn return_to_best(&self) -> Option<Validation> {
        let best = self.progress.best.as_ref()?;
        best.fill(&self.variables);
        Some(best.validation)
    }

    /// Replaces the checkpoint in one step, after the metrics that belong to it.
    fn save(&mut self) -> Result<()> {
        if let Some(name) = weights::first_not_finite(&self.variables) {
            bail!(
                "variable {name} is not finite after step {}; begin again with a lower learning rate",
                self.progress.step
            );
        }
        self.metrics.sync_data().context("cannot write the metrics")?;
        self.progress.seconds = self.seconds();
        self.clock = Instant::now();
        checkpoint::write(self.folder, &self.progress, &self.variables, &self.optimizer)
    }
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
    use tch::Device;

    use super::super::config::WholeModel;
    use super::*;
    use paig::tasks;
    use paig_kernels::Kernels;

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
            kernels: Kernels::Own,
        };
        let pixels = Array5::from_shape_fn((6, 8, 16, 16, 3), |(clip, time, y, x, colour)| {
            (clip * 31 + time * 17 + y * x * 7 + colour * 90) as u8
        });
        let clips = Clips::new(&pixels, None, Device::Cpu);
        let data = WholeData { train: &clips, rewards: None, valid: &clips, test: &clips, checksums: "those" };
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
        // With other clips it does not go on.
        let other = WholeData { checksums: "others", ..data };
        let cut = folder.path().join("cut");
        let refused = super::train(&config, &system, other, &cut, &|| false, &mut |_| ()).unwrap_err().to_string();
        assert!(refused.contains("the clips are not those"), "{refused}");
        train("cut", false);
        let [best, of_cut] =
            ["whole", "cut"].map(|name| WholeScores::read(&folder.path().join(name)).unwrap().unwrap().best.unwrap());
        assert_eq!((best.step, best.error.to_bits()), (of_cut.step, of_cut.error.to_bits()));
        // The first validation is before the first step.
        let least = errors[1..].iter().copied().fold(f64::INFINITY, f64::min);
        assert!(least < errors[6], "the test shows nothing: {errors:?}");
        assert_eq!((best.error, errors[best.step as usize]), (least, least));
        for name in ["whole", "cut"] {
            let model = config.model.build(&system, config.kernels, 9, Device::Cpu);
            checkpoint::load_weights(&folder.path().join(name), model.as_ref()).unwrap();
            assert_eq!(prediction_error(model.as_ref(), &system, &clips, VALIDATION_CLIPS).unwrap(), least, "{name}");
        }
    }
}
