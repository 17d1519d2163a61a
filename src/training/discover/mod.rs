//! Phase 1, discover: find the objects with the autoencoder alone, on random single frames.
//!
//! Frames of one clip look alike, so random frames of all clips tell more per step; physics is not trained before its
//! objects exist (trained too early it drives its forces to zero). Not in the original.

mod anchors;
mod guide;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use tch::{Kind, Tensor};

use self::anchors::Anchors;
pub use self::guide::Guide;
use super::base::{Outcome, Session};
use super::objective::{Objective, StepLoss};
use super::optimizers::OptimizerKind;
use super::phase::Phase;
use super::ranges::{at_least_one, not_negative};
use super::schedule::{LrSchedule, Timetable};
use crate::datasets::iterators::Clips;
use crate::network::physics_models::losses::{MeanLosses, RunningMean, frame_error};
use crate::network::physics_models::{PhysicsNet, VariableGroup};

/// Frames from which the median is taken, and on which a validation is made.
const MEDIAN_FRAMES: usize = 2000;
const VALIDATION_FRAMES: usize = 500;
/// Frames whose moving pixels are grouped by colour.
const ANCHOR_FRAMES: usize = 200;
/// Frames in one validation batch.
const VALIDATION_BATCH: i64 = 250;
/// Width of a template's initial bump, in half windows.
const BUMP_WIDTH: f64 = 0.3;
/// The median background's share of its network's initial kernel, and the margin kept from 0 and 1 under the logit.
const BACKGROUND_KERNEL: f64 = 0.1;
const LOGIT_MARGIN: f64 = 0.002;

/// The phase's config.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Discover {
    pub optimizer: OptimizerKind,
    pub learning_rate: f64,
    /// Limit of a gradient's elements; 0 is none.
    pub clip_gradients: f64,
    /// Frames in a step.
    pub frames: usize,
    pub max_steps: u64,
    pub schedule: LrSchedule,
    pub start: DiscoverStart,
    pub guide: Guide,
}

/// Initial values that let every object be found. 0 or false switches one off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DiscoverStart {
    /// The background begins as the median frame.
    pub median_background: bool,
    /// A template begins as a bump of +- this at its window's centre.
    pub template_bump: f64,
    /// The output layer of the localisation network is multiplied by this.
    pub localiser_scale: f64,
    /// Spread of the objects' mask logits on what moves, after centring.
    pub mask_spread: f64,
}

impl Discover {
    pub(super) fn check(&self) -> Result<()> {
        at_least_one("discover.frames", self.frames as u64)?;
        for (key, number) in [
            ("discover.learning_rate", self.learning_rate),
            ("discover.clip_gradients", self.clip_gradients),
            ("discover.start.template_bump", self.start.template_bump),
            ("discover.start.localiser_scale", self.start.localiser_scale),
            ("discover.start.mask_spread", self.start.mask_spread),
        ] {
            not_negative(key, number)?;
        }
        self.guide.check()?;
        self.schedule.check().context("config: discover.schedule")
    }
}

impl Phase for Discover {
    fn name(&self) -> &'static str {
        "discover"
    }

    fn run(&self, session: &mut Session) -> Result<Outcome> {
        let (model, seed) = (session.model, session.seed);
        let mut discovery = Discovery::new(self, model, session.train, session.valid, seed);
        if session.state.step == 0 {
            discovery.set_start(model);
        }
        session.train_phase(self.name(), &mut discovery, self.optimizer, self.clip_gradients)
    }
}

/// The phase's state between steps.
#[derive(Debug)]
struct Discovery<'a> {
    config: &'a Discover,
    timetable: Timetable<'a>,
    train: &'a Clips,
    seed: u64,
    median: Tensor,
    anchors: Option<Anchors>,
    pixel_centres: Tensor,
    validation: Tensor,
}

impl<'a> Discovery<'a> {
    fn new(config: &'a Discover, model: &PhysicsNet, train: &'a Clips, valid: &Clips, seed: u64) -> Self {
        let device = model.variables.device();
        let side = model.system.side as i64;
        // Pixel i is drawn at position i + 1/2 by an exact decoder, and at i S/(S-1) by the original's.
        let index = Tensor::arange(side, (Kind::Float, device));
        let pixel_centres = if model.options.exact_shift { index + 0.5 } else { index / model.pixels_per_unit() };
        let median = train.median_frame(MEDIAN_FRAMES, seed);
        let frames = train.random_frames(ANCHOR_FRAMES, seed, 0);
        let moving = guide::moving(&frames, &median, config.guide.temperature);
        let anchors = (config.guide.colour > 0.0)
            .then(|| Anchors::find(&frames, &median, &moving, model.system.objects, seed))
            .flatten();
        // Scores under the guides say nothing about the plain loss.
        let guided = config.guide.zero_from.div_ceil(config.schedule.validate_every) as usize;
        Discovery {
            config,
            timetable: Timetable::new(&config.schedule, config.max_steps, 1, guided),
            train,
            seed,
            median,
            anchors,
            pixel_centres,
            validation: valid.random_frames(VALIDATION_FRAMES, seed, u64::MAX),
        }
    }

    /// Sets the initial values from which every object is found.
    fn set_start(&self, model: &PhysicsNet) {
        let _guard = tch::no_grad_guard();
        let DiscoverStart { median_background, template_bump, localiser_scale, mask_spread } = self.config.start;
        if median_background {
            let logit = self.median.clamp(LOGIT_MARGIN, 1.0 - LOGIT_MARGIN).logit(None::<f64>);
            model.decoder.start_background(&logit, BACKGROUND_KERNEL);
        }
        if template_bump != 0.0 {
            model.decoder.start_templates(template_bump, BUMP_WIDTH);
        }
        if localiser_scale != 0.0 {
            model.encoder.scale_localiser(localiser_scale);
        }
        if mask_spread != 0.0 {
            let frames = self.train.random_frames(self.config.frames, self.seed, 0);
            let moving = guide::moving(&frames, &self.median, self.config.guide.temperature);
            model.encoder.spread_masks(&frames, &moving, mask_spread);
        }
    }
}

impl Objective for Discovery<'_> {
    fn timetable(&self) -> &Timetable<'_> {
        &self.timetable
    }

    fn loss(&mut self, model: &PhysicsNet, step: u64) -> Result<StepLoss> {
        let frames = self.train.random_frames(self.config.frames, self.seed, step);
        let encoding = model.encoder.forward(&frames);
        let rendering = model.decoder.forward(&model.coordinates(&encoding));
        let reconstruction = frame_error(&rendering.frames.unsqueeze(1), &frames.unsqueeze(1));
        let fade = guide::fade(&self.config.guide, step);
        let mut total = reconstruction.shallow_clone();
        if fade > 0.0 {
            let moving = guide::moving(&frames, &self.median, self.config.guide.temperature);
            let responsibilities = self.anchors.as_ref().map(|anchors| anchors.responsibilities(&frames, &self.median));
            let guides =
                guide::loss(&self.config.guide, &encoding, &moving, responsibilities.as_ref(), &self.pixel_centres);
            total += guides * fade;
        }
        Ok(StepLoss { total, reconstruction, prediction: None })
    }

    fn learning_rate(&self, _group: VariableGroup) -> f64 {
        self.config.learning_rate
    }

    /// L_rec on frames of the validation split.
    fn score(&self, model: &PhysicsNet, _scores: &MeanLosses) -> f64 {
        let _guard = tch::no_grad_guard();
        let mut mean = RunningMean::default();
        for frames in self.validation.split(VALIDATION_BATCH, 0) {
            let rendering = model.decoder.forward(&model.coordinates(&model.encoder.forward(&frames)));
            mean.add(&frame_error(&rendering.frames.unsqueeze(1), &frames.unsqueeze(1)), frames.size()[0] as f64);
        }
        mean.value()
    }
}
