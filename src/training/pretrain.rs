//! Phase 2 where a black box is in the place of the physics: it learns to carry encoded positions on, without images.
//!
//! What `identify` is to the physics. Encoder and decoder stay as they are; then `join` trains everything together. Not in
//! the original, which has no black boxes.

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};
use tch::{Kind, Tensor};

use super::base::{Session, TrainingOutcome};
use super::objective::{Objective, StepLoss, Validated};
use super::optimizers::OptimizerKind;
use super::phase::Phase;
use super::ranges::{at_least_one, countable, not_negative};
use super::schedule::{LrSchedule, Timetable};
use crate::datasets::iterators::{Clips, ShuffledBatches};
use crate::network::cells::{Actions, State};
use crate::network::physics_models::losses::{MeanLosses, latent_error};
use crate::network::physics_models::{PhysicsNet, VariableGroup};

/// Validation clips on which the positions are scored, at most.
const SCORED_CLIPS: usize = 200;

/// The phase's config.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pretrain {
    pub optimizer: OptimizerKind,
    pub learning_rate: f64,
    /// Limit of a gradient's elements; 0 is none.
    pub clip_gradients: f64,
    /// Clips in a step.
    pub batch: usize,
    pub max_steps: u64,
    pub schedule: LrSchedule,
}

impl Pretrain {
    pub(super) fn check(&self) -> Result<()> {
        countable("pretrain.max_steps", self.max_steps)?;
        at_least_one("pretrain.batch", self.batch as u64)?;
        not_negative("pretrain.learning_rate", self.learning_rate)?;
        not_negative("pretrain.clip_gradients", self.clip_gradients)?;
        self.schedule.check().context("config: pretrain.schedule")
    }
}

impl Phase for Pretrain {
    fn name(&self) -> &'static str {
        "pretrain"
    }

    fn run(&self, session: &mut Session) -> Result<TrainingOutcome> {
        let (model, batch) = (session.model, session.validation.pass);
        let train = Paths::encoded(model, session.train, session.train.len(), batch)?;
        let valid = Paths::encoded(model, session.valid, SCORED_CLIPS, batch)?;
        let mut imitation = Imitation {
            config: self,
            timetable: Timetable::new(self.schedule.clone(), self.max_steps, 1),
            batches: ShuffledBatches::new(session.train.len(), self.batch, session.seed)?,
            train,
            valid,
        };
        session.train_phase(self.name(), &mut imitation, self.optimizer, self.clip_gradients)
    }
}

/// Where the objects of some clips are seen, and what acts on them.
#[derive(Debug)]
struct Paths {
    /// `[clips, time, coordinates * objects]`.
    positions: Tensor,
    actions: Actions,
}

impl Paths {
    /// Of the first `count` clips, `batch` at a time.
    fn encoded(model: &PhysicsNet, clips: &Clips, count: usize, batch: usize) -> Result<Self> {
        let _guard = tch::no_grad_guard();
        ensure!(!clips.is_empty(), "pretrain: there are no clips");
        let chosen: Vec<i64> = (0..clips.len().min(count) as i64).collect();
        let input = model.system.input_steps;
        let encoded = |chosen: &[i64]| model.named(&model.encode(&clips.batch(chosen, clips.time())).1, input);
        let positions: Vec<_> = chosen.chunks(batch).map(encoded).collect();
        Ok(Paths { positions: Tensor::cat(&positions, 0), actions: clips.actions(&chosen) })
    }

    /// Positions rolled out from the input that begins at a frame to the end of the clips, and those that are seen there.
    fn rolled_out(&self, model: &PhysicsNet, start: usize) -> (Tensor, Tensor) {
        let input = model.system.input_steps as i64;
        let positions = self.positions.slice(1, start as i64, None, 1);
        let seen = positions.slice(1, input, None, 1);
        let frames = seen.size()[1] as usize;
        let (_, states) = model.roll_out(&positions.narrow(1, 0, input), &self.actions.since(start), frames);
        (State::positions(&states), seen)
    }
}

/// The phase's state between steps.
#[derive(Debug)]
struct Imitation<'a> {
    config: &'a Pretrain,
    timetable: Timetable,
    batches: ShuffledBatches,
    train: Paths,
    valid: Paths,
}

impl Objective for Imitation<'_> {
    fn timetable(&self) -> &Timetable {
        &self.timetable
    }

    /// Positions and what acts, from each frame in turn on after which L + T_pred frames are left.
    fn inputs(&mut self, model: &PhysicsNet, step: u64, _validations: &[f64]) -> Result<Vec<Tensor>> {
        let Paths { positions, actions } = &self.train;
        let chosen = Tensor::from_slice(self.batches.clips_of_step(step)).to_device(positions.device());
        let used = model.system.input_steps + model.system.pred_steps;
        let starts = positions.size()[1] as u64 - used as u64 + 1;
        let start = (step % starts) as usize;
        let positions = positions.index_select(0, &chosen).slice(1, start as i64, None, 1);
        Ok(std::iter::once(positions).chain(actions.of(&chosen).since(start).into_values()).collect())
    }

    fn loss(&self, model: &PhysicsNet, inputs: &[Tensor]) -> Result<StepLoss> {
        let actions = Actions::new(inputs.get(1).map(Tensor::shallow_clone));
        let (rolled, seen) = Paths { positions: inputs[0].shallow_clone(), actions }.rolled_out(model, 0);
        Ok(StepLoss { total: latent_error(&rolled, &seen), reconstruction: None, prediction: None })
    }

    fn learning_rate(&self, _group: VariableGroup) -> f64 {
        self.config.learning_rate
    }

    /// Root mean square of the rolled-out positions' errors on validation clips, in a coordinate's unit.
    fn validate(&self, model: &PhysicsNet, losses: &dyn Fn() -> Result<MeanLosses>) -> Result<Validated> {
        let _guard = tch::no_grad_guard();
        let (rolled, seen) = self.valid.rolled_out(model, 0);
        let error = (rolled - seen).square().mean(Kind::Double).sqrt().double_value(&[]);
        Ok(Validated::new(error, &losses()?))
    }
}
