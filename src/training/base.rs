//! The training and evaluation loops.
//!
//! Original: `nn/network/base.py`, class `BaseNet` (`train`, `eval`). A [`Trainer`] takes a model through the phases of
//! its recipe, writes the logs and checkpoints, and can stop and go on between any two steps.

use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};
use serde_json::{Value, json};
use tch::Tensor;

use super::phases::{self, GradientPhase, Phase, StepLoss};
use super::{discover, identify, join, recentre, velocity_fit};
use crate::cli::interrupt;
use crate::cli::progress::Progress;
use crate::datasets::iterators::Clips;
use crate::network::cells::{Actions, Coordinates};
use crate::network::physics_models::PhysicsNet;
use crate::network::physics_models::losses::{LossAccumulator, Losses, MeanLosses};
use crate::runs::checkpoint::{self, RunState};
use crate::runs::folder::RunFolder;
use crate::say;
use crate::support::device::COMMIT;
use crate::training::config::Config;
use crate::training::optimizers::{Optimizer, Rule};

/// Scores the first `limit` clips of a split, `batch` at a time. The whole clips are predicted.
///
/// # Errors
/// Clips shorter than L + T_pred.
pub fn evaluate(model: &PhysicsNet, clips: &Clips, limit: usize, batch: usize) -> Result<MeanLosses> {
    let _guard = tch::no_grad_guard();
    let mut means = LossAccumulator::default();
    let all: Vec<i64> = (0..clips.len().min(limit) as i64).collect();
    for chosen in all.chunks(batch) {
        let frames = clips.batch(chosen, clips.time());
        let pass = model.forward(&frames, &clips.actions(chosen))?;
        means.add(&Losses::new(&pass, &frames, &model.task), chosen.len());
    }
    Ok(means.values())
}

/// Frames on which the positions are re-centred.
const RECENTRE_FRAMES: usize = 1000;

/// How a training ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    Finished,
    /// Asked to stop by a signal; saved, ready to resume.
    Interrupted,
}

/// A model in training.
#[derive(Debug)]
pub struct Trainer<'a> {
    config: &'a Config,
    pub model: &'a PhysicsNet,
    train: &'a Clips,
    valid: &'a Clips,
    folder: &'a mut RunFolder,
    pub state: RunState,
    /// Start of the time that is not yet in `state.seconds`.
    clock: Instant,
}

impl<'a> Trainer<'a> {
    /// A training that starts from the beginning.
    ///
    /// # Errors
    /// A parameter in `start` that the model lacks.
    pub fn new(
        config: &'a Config,
        model: &'a PhysicsNet,
        train: &'a Clips,
        valid: &'a Clips,
        folder: &'a mut RunFolder,
    ) -> Result<Self> {
        for (symbol, value) in &config.start {
            let parameter = model.learned().find(|p| p.kind.name == symbol);
            let parameter = parameter.with_context(|| format!("start.{symbol}: the model learns no such parameter"))?;
            model.set_log(parameter, (value / model.true_unit(parameter.kind)).ln());
        }
        let state = RunState::new(model.task.key);
        Ok(Trainer { config, model, train, valid, folder, state, clock: Instant::now() })
    }

    /// Goes through the phases that are left, from the last checkpoint if there is one.
    ///
    /// # Errors
    /// A loss that is not a number, a full disk, a damaged checkpoint.
    pub fn run(&mut self) -> Result<Outcome> {
        let mut slots = self.load_last()?;
        for (place, phase) in phases::phases(self.config).into_iter().enumerate() {
            if place < self.state.phase {
                continue;
            }
            if self.state.commits.last().is_none_or(|last| last != COMMIT) {
                self.state.commits.push(COMMIT.into());
            }
            let (name, outcome) = match phase {
                Phase::Discover => {
                    let config = self.config.discover.as_ref().expect("the phase is in the recipe");
                    let seed = self.config.seed;
                    let mut phase = discover::Discovery::new(config, self.model, self.train, self.valid, seed);
                    ("discover", self.descend(&mut phase, config.optimizer, config.clip, slots.take())?)
                }
                Phase::Identify => ("identify", self.identify()?),
                Phase::Join => {
                    let config = &self.config.join;
                    let mut phase = join::Joint::new(config, self.train, self.config.seed)?;
                    ("join", self.descend(&mut phase, config.optimizer, config.clip, slots.take())?)
                }
            };
            if outcome == Outcome::Interrupted {
                return Ok(outcome);
            }
            // What earlier phases took is known; the rest, stops and all, is this one's.
            let earlier: f64 = self.state.phase_seconds.iter().map(|(_, seconds)| seconds).sum();
            self.state.phase_seconds.push((name.into(), self.elapsed() - earlier));
            self.state.phase += 1;
            self.state.step = 0;
            self.state.validations.clear();
            self.save(&[])?;
        }
        Ok(Outcome::Finished)
    }

    /// Restores the last checkpoint, if any; returns the optimizer's slots.
    fn load_last(&mut self) -> Result<Option<Vec<(String, Tensor)>>> {
        let folder = self.folder.checkpoints();
        let Some(index) = checkpoint::read_index(&folder)? else {
            self.folder.truncate(0, 0)?;
            return Ok(None);
        };
        let (state, slots) = checkpoint::load(&folder.join(&index.last), self.model)?;
        self.folder.truncate(state.log_bytes, state.metrics_bytes)?;
        say!("resuming after step {} ({})", state.steps, index.last);
        self.state = state;
        Ok((!slots.is_empty()).then_some(slots))
    }

    fn elapsed(&self) -> f64 {
        self.state.seconds + self.clock.elapsed().as_secs_f64()
    }

    fn save(&mut self, slots: &[(String, Tensor)]) -> Result<()> {
        (self.state.log_bytes, self.state.metrics_bytes) = self.folder.lengths()?;
        self.state.seconds = self.elapsed();
        self.clock = Instant::now();
        checkpoint::save(&self.folder.checkpoints(), self.model, slots, &self.state)
    }

    /// The gradient descent of one phase.
    fn descend(
        &mut self,
        phase: &mut dyn GradientPhase,
        rule: Rule,
        clip: f64,
        slots: Option<Vec<(String, Tensor)>>,
    ) -> Result<Outcome> {
        let variables = self.model.named_variables();
        if self.state.step == 0 {
            phase.begin(self.model)?;
        }
        let mut optimizer = Optimizer::new(rule, (clip > 0.0).then_some(clip), &variables);
        if let Some(slots) = slots {
            optimizer.restore(self.state.step, slots)?;
        }
        let progress = Progress::new(phase.name(), phase.timetable().max_steps(), self.state.step);
        // As in the original, a validation stands before the first step and after every so many.
        if self.state.step == 0 {
            self.validate(phase, &progress)?;
        }
        while !phase.timetable().finished(self.state.step, &self.state.validations) {
            let step = self.state.step;
            let loss = phase.loss(self.model, step)?;
            let value = loss.total.double_value(&[]);
            if !value.is_finite() {
                bail!("{}: {}", phase.name(), self.not_finite(&loss, &variables));
            }
            loss.total.backward();
            let factor = phase.timetable().factor(step, &self.state.validations);
            optimizer.step(&variables, |name| phase.learning_rate(name) * factor);
            self.state.step += 1;
            self.state.steps += 1;
            progress.step(|| format!("loss {value:.3} {}", self.parameters_text()));
            if self.state.step.is_multiple_of(self.config.output.print_every) {
                self.print(phase, &progress, value, &loss)?;
            }
            if self.state.step.is_multiple_of(phase.timetable().validate_every()) {
                self.validate(phase, &progress)?;
            }
            let stop = interrupt::asked();
            if stop || self.state.step.is_multiple_of(self.config.output.checkpoint_every) {
                self.save(&optimizer.slots())?;
            }
            if stop {
                progress.finish();
                return Ok(Outcome::Interrupted);
            }
        }
        progress.finish();
        Ok(Outcome::Finished)
    }

    /// A line of the log in the original's form, and a record.
    fn print(&mut self, phase: &dyn GradientPhase, progress: &Progress, value: f64, loss: &StepLoss) -> Result<()> {
        let steps = self.state.steps;
        let line = format!("train - iter={steps} train_loss={value:.4} {}", self.parameters_text());
        let line = line.trim_end();
        progress.line(&format!("{:>9} {line} ({:.0} s)", phase.name(), self.elapsed()));
        self.folder.log(line)?;
        let mut record = json!({"kind": "train", "phase": phase.name(), "step": steps, "train_loss": value});
        for (name, part) in &loss.parts {
            record[*name] = part.double_value(&[]).into();
        }
        self.add_parameters(&mut record);
        record["seconds"] = self.elapsed().into();
        self.folder.record(&record)
    }

    /// Scores the model on the validation split.
    fn validate(&mut self, phase: &dyn GradientPhase, progress: &Progress) -> Result<()> {
        let clips = self.config.join.validation_clips;
        let scores = evaluate(self.model, self.valid, clips, self.config.join.batch)?;
        let score = phase.score(self.model, &scores);
        ensure!(
            score.is_finite(),
            "{}: the validation score is not finite after step {}",
            phase.name(),
            self.state.steps
        );
        let steps_per_epoch = (self.train.len() / self.config.join.batch).max(1) as u64;
        let line = format!(
            "valid - epoch={} eval_extrap_loss={:.4} eval_pred_loss={:.4} eval_recons_loss={:.4}",
            self.state.steps / steps_per_epoch,
            scores.extrap_loss.unwrap_or(f64::NAN),
            scores.pred_loss,
            scores.recons_loss
        );
        progress.line(&format!("{:>9} {line}", phase.name()));
        self.folder.log(&line)?;
        let mut record = json!({
            "kind": "valid", "phase": phase.name(), "step": self.state.steps, "score": score,
            "recons_loss": scores.recons_loss, "pred_loss": scores.pred_loss, "extrap_loss": scores.extrap_loss,
            "seconds": self.elapsed(),
        });
        self.add_parameters(&mut record);
        self.folder.record(&record)?;
        self.state.validations.push(score);
        Ok(())
    }

    /// Adds the physical parameters to a record, by symbol.
    fn add_parameters(&self, record: &mut Value) {
        for (name, value) in self.model.parameter_values() {
            record[name] = value.into();
        }
    }

    fn parameters_text(&self) -> String {
        let values = self.model.parameter_values();
        values.iter().map(|(name, value)| format!("{name}={value:.3}")).collect::<Vec<_>>().join(" ")
    }

    /// Says which tensor first went wrong.
    fn not_finite(&self, loss: &StepLoss, variables: &[(String, Tensor)]) -> String {
        let step = self.state.steps + 1;
        let variable = variables.iter().find(|(_, variable)| !checkpoint::is_finite(variable));
        let part = loss.parts.iter().find(|(_, part)| !checkpoint::is_finite(part));
        let culprit = match (variable, part) {
            (Some((name, _)), _) => format!("variable {name}"),
            (None, Some((name, _))) => (*name).to_string(),
            (None, None) => "the total loss".to_string(),
        };
        format!(
            "{culprit} is not finite at step {step}; begin again in another folder (--out) with a lower learning rate"
        )
    }

    /// Fits the physical parameters to encoded trajectories, and re-centres the templates.
    fn identify(&mut self) -> Result<Outcome> {
        let config = self.config.identify.as_ref().expect("the phase is in the recipe");
        if self.model.learned().next().is_none() && config.velocity_steps == 0 {
            return Ok(Outcome::Finished);
        }
        let (positions, actions) = self.encode_clips(config.clips)?;
        let fit = identify::fit(config, &self.model.task, &positions, &actions, &self.model.parameters)?;
        for (parameter, log) in self.model.parameters.iter().zip(&fit.logs).filter(|(parameter, _)| parameter.learned) {
            self.model.set_log(parameter, *log);
        }
        let recentred = self.recentre(config.recentre_above, &fit.offsets)?;
        self.say(&format!(
            "identify - residual={:.4} {} iterations={} offsets={:.3?} {}",
            fit.residual,
            self.model.task.cell.coordinates.unit(),
            fit.iterations,
            fit.offsets,
            self.parameters_text()
        ))?;
        let mut record = json!({
            "kind": "identify", "phase": "identify", "step": self.state.steps, "residual": fit.residual,
            "iterations": fit.iterations, "offsets": fit.offsets, "recentred": recentred, "seconds": self.elapsed(),
        });
        self.add_parameters(&mut record);
        if config.velocity_steps > 0 {
            let (frames, steps) = (self.train.time(), config.velocity_steps);
            let left = velocity_fit::fit(self.model, &fit.states, &actions, frames, steps)?;
            let unit = self.model.task.cell.coordinates.unit();
            self.say(&format!("velocity - residual={left:.4} {unit} per time unit"))?;
            record["velocity_residual"] = left.into();
        }
        self.folder.record(&record)?;
        Ok(Outcome::Finished)
    }

    /// Takes the offsets off templates and positions if the largest is above `least` pixels (0: never); whether it did.
    fn recentre(&mut self, least: f64, offsets: &[f64]) -> Result<bool> {
        let largest = offsets.iter().fold(0.0f64, |largest, offset| largest.max(offset.abs()));
        // An angle is tied to where the rod is seen, which leaves little of an offset.
        let positions = self.model.task.cell.coordinates == Coordinates::Position;
        if !positions || least <= 0.0 || largest <= least {
            return Ok(false);
        }
        let frames = self.train.random_frames(RECENTRE_FRAMES, self.config.seed, self.state.steps);
        let left = recentre::recentre(self.model, &frames, offsets)?;
        self.say(&format!("recentre - largest offset {largest:.3} px, {left:.4} px left"))?;
        Ok(true)
    }

    /// Prints a line and logs it.
    fn say(&mut self, line: &str) -> Result<()> {
        say!("{line}");
        self.folder.log(line)
    }

    /// Encoded positions of the first `count` training clips, `[clips, time, coordinates * objects]`, and what acts on them.
    fn encode_clips(&self, count: usize) -> Result<(Tensor, Actions)> {
        let _guard = tch::no_grad_guard();
        let chosen: Vec<i64> = (0..self.train.len().min(count) as i64).collect();
        let encoded: Vec<Tensor> = chosen
            .chunks(self.config.join.batch)
            .map(|chosen| self.model.encode(&self.train.batch(chosen, self.train.time())).1)
            .collect();
        Ok((Tensor::cat(&encoded, 0), self.train.actions(&chosen)))
    }
}
