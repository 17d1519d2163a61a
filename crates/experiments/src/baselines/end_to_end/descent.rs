//! An end-to-end baseline in the training loop that trains the physics: its one phase, and the loss that it descends.

use anyhow::Result;
use tch::{Device, Tensor};

use super::config::EndToEndConfig;
use super::data::EndToEndData;
use super::frame_model::{self, Batch, FrameModel, prediction_error};
use super::gaussian::normal_numbers;
use paig::datasets::iterators::{Clips, ShuffledBatches};
use paig::network::System;
use paig::network::physics_models::losses::MeanLosses;
use paig::runs::weights::NamedTensors;
use paig::training::objective::{Objective, StepLoss, Validated};
use paig::training::schedule::{LrSchedule, Timetable};
use paig::training::trained::Trainable;
use paig_kernels::Kernels;

/// The name of the phase.
pub(super) const PHASE: &str = "train";
/// Share of the steps after which the rate is divided by this.
const ANNEAL_AT: f64 = 0.75;
const ANNEAL_FACTOR: f64 = 5.0;

/// A model of a system, as the loop sees it.
#[derive(Clone, Copy)]
pub(super) struct Trainee<'a> {
    pub model: &'a dyn FrameModel,
    pub system: &'a System,
    pub kernels: Kernels,
}

impl Trainable for Trainee<'_> {
    type Group = ();

    fn named_variables(&self) -> NamedTensors {
        frame_model::named_variables(self.model)
    }

    fn device(&self) -> Device {
        self.model.variables().device()
    }

    fn kernels(&self) -> Kernels {
        self.kernels
    }

    fn group(&self, _name: &str) {}

    /// The error of all frames after the input; nothing is reconstructed.
    fn mean_losses(&self, clips: &Clips, count: usize, _pass: usize) -> Result<MeanLosses> {
        let pred_loss = prediction_error(self.model, self.system, clips, count)?;
        Ok(MeanLosses { recons_loss: f64::NAN, pred_loss, extrap_loss: None })
    }
}

/// The state of the phase between steps.
pub(super) struct Descent<'a> {
    config: &'a EndToEndConfig,
    data: EndToEndData<'a>,
    batches: ShuffledBatches,
    timetable: Timetable,
    /// The batch of the step at hand.
    batch: Option<Batch>,
}

impl<'a> Descent<'a> {
    /// # Errors
    /// No training clips.
    pub(super) fn new(config: &'a EndToEndConfig, data: EndToEndData<'a>) -> Result<Self> {
        let schedule = LrSchedule {
            validate_every: config.checkpoint_every,
            anneal_at: ANNEAL_AT,
            anneal_factor: ANNEAL_FACTOR,
            anneal_gradually: false,
            plateau: 0.0,
            patience: 0,
            end_without_gain: false,
        };
        let anneal_from = (ANNEAL_AT * config.steps as f64).ceil() as u64;
        Ok(Descent {
            config,
            data,
            batches: ShuffledBatches::new(data.train.len(), config.batch, config.seed)?,
            timetable: Timetable::new(schedule, config.steps, 1).annealed_from(anneal_from),
            batch: None,
        })
    }
}

impl Objective<Trainee<'_>> for Descent<'_> {
    fn timetable(&self) -> &Timetable {
        &self.timetable
    }

    /// Frames, and what acts, what they are worth and random numbers where the model takes them.
    fn inputs(&mut self, trainee: &Trainee, step: u64, _validations: &[f64]) -> Result<Vec<Tensor>> {
        let chosen = self.batches.clips_of_step(step);
        let draws = trainee.model.draws(chosen.len(), self.data.train.time());
        let noise = (draws > 0).then(|| normal_numbers(self.config.seed, step, draws));
        let batch = self.data.batch(chosen, noise);
        let parts = batch.parts();
        self.batch = Some(batch);
        Ok(parts)
    }

    fn loss(&self, trainee: &Trainee, inputs: &[Tensor]) -> Result<StepLoss> {
        let batch = self.batch.as_ref().expect("inputs come first");
        Ok(StepLoss { total: trainee.model.loss(&batch.with(inputs)), reconstruction: None, prediction: None })
    }

    fn learning_rate(&self, (): ()) -> f64 {
        self.config.learning_rate
    }

    fn ends_at_best(&self) -> bool {
        true
    }

    fn validate(&self, _trainee: &Trainee, losses: &dyn Fn() -> Result<MeanLosses>) -> Result<Validated> {
        let error = losses()?.pred_loss;
        Ok(Validated { score: error, recons_loss: None, pred_loss: Some(error), extrap_loss: None })
    }
}
