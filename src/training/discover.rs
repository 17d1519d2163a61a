//! Phase 1, discover: find the objects with the autoencoder alone, on random single frames.
//!
//! Frames of one clip look alike, so random frames of all clips tell more per step; physics is not trained before its
//! objects exist (trained too early it drives its forces to zero). Not in the original.

use anyhow::Result;
use tch::{Kind, Tensor};

use super::anchors::Anchors;
use super::guide;
use super::phases::{GradientPhase, StepLoss};
use super::schedule::Timetable;
use crate::datasets::iterators::Clips;
use crate::network::physics_models::PhysicsNet;
use crate::network::physics_models::losses::{MeanLosses, RunningMean, frame_error};
use crate::training::config::{Discover, DiscoverStart};

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

/// The phase's state between steps.
#[derive(Debug)]
pub struct Discovery<'a> {
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
    pub fn new(config: &'a Discover, model: &PhysicsNet, train: &'a Clips, valid: &Clips, seed: u64) -> Self {
        let device = model.variables.device();
        let side = model.task.side as i64;
        // Pixel i is drawn at position i + 1/2 by an exact decoder, and at i S/(S-1) by the original's.
        let index = Tensor::arange(side, (Kind::Float, device));
        let pixel_centres = if model.options.exact_shift { index + 0.5 } else { index / model.pixels_per_unit() };
        let median = train.median_frame(MEDIAN_FRAMES, seed);
        let frames = train.random_frames(ANCHOR_FRAMES, seed, 0);
        let moving = guide::moving(&frames, &median, config.guide.temperature);
        let anchors = (config.guide.colour > 0.0)
            .then(|| Anchors::find(&frames, &median, &moving, model.task.objects, seed))
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

impl GradientPhase for Discovery<'_> {
    fn name(&self) -> &'static str {
        "discover"
    }

    fn begin(&mut self, model: &PhysicsNet) -> Result<()> {
        self.set_start(model);
        Ok(())
    }

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
            let claims = self.anchors.as_ref().map(|anchors| anchors.claims(&frames, &self.median));
            let guides = guide::loss(&self.config.guide, &encoding, &moving, claims.as_ref(), &self.pixel_centres);
            total += guides * fade;
        }
        Ok(StepLoss { total, parts: vec![("recons_loss", reconstruction)] })
    }

    fn learning_rate(&self, _variable: &str) -> f64 {
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
