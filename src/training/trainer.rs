//! Takes a model through the phases of a config.

use std::f32::consts::PI;

use anyhow::{Context, Result, ensure};
use rand::Rng;
use tch::{Device, Tensor};

use super::base::{Intervals, Session, TrainingOutcome, Validation};
use super::config::Config;
use super::observer::TrainingObserver;
use crate::datasets::iterators::Clips;
use crate::network::cells::{Actions, Coordinates, State};
use crate::network::physics_models::PhysicsNet;
use crate::runs::checkpoint::{DataChecksums, RunState, Store};
use crate::support::random::named_generator;
use paig_kernels::{Flushing, Kernels, KernelsAlone, own_stream};

/// Clips that a GPU sees at a time where nothing is learned from them: fewer take it as long.
const PASS_ON_GPU: usize = 100;
/// Where nobody says which commit trains.
const UNKNOWN_COMMIT: &str = "unknown";
/// States of rest from which a motion is tried before a training. From some of them an equation may lead anywhere: two bodies
/// that lie on each other.
const RESTS: usize = 16;

/// A training by a config.
#[derive(Debug)]
pub struct Trainer<'a> {
    config: &'a Config,
    session: Session<'a>,
    data: DataChecksums,
    /// Of the program that trains.
    commit: String,
}

impl<'a> Trainer<'a> {
    /// A training that starts from the beginning, of a model with the config's options.
    ///
    /// # Errors
    /// A parameter in `start` that the model lacks, or a value that it cannot have.
    pub fn new(config: &'a Config, model: &'a PhysicsNet, train: &'a Clips, valid: &'a Clips) -> Result<Self> {
        for (symbol, value) in &config.start {
            let parameter = model.learned().find(|p| p.kind.name == *symbol);
            let parameter = parameter.with_context(|| format!("start.{symbol}: the model learns no such parameter"))?;
            model.set_value(parameter, *value).with_context(|| format!("start.{symbol}"))?;
        }
        let batch = config.join.batch;
        let pass = if model.variables.device() == Device::Cpu { batch } else { batch.max(PASS_ON_GPU) };
        let validation = Validation { clips: config.join.validation_clips, pass, batch };
        let intervals = Intervals { print: config.output.print_every, checkpoint: config.output.checkpoint_every };
        let mut session = Session::new(model, &config.task.name, [train, valid], config.seed, validation, intervals);
        session.begun = model.parameters.iter().map(|parameter| parameter.unconstrained.double_value(&[])).collect();
        Ok(Trainer { config, session, data: DataChecksums::default(), commit: UNKNOWN_COMMIT.into() })
    }

    /// Sets the checksums of clips and film: a run that was begun with others does not resume.
    pub fn of_data(mut self, checksums: &DataChecksums) -> Self {
        self.data = checksums.clone();
        self
    }

    /// The commit of the program that trains; the checkpoint keeps it.
    pub fn built_from(mut self, commit: &str) -> Self {
        self.commit = commit.into();
        self
    }

    /// Saves checkpoints there, and goes on from the last one if there is any.
    pub fn save_to(mut self, store: Store) -> Self {
        self.session.save_to(store);
        self
    }

    /// Tells this observer what happens, after those that were named before.
    pub fn observed_by(mut self, observer: &'a mut dyn TrainingObserver) -> Self {
        self.session.observed_by(observer);
        self
    }

    /// Stops after the step in which this says so.
    pub fn stop_when(mut self, stop: impl Fn() -> bool + 'a) -> Self {
        self.session.stop_when(stop);
        self
    }

    /// Where the training stands.
    pub fn state(&self) -> &RunState {
        &self.session.state
    }

    /// Refuses parameters with which no motion is a number, wherever it begins: `discover` would not notice for a whole phase.
    ///
    /// # Errors
    /// What `start` or `model.fixed` say is too large for the equation.
    pub fn check_start(&self) -> Result<()> {
        let given: Vec<_> = self.config.start.iter().chain(&self.config.model.fixed).collect();
        let finite = self.moves_finitely();
        let given: Vec<_> = given.iter().map(|(name, value)| format!("{name} = {value:?}")).collect();
        let given = if given.is_empty() { "the equation as it begins".into() } else { given.join(", ") };
        ensure!(
            finite,
            "with {given} no motion stays finite, wherever it begins; choose other values (start, model.fixed)"
        );
        Ok(())
    }

    /// Whether the equation leads from rest anywhere in the frame, or at any angle, to finite places over a training clip.
    fn moves_finitely(&self) -> bool {
        let _guard = tch::no_grad_guard();
        let PhysicsNet { system, cell, variables, .. } = self.session.model;
        let (low, high) = match system.cell.coordinates {
            Coordinates::Position => (0.0, system.side as f32),
            Coordinates::Angle => (-PI, PI),
        };
        let mut random = named_generator(self.session.seed, "states of rest");
        let numbers = system.objects * system.cell.coordinates.per_object();
        let places: Vec<f32> = (0..RESTS * numbers).map(|_| random.random_range(low..high)).collect();
        let pos = Tensor::from_slice(&places).reshape([RESTS as i64, -1]).to_device(variables.device());
        let first = State { vel: pos.zeros_like(), pos };
        let rolled_out = cell.roll_out(&first, &Actions::none(), system.dt, system.input_steps + system.pred_steps);
        let last = rolled_out.last().unwrap_or(&first);
        last.pos.isfinite().all_dim(1, false).any().int64_value(&[]) == 1
    }

    /// Goes through the phases that are left, from the last checkpoint if there is one.
    ///
    /// # Errors
    /// A loss that is not a number, a full disk, a damaged checkpoint, or one of a training on other clips.
    pub fn run(&mut self) -> Result<TrainingOutcome> {
        let _flushing = Flushing::begin();
        let model = self.session.model;
        own_stream(model.variables.device())?;
        let own = model.options.kernels == Kernels::Own && model.variables.device() == Device::Cpu;
        let _alone = own.then(KernelsAlone::begin);
        self.session.resume(&self.data)?;
        if self.session.state.steps == 0 {
            self.check_start()?;
        }
        let session = &mut self.session;
        let phases = self.config.phases();
        for phase in phases.iter().skip(session.state.phase) {
            if session.state.commits.last().is_none_or(|last| *last != self.commit) {
                session.state.commits.push(self.commit.clone());
            }
            session.last_phase = session.state.phase + 1 == phases.len();
            if phase.run(session)? == TrainingOutcome::Interrupted {
                return Ok(TrainingOutcome::Interrupted);
            }
            // What earlier phases took is known; the rest, stops and all, is this one's.
            let earlier: f64 = session.state.phase_seconds.iter().map(|(_, seconds)| seconds).sum();
            session.state.phase_seconds.push((phase.name().into(), session.elapsed() - earlier));
            session.state.phase += 1;
            session.state.step = 0;
            session.state.validations.clear();
            session.save(&[])?;
        }
        Ok(TrainingOutcome::Finished)
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array5;

    use super::*;
    use crate::tasks::Task;
    use crate::training::layers::Overrides;

    /// A medium in whose middle, of such a radius in pixels, no force is a number.
    fn with_a_hole(radius: f64) -> Config {
        let block = include_str!("../../configs/gallery/sliding_block.toml");
        let text = block.replace("tanh(norm(v) / slow) * unit(v)", "sqrt(norm(p - vec(16, 16)) / hole - 1) * unit(v)");
        let text = text.replace(
            "slow = { unit = [1, -1], fixed = 0.05 }",
            &format!("hole = {{ unit = [1, 0], fixed = {radius:?} }}"),
        );
        Config::load_task(Task::from_toml(&text).unwrap(), None, &Overrides::default()).unwrap()
    }

    /// An untrained encoder sees its object anywhere; that it is where the equation has no numbers says nothing.
    #[test]
    fn an_equation_is_not_tried_where_an_untrained_encoder_sees_its_object() {
        let clips = Clips::new(&Array5::zeros([2, 12, 32, 32, 1]), None, Device::Cpu);
        let refused = |radius: f64| {
            let config = with_a_hole(radius);
            let model = PhysicsNet::new(&config.task.system, &config.model, Device::Cpu, 1).unwrap();
            let pass = tch::no_grad(|| model.forward(&clips.batch(&[0, 1], 10), &Actions::none()).unwrap());
            let last = pass.states.last().unwrap();
            assert_eq!(last.pos.isfinite().any().int64_value(&[]), 0, "the encoder sees no hole of {radius} pixels");
            Trainer::new(&config, &model, &clips, &clips).unwrap().check_start().is_err()
        };
        // The frame's corners are 22.6 pixels from its middle.
        assert!(!refused(12.0) && refused(23.0));
    }
}
