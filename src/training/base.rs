//! The training loop.
//!
//! Original: `nn/network/base.py`, class `BaseNet` (`train`). A [`Session`] descends the loss of a phase, tells its
//! observers what happens, and can stop and go on between any two steps.

use std::cell::OnceCell;
use std::fmt::{self, Debug};
use std::rc::Rc;
use std::time::Instant;

use anyhow::{Result, bail};
use tch::{Device, Tensor};

use super::objective::{Objective, StepLoss, Validated};
use super::objects::motion::MotionDetector;
use super::observer::{TrainingEvent, TrainingObserver};
use super::optimizers::{Optimizer, OptimizerKind};
use super::schedule::Timetable;
use super::trained::Trainable;
use crate::datasets::iterators::{Clips, steps_per_epoch};
use crate::network::physics_models::PhysicsNet;
use crate::runs::checkpoint::{BestOf, DataChecksums, RunState, Store};
use crate::runs::metrics::{Record, RecordKind};
use crate::runs::weights::{self, NamedTensors, first_not_finite, is_finite};
use paig_kernels::Repeated;

/// How a training or a phase ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrainingOutcome {
    Finished,
    /// Asked to stop; saved, ready to resume.
    Interrupted,
}

/// How often something is done, in steps of a phase.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Intervals {
    pub print: u64,
    pub checkpoint: u64,
}

/// The clips on which a model is validated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Validation {
    /// At most so many.
    pub clips: usize,
    /// In one pass.
    pub pass: usize,
    /// Clips in a step of `join`: what an epoch is counted by.
    pub batch: usize,
}

/// A model in training, and where the training stands.
pub struct Session<'a, M: Trainable = PhysicsNet> {
    pub model: &'a M,
    pub train: &'a Clips,
    pub valid: &'a Clips,
    /// Of all random numbers.
    pub seed: u64,
    pub validation: Validation,
    pub(super) intervals: Intervals,
    /// The phase at hand is the last one: the weights of its best score are kept, as of those that end with them.
    pub(super) last_phase: bool,
    /// The unconstrained parameters that the training began with, in the order of the equation; none without one.
    pub(super) begun: Vec<f64>,
    /// The best weights, where no store holds them.
    pub(super) best: Option<NamedTensors>,
    /// What stands behind the objects of the training clips, once it was measured.
    pub(super) motion: OnceCell<Rc<MotionDetector>>,
    pub state: RunState,
    /// Where checkpoints go; without one nothing is saved.
    pub(super) store: Option<Store>,
    pub(super) observers: Vec<&'a mut dyn TrainingObserver<M>>,
    pub(super) stop: Box<dyn Fn() -> bool + 'a>,
    /// Of the optimizer where the training goes on: at the last checkpoint, without a store where it stopped.
    pub(super) slots: Option<NamedTensors>,
    /// Start of the time that is not yet in `state.seconds`.
    pub(super) clock: Instant,
}

impl<M: Trainable> Debug for Session<'_, M> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_struct("Session").field("state", &self.state).finish_non_exhaustive()
    }
}

impl<'a, M: Trainable> Session<'a, M> {
    /// A training of `task` that has not begun, without checkpoints and observers.
    pub fn new(
        model: &'a M,
        task: &str,
        [train, valid]: [&'a Clips; 2],
        seed: u64,
        validation: Validation,
        intervals: Intervals,
    ) -> Self {
        Session {
            model,
            train,
            valid,
            seed,
            validation,
            intervals,
            last_phase: false,
            begun: Vec::new(),
            best: None,
            motion: OnceCell::new(),
            state: RunState::new(task),
            store: None,
            observers: Vec::new(),
            stop: Box::new(|| false),
            slots: None,
            clock: Instant::now(),
        }
    }

    /// Saves checkpoints there.
    pub fn save_to(&mut self, store: Store) {
        self.store = Some(store);
    }

    /// Tells this observer what happens, after those that were named before.
    pub fn observed_by(&mut self, observer: &'a mut dyn TrainingObserver<M>) {
        self.observers.push(observer);
    }

    /// Stops after the step in which this says so.
    pub fn stop_when(&mut self, stop: impl Fn() -> bool + 'a) {
        self.stop = Box::new(stop);
    }

    /// Goes on from the last checkpoint, if there is any, with these clips, this film and these test clips.
    ///
    /// # Errors
    /// Checkpoints that are all damaged, or of a training on other clips, beside another film or scored on others.
    pub fn resume(&mut self, data: &DataChecksums) -> Result<()> {
        self.load_last()?;
        data.ensure_are(&self.state.data())?;
        let RunState { clips, film, test, .. } = &mut self.state;
        for (begun_with, now) in [(clips, &data.clips), (film, &data.film), (test, &data.test)] {
            if begun_with.is_empty() {
                begun_with.clone_from(now);
            }
        }
        Ok(())
    }

    /// Restores the last checkpoint, if there is any.
    fn load_last(&mut self) -> Result<()> {
        let Some(store) = &self.store else { return Ok(()) };
        let Some(loaded) = store.load(self.model.named_variables(), &self.state.task)? else {
            self.state.config = store.config_checksum()?;
            return Ok(());
        };
        self.state = loaded.state;
        self.slots = (!loaded.slots.is_empty()).then_some(loaded.slots);
        let damaged = loaded.damaged.as_deref();
        self.tell(&TrainingEvent::Resumed { steps: self.state.steps, checkpoint: &loaded.name, damaged })
    }

    /// What stands behind the objects of the training clips.
    pub(super) fn motion(&self) -> Rc<MotionDetector> {
        Rc::clone(self.motion.get_or_init(|| Rc::new(MotionDetector::measure(self.train, self.seed))))
    }

    /// Tells all observers.
    pub(super) fn tell(&mut self, event: &TrainingEvent<M>) -> Result<()> {
        self.observers.iter_mut().try_for_each(|observer| observer.observe(event))
    }

    /// Seconds of computing so far.
    pub fn elapsed(&self) -> f64 {
        self.state.seconds + self.clock.elapsed().as_secs_f64()
    }

    pub(super) fn save(&mut self, slots: &[(String, Tensor)]) -> Result<()> {
        self.state.seconds = self.elapsed();
        self.clock = Instant::now();
        let Some(store) = &self.store else {
            let copies = slots.iter().map(|(name, slot)| (name.clone(), slot.copy()));
            self.slots = (!slots.is_empty()).then(|| copies.collect());
            return Ok(());
        };
        store.save(&self.model.named_variables(), slots, &mut self.state)?;
        self.tell(&TrainingEvent::Checkpoint { steps: self.state.steps })
    }

    /// Descends a phase's loss to its end, by `rule` with gradients clipped as [`Optimizer::of_config`] says.
    ///
    /// # Errors
    /// A loss, a weight or a validation score that is not a number, a checkpoint that cannot be written or read, an
    /// observer's error.
    pub fn train_phase(
        &mut self,
        phase: &'static str,
        objective: &mut dyn Objective<M>,
        rule: OptimizerKind,
        clip_gradients: f64,
    ) -> Result<TrainingOutcome> {
        let variables = self.model.named_variables();
        let optimizer = Optimizer::of_config(rule, clip_gradients, &variables);
        let mut optimizer = optimizer.with_kernels(self.model.kernels());
        if let Some(slots) = self.slots.take() {
            optimizer.restore(self.state.step, slots)?;
        }
        self.tell(&TrainingEvent::PhaseBegins { phase, done: self.state.step, of: objective.timetable().max_steps() })?;
        // As in the original, a validation stands before the first step and after every so many.
        if self.state.step == 0
            && let Some(culprit) = self.validate(phase, objective)?
        {
            bail!("{phase}: {culprit} before the first step");
        }
        let device = self.model.device();
        let on_gpu = device != Device::Cpu;
        let mut steps = Repeated::on(device);
        let mut outcome = TrainingOutcome::Finished;
        let mut diverged: Option<String> = None;
        while !objective.timetable().finished(self.state.step, &self.state.validations) {
            let step = self.state.step;
            let inputs = objective.inputs(self.model, step, &self.state.validations)?;
            let factor = objective.timetable().factor(step, &self.state.validations);
            let rate = |(name, _): &(String, Tensor)| objective.learning_rate(self.model.group(name)) * factor;
            let rates: Vec<_> = variables.iter().map(rate).collect();
            optimizer.begin_step(&rates);
            let loss = steps.call(&inputs, |inputs| {
                let loss = objective.loss(self.model, inputs)?;
                if on_gpu || is_finite(&loss.total) {
                    optimizer.descend(&loss.total, &variables);
                }
                Ok(loss.detached())
            })?;
            let value = loss.total.double_value(&[]);
            if !value.is_finite() {
                diverged = Some(format!("{} at step {}", not_finite(loss, &variables), self.state.steps + 1));
                break;
            }
            self.state.step += 1;
            self.state.steps += 1;
            self.tell(&TrainingEvent::Step { loss: value, model: self.model })?;
            if self.state.step.is_multiple_of(self.intervals.print) {
                self.record_step(phase, value, loss)?;
            }
            let (stop, timetable) = ((self.stop)(), objective.timetable());
            let validates = self.state.step.is_multiple_of(timetable.validate_every());
            let saves = stop || self.state.step.is_multiple_of(self.intervals.checkpoint);
            if validates || saves || self.state.step == timetable.max_steps() {
                diverged = self.look_at(&variables, phase, validates.then_some(&mut *objective))?;
                if diverged.is_some() {
                    break;
                }
            }
            if saves {
                self.save(&optimizer.slots())?;
            }
            if stop {
                outcome = TrainingOutcome::Interrupted;
                break;
            }
        }
        // What the phases before have found is not lost where the last one diverges.
        if let Some(culprit) = diverged.as_ref().filter(|_| !(self.last_phase && objective.ends_at_best())) {
            bail!("{phase}: {culprit}; begin again in another folder (--out) with a lower learning rate");
        }
        if outcome == TrainingOutcome::Finished && objective.ends_at_best() {
            self.return_to_best(phase, objective, diverged)?;
        }
        if let Some(why) = steps.refused() {
            self.tell(&TrainingEvent::Note(&format!(
                "{phase} - its steps were not recorded on the GPU, which is slower: {why}"
            )))?;
        }
        self.tell(&TrainingEvent::PhaseEnds { phase })?;
        Ok(outcome)
    }

    /// Looks at the weights, and validates by an objective if it is given. Says what is not a number: a gradient that is none shows
    /// in the weights, after a loss that was one.
    fn look_at(
        &mut self,
        variables: &[(String, Tensor)],
        phase: &str,
        objective: Option<&mut dyn Objective<M>>,
    ) -> Result<Option<String>> {
        let culprit = match (first_not_finite(variables), objective) {
            (Some(name), _) => Some(format!("variable {name} is not finite")),
            (None, Some(objective)) => self.validate(phase, objective)?,
            (None, None) => None,
        };
        Ok(culprit.map(|culprit| format!("{culprit} after step {}", self.state.steps)))
    }

    /// Gives the model the weights of the phase's best validation, if the last is not the best; in any case where it
    /// `diverged`, for a reason.
    fn return_to_best(
        &mut self,
        phase: &'static str,
        objective: &mut dyn Objective<M>,
        mut diverged: Option<String>,
    ) -> Result<()> {
        if diverged.is_none() && !self.state.step.is_multiple_of(objective.timetable().validate_every()) {
            diverged = self.validate(phase, objective)?;
        }
        let (step, best) = self.best_validation(objective.timetable());
        if diverged.is_none() && self.state.validations.last().is_none_or(|last| *last == best) {
            return Ok(());
        }
        let variables = self.model.named_variables();
        match (&self.store, self.best.take()) {
            (Some(store), _) => store.load_best(variables, self.best_of(phase))?,
            (None, Some(best)) => weights::fill(variables, &best)?,
            (None, None) => bail!("{phase}: the best weights were not kept"),
        }
        let why = diverged.map_or_else(String::new, |culprit| format!("{culprit}: "));
        self.tell(&TrainingEvent::Note(&format!("{phase} - {why}back to its step {step}, the best by validation")))
    }

    /// The phase's best validation among those that count: its step, and its score.
    pub fn best_validation(&self, timetable: &Timetable) -> (u64, f64) {
        let first = timetable.first_counted(&self.state.validations);
        let scores = &self.state.validations[first..];
        let best = scores.iter().copied().fold(f64::INFINITY, f64::min);
        let place = (first + scores.iter().position(|score| *score == best).unwrap_or(0)) as u64;
        // The last one may stand at the end of the phase, between two that are due.
        ((place * timetable.validate_every()).min(self.state.step), best)
    }

    fn best_of<'p>(&self, phase: &'p str) -> BestOf<'p> {
        if self.last_phase { BestOf::LastPhase } else { BestOf::Earlier(phase) }
    }

    /// A record of this moment with the physical parameters.
    pub(super) fn record(&self, kind: RecordKind, phase: &str) -> Record {
        let parameters = self.model.parameter_values().into_iter().map(|(name, value)| (name.to_string(), value));
        Record {
            seconds: Some(self.elapsed()),
            parameters: parameters.collect(),
            ..Record::new(kind, phase, self.state.steps)
        }
    }

    /// Tells of an early fit: a line on it, and the parameters that it gave the model.
    pub(super) fn tell_fit(&mut self, phase: &str, line: &str) -> Result<()> {
        self.tell(&TrainingEvent::Note(line))?;
        self.tell(&TrainingEvent::Recorded { record: &self.record(RecordKind::Identify, phase), model: self.model })
    }

    fn record_step(&mut self, phase: &str, value: f64, loss: &StepLoss) -> Result<()> {
        let record = Record {
            train_loss: Some(value),
            recons_loss: loss.reconstruction.as_ref().map(|loss| loss.double_value(&[])),
            pred_loss: loss.prediction.as_ref().map(|loss| loss.double_value(&[])),
            ..self.record(RecordKind::Train, phase)
        };
        self.tell(&TrainingEvent::Recorded { record: &record, model: self.model })
    }

    /// Scores the model on the validation split; keeps the weights of the last phase's best score. Where the score is not a
    /// number, says so and records nothing.
    fn validate(&mut self, phase: &str, objective: &mut dyn Objective<M>) -> Result<Option<String>> {
        let Validation { clips, pass, batch } = self.validation;
        let losses = || self.model.mean_losses(self.valid, clips, pass);
        let Validated { score, recons_loss, pred_loss, extrap_loss } = objective.validate(self.model, &losses)?;
        if !score.is_finite() {
            return Ok(Some("the validation score is not finite".into()));
        }
        let record = Record {
            epoch: Some(self.state.steps / steps_per_epoch(self.train.len(), batch)),
            score: Some(score),
            recons_loss,
            pred_loss,
            extrap_loss,
            ..self.record(RecordKind::Valid, phase)
        };
        self.tell(&TrainingEvent::Recorded { record: &record, model: self.model })?;
        self.state.validations.push(score);
        // Before the weights are kept: a return to them is not to lose what was fitted to them.
        if let Some(fitted) = objective.after_validation(self.model, &self.state.validations)? {
            self.tell_fit(phase, &fitted)?;
        }
        let first = objective.timetable().first_counted(&self.state.validations);
        let (last, before) = self.state.validations[first..].split_last().expect("the score that was just added");
        let best = before.iter().all(|before| last < before);
        if best && (self.last_phase || objective.ends_at_best()) {
            match &self.store {
                Some(store) => {
                    store.save_best(&self.model.named_variables(), self.state.steps, self.best_of(phase))?;
                }
                None => {
                    let weights = self.model.named_variables().into_iter();
                    self.best = Some(weights.map(|(name, weight)| (name, weight.detach().copy())).collect());
                }
            }
        }
        Ok(None)
    }
}

/// Says which tensor first went wrong.
fn not_finite(loss: &StepLoss, variables: &[(String, Tensor)]) -> String {
    let parts = [("recons_loss", loss.reconstruction.as_ref()), ("pred_loss", loss.prediction.as_ref())];
    let part = parts.into_iter().find(|(_, part)| part.is_some_and(|part| !is_finite(part)));
    let culprit = match (first_not_finite(variables), part) {
        (Some(name), _) => format!("variable {name}"),
        (None, Some((name, _))) => name.to_string(),
        (None, None) => "the total loss".to_string(),
    };
    format!("{culprit} is not finite")
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::path::Path;

    use anyhow::ensure;
    use ndarray::Array5;

    use super::*;
    use crate::network::physics_models::losses::MeanLosses;
    use crate::network::physics_models::{ModelOptions, VariableGroup};
    use crate::tasks;
    use crate::training::schedule::{LrSchedule, Timetable};

    const VALIDATE_EVERY: u64 = 2;
    const STEPS: u64 = 6;
    const RATE: f64 = 0.125;
    /// Of validations before the first step and after every second one: the second is the best, the last the worst.
    const WORSE: [f64; 4] = [3.0, 1.0, 2.0, 4.0];

    /// What a scripted step is like.
    #[derive(Debug, Clone, Copy, PartialEq)]
    enum ScriptedFault {
        Loss,
        /// The loss is 0.
        Gradient,
    }

    /// A loss with gradient 1 for each physical parameter, and validations with given scores.
    struct Scripted {
        timetable: Timetable,
        scores: &'static [f64],
        validated: Cell<usize>,
        /// The step that is not finite, and how.
        wrong: Option<(u64, ScriptedFault)>,
        step: u64,
        ends_at_best: bool,
    }

    impl Scripted {
        fn new(scores: &'static [f64], wrong: Option<(u64, ScriptedFault)>) -> Self {
            let schedule = LrSchedule {
                validate_every: VALIDATE_EVERY,
                anneal_at: 1.0,
                anneal_factor: 1.0,
                anneal_gradually: false,
                plateau: 0.0,
                patience: 0,
                end_without_gain: false,
            };
            let timetable = Timetable::new(schedule, STEPS, 1);
            Scripted { timetable, scores, validated: Cell::new(0), wrong, step: 0, ends_at_best: true }
        }
    }

    impl Objective for Scripted {
        fn timetable(&self) -> &Timetable {
            &self.timetable
        }

        fn inputs(&mut self, _model: &PhysicsNet, step: u64, _validations: &[f64]) -> Result<Vec<Tensor>> {
            self.step = step;
            Ok(Vec::new())
        }

        fn loss(&self, model: &PhysicsNet, _inputs: &[Tensor]) -> Result<StepLoss> {
            let sum = model
                .learned()
                .map(|it| it.unconstrained.shallow_clone())
                .reduce(|sum, unconstrained| sum + unconstrained)
                .unwrap();
            let total = match self.wrong.filter(|(step, _)| *step == self.step) {
                None => sum,
                Some((_, ScriptedFault::Loss)) => sum * f64::NAN,
                // The square root has no derivative at 0.
                Some((_, ScriptedFault::Gradient)) => (&sum - sum.detach()).square().sqrt(),
            };
            Ok(StepLoss { total, reconstruction: None, prediction: None })
        }

        fn learning_rate(&self, _group: VariableGroup) -> f64 {
            RATE
        }

        fn ends_at_best(&self) -> bool {
            self.ends_at_best
        }

        fn validate(&self, _model: &PhysicsNet, _losses: &dyn Fn() -> Result<MeanLosses>) -> Result<Validated> {
            let score = self.scores[self.validated.get()];
            self.validated.set(self.validated.get() + 1);
            Ok(Validated { score, recons_loss: None, pred_loss: None, extrap_loss: None })
        }
    }

    /// Keeps notes and losses; fails at a step, as a process that is killed there.
    #[derive(Default)]
    struct NotingObserver {
        notes: Vec<String>,
        losses: Vec<f64>,
        killed_at: Option<u64>,
    }

    impl TrainingObserver for NotingObserver {
        fn observe(&mut self, event: &TrainingEvent) -> Result<()> {
            match event {
                TrainingEvent::Note(note) => self.notes.push((*note).to_string()),
                TrainingEvent::Step { loss, .. } => {
                    self.losses.push(*loss);
                    ensure!(self.killed_at != Some(self.losses.len() as u64), "killed");
                }
                _ => {}
            }
            Ok(())
        }
    }

    fn model() -> PhysicsNet {
        let system = tasks::builtin("spring_color").unwrap().system;
        PhysicsNet::new(&system, &ModelOptions::original(), Device::Cpu, 1).unwrap()
    }

    /// Raw physical parameters.
    fn unconstrained(model: &PhysicsNet) -> Vec<f64> {
        model.learned().map(|parameter| parameter.unconstrained.double_value(&[])).collect()
    }

    /// Trains a model by a script, with a store in `folder` if there is one, from its last checkpoint on.
    fn trained(
        model: &PhysicsNet,
        script: &mut Scripted,
        folder: Option<&Path>,
        watch: &mut NotingObserver,
    ) -> Result<TrainingOutcome> {
        let clips = Clips::new(&Array5::zeros([2, 12, 32, 32, 3]), None, Device::Cpu);
        let mut session = Session {
            model,
            train: &clips,
            valid: &clips,
            seed: 0,
            validation: Validation { clips: 2, pass: 2, batch: 2 },
            intervals: Intervals { print: STEPS, checkpoint: 1 },
            last_phase: true,
            begun: unconstrained(model),
            best: None,
            motion: OnceCell::new(),
            state: RunState::new("spring_color"),
            store: folder.map(Store::new),
            observers: vec![watch],
            stop: Box::new(|| false),
            slots: None,
            clock: Instant::now(),
        };
        session.load_last()?;
        script.validated.set(session.state.validations.len());
        session.train_phase("join", script, OptimizerKind::Sgd, 0.0)
    }

    /// Raw parameters after so many steps, exactly: the rate is a power of two, and the steps are few.
    fn after(begun: &[f64], steps: u64) -> Vec<f64> {
        let step = |unconstrained: &f64| {
            (0..steps).fold(*unconstrained as f32, |unconstrained, _| unconstrained - RATE as f32)
        };
        begun.iter().map(|unconstrained| f64::from(step(unconstrained))).collect()
    }

    #[test]
    fn weights_of_the_best_validation_return_after_worse_ones() {
        let folder = tempfile::tempdir().unwrap();
        for folder in [None, Some(folder.path())] {
            let (model, mut watch) = (model(), NotingObserver::default());
            let begun = unconstrained(&model);
            let outcome = trained(&model, &mut Scripted::new(&WORSE, None), folder, &mut watch).unwrap();
            assert_eq!((outcome, watch.losses.len()), (TrainingOutcome::Finished, STEPS as usize));
            assert_eq!(watch.notes, ["join - back to its step 2, the best by validation"]);
            assert_eq!(unconstrained(&model), after(&begun, 2));
        }
    }

    #[test]
    fn the_last_weights_stay_where_they_are_the_best() {
        let (model, mut watch) = (model(), NotingObserver::default());
        let begun = unconstrained(&model);
        trained(&model, &mut Scripted::new(&[4.0, 2.0, 3.0, 1.0], None), None, &mut watch).unwrap();
        assert_eq!((watch.notes, unconstrained(&model)), (Vec::<String>::new(), after(&begun, STEPS)));
    }

    /// Killed after each of its steps in turn, and resumed.
    #[test]
    fn killed_runs_return_to_the_same_weights() {
        for wrong in [None, Some((4, ScriptedFault::Loss)), Some((4, ScriptedFault::Gradient))] {
            let whole = model();
            let begun = unconstrained(&whole);
            let mut watch = NotingObserver::default();
            trained(&whole, &mut Scripted::new(&WORSE, wrong), None, &mut watch).unwrap();
            let steps = watch.losses.len() as u64;
            for killed_at in 1..=steps {
                let folder = tempfile::tempdir().unwrap();
                let mut killed = NotingObserver { killed_at: Some(killed_at), ..NotingObserver::default() };
                let error = trained(&model(), &mut Scripted::new(&WORSE, wrong), Some(folder.path()), &mut killed);
                assert_eq!(error.unwrap_err().to_string(), "killed");
                let (resumed, mut rest) = (model(), NotingObserver::default());
                trained(&resumed, &mut Scripted::new(&WORSE, wrong), Some(folder.path()), &mut rest).unwrap();
                // The step in which it was killed is taken again.
                assert_eq!(rest.losses.len() as u64, steps + 1 - killed_at, "{wrong:?}, killed at {killed_at}");
                assert_eq!(rest.notes, watch.notes);
                assert_eq!(unconstrained(&resumed), unconstrained(&whole));
            }
            assert_eq!(unconstrained(&whole), after(&begun, 2), "{wrong:?}");
        }
    }

    #[test]
    fn a_loss_that_is_not_finite_ends_at_the_best_weights() {
        let (model, mut watch) = (model(), NotingObserver::default());
        let begun = unconstrained(&model);
        let mut script = Scripted::new(&WORSE, Some((4, ScriptedFault::Loss)));
        trained(&model, &mut script, None, &mut watch).unwrap();
        let expected = "join - the total loss is not finite at step 5: back to its step 2, the best by validation";
        assert_eq!(watch.notes, [expected]);
        assert_eq!((watch.losses.len(), unconstrained(&model)), (4, after(&begun, 2)));
    }

    /// Before anything is saved or validated.
    #[test]
    fn a_gradient_that_is_not_finite_shows_in_the_weights() {
        let (model, mut watch) = (model(), NotingObserver::default());
        let begun = unconstrained(&model);
        let mut script = Scripted::new(&WORSE, Some((4, ScriptedFault::Gradient)));
        trained(&model, &mut script, None, &mut watch).unwrap();
        let [note] = &watch.notes[..] else { panic!("{:?}", watch.notes) };
        assert!(note.starts_with("join - variable spring_ode_cell.log_k is not finite after step 5: "), "{note}");
        assert!(note.ends_with("back to its step 2, the best by validation"), "{note}");
        // The loss of the step itself was 0.
        assert_eq!((watch.losses[4], unconstrained(&model)), (0.0, after(&begun, 2)));
    }

    #[test]
    fn what_is_not_finite_is_an_error_where_the_last_weights_count() {
        for (wrong, words) in
            [(ScriptedFault::Loss, "is not finite at step 5"), (ScriptedFault::Gradient, "is not finite after step 5")]
        {
            let mut script = Scripted { ends_at_best: false, ..Scripted::new(&WORSE, Some((4, wrong))) };
            let error = trained(&model(), &mut script, None, &mut NotingObserver::default()).unwrap_err().to_string();
            assert!(error.starts_with("join: ") && error.contains(words), "{error}");
            assert!(error.contains("lower learning rate"), "{error}");
        }
    }
}
