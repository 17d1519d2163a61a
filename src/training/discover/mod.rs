//! Phase 1, discover: find the objects with the autoencoder alone, on random single frames.
//!
//! Frames of one clip look alike, so random frames of all clips tell more per step; physics is not trained before its
//! objects exist (trained too early it drives its forces to zero). Not in the original.

mod coarse;
mod guide;

use std::path::PathBuf;
use std::rc::Rc;

use anyhow::{Context, Result};
use serde::{Deserialize, Serialize};
use tch::{Kind, Tensor};

pub use self::guide::Guide;
use super::base::{Session, TrainingOutcome};
use super::guide_clock::GuideClock;
use super::identify;
use super::objective::{Objective, StepLoss, Validated};
use super::objects::blobs;
use super::objects::motion::{Foreground, MotionDetector};
use super::objects::names::{self, Names};
use super::objects::pasting;
use super::objects::sprites;
use super::optimizers::OptimizerKind;
use super::phase::Phase;
use super::ranges::{at_least_one, countable, not_negative};
use super::schedule::{LrSchedule, Timetable};
use crate::datasets::iterators::Clips;
use crate::network::System;
use crate::network::cells::Coordinates;
use crate::network::physics_models::losses::{MeanLosses, RunningMean, frame_error};
use crate::network::physics_models::{DecoderKind, Encoding, PhysicsNet, VariableGroup};
use crate::runs::checkpoint::{self, SavedWeights};
use crate::runs::weights;
use crate::support::random::named_generator;

/// Frames on which a validation is made.
const VALIDATION_FRAMES: usize = 500;
/// The rates fall early where no more than this share of what moves is undrawn and L_rec has stopped falling, or where no
/// more than the smaller share is.
const UNDRAWN: [f64; 2] = [0.02, 0.01];
/// Where no more than these shares are for the first time, the equation is fitted: positions are good long before all
/// details are drawn. From the first of them on the objects count as found, and the guides fade.
const UNDRAWN_AT_FIT: [f64; 2] = [0.1, 0.03];
/// So many objects are learned in the config's number of steps; twice as many need twice the steps.
const FEW_OBJECTS: usize = 3;
/// Frames in one validation batch.
const VALIDATION_BATCH: i64 = 250;
/// A sprite's share of its networks' initial kernels.
const SPRITE_KERNEL: f64 = 0.1;
/// Width of a template's initial bump, in half windows.
const BUMP_WIDTH: f64 = 0.3;
/// The median background's share of its network's initial kernel, and the margin kept from 0 and 1 under the logit.
const BACKGROUND_KERNEL: f64 = 0.1;
const LOGIT_MARGIN: f64 = 0.002;

/// The phase's config.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Discover {
    /// Nothing is found anew: encoder and decoder are those of this run. So that models differ in nothing but what comes
    /// after.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub from: Option<PathBuf>,
    pub optimizer: OptimizerKind,
    pub learning_rate: f64,
    /// Limit of a gradient's elements; 0 is none.
    pub clip_gradients: f64,
    /// Frames in a step.
    pub frames: usize,
    pub max_steps: u64,
    /// Steps, at most, on frames of half the side, where frames are large; 0: none.
    #[serde(default)]
    pub coarse_steps: u64,
    /// Steps, at most, on whole frames after those.
    #[serde(default)]
    pub fine_steps: u64,
    /// Whether the phase ends with the weights of its best validation; otherwise with its last ones.
    #[serde(default)]
    pub end_at_best: bool,
    /// Training clips to which the equation is fitted as soon as the objects are drawn well enough for that, and once more
    /// when they are drawn better; with 0 not before `identify`.
    #[serde(default)]
    pub first_fit: usize,
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
    /// Sprites begin as what the blobs look like, where names tell them apart; otherwise as the bump. A config of before
    /// has none of it.
    #[serde(default)]
    pub sprites: bool,
    /// A template begins as a bump of +- this at its window's centre.
    pub template_bump: f64,
    /// The output layer of the localisation network is multiplied by this.
    pub localiser_scale: f64,
    /// Spread of the objects' mask logits on what moves, after centring.
    pub mask_spread: f64,
}

impl Discover {
    pub(super) fn check(&self) -> Result<()> {
        for (key, count) in [
            ("discover.max_steps", self.max_steps),
            ("discover.coarse_steps", self.coarse_steps),
            ("discover.fine_steps", self.fine_steps),
            ("discover.guide.zero_from", self.guide.zero_from),
            ("discover.schedule.validate_every", self.schedule.validate_every),
        ] {
            countable(key, count)?;
        }
        at_least_one("discover.frames", self.frames as u64)?;
        if self.coarse_steps > 0 {
            at_least_one("discover.fine_steps", self.fine_steps)?;
        }
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

/// The phase's name in a run's files.
pub const NAME: &str = "discover";

impl Phase for Discover {
    fn name(&self) -> &'static str {
        NAME
    }

    fn frames(&self, system: &System) -> f64 {
        let steps = if self.begins_coarse(system) { coarse::after(self).max_steps } else { self.max_steps };
        if self.from.is_some() { 0.0 } else { steps as f64 * self.frames as f64 }
    }

    fn run(&self, session: &mut Session) -> Result<TrainingOutcome> {
        let (model, seed) = (session.model, session.seed);
        if let Some(run) = &self.from {
            let weights = checkpoint::find_own_weights(run, SavedWeights::Last);
            weights.and_then(|weights| weights::load_vision(&weights, model)).context("config: discover.from")?;
            return Ok(TrainingOutcome::Finished);
        }
        let (mut config, mut fits) = (self.clone(), &UNDRAWN_AT_FIT[..]);
        if self.begins_coarse(&model.system) && model.options.decoder == DecoderKind::CoordinateConsistent {
            if session.state.step == 0 && coarse::begin(self, session)? == TrainingOutcome::Interrupted {
                return Ok(TrainingOutcome::Interrupted);
            }
            // A fit to halved frames stands already.
            (config, fits) = (coarse::after(self), &UNDRAWN_AT_FIT[..1]);
        }
        let mut discovery =
            Discovery::new(&config, fits, model, [session.train, session.valid], session.motion(), seed)?;
        if session.state.step == 0 {
            discovery.set_start(model)?;
        }
        session.train_phase(self.name(), &mut discovery, self.optimizer, self.clip_gradients)
    }
}

/// The phase's state between steps.
#[derive(Debug)]
struct Discovery<'a> {
    config: &'a Discover,
    timetable: Timetable,
    /// L_rec at which the equation is fitted.
    fitted_at: Vec<f64>,
    train: &'a Clips,
    seed: u64,
    motion: Rc<MotionDetector>,
    names: Option<Names>,
    /// How they look, which the decoder may begin with.
    sprites: Option<sprites::LearnedSprites>,
    /// What the learning rate is divided by.
    smaller_steps: f64,
    /// Whether there are so few frames that others are made of them.
    few: bool,
    pixel_centres: Tensor,
    validation: Tensor,
}

impl<'a> Discovery<'a> {
    /// `fits` are the shares of what moves that may be left undrawn where the equation is fitted.
    fn new(
        config: &'a Discover,
        fits: &[f64],
        model: &PhysicsNet,
        [train, valid]: [&'a Clips; 2],
        motion: Rc<MotionDetector>,
        seed: u64,
    ) -> Result<Self> {
        let (mut names, mut sprites) = (None, None);
        if config.guide.identity > 0.0 {
            let (moving, found) = names::looked_at(train, &motion, model.system.objects, seed);
            names = Names::learn(&found, seed);
            let window = model.system.given_side() as i64 / 2;
            sprites = names.as_ref().and_then(|names| sprites::learn(&moving, &found, names, window));
        }
        // Objects that look alike are told by their order in the frame, which is harder to learn: a round for each more, in
        // steps that are smaller by as many as are in one order. So scores fall slower, and scatter more.
        let alike = names.as_ref().map_or(0, Names::alike);
        let group = names.as_ref().map_or(1, Names::largest_group) as u64;
        let rounds = (1 + alike).max(model.system.objects.div_ceil(FEW_OBJECTS)) as u64;
        let validate_every = group * group * config.schedule.validate_every;
        let schedule = LrSchedule { validate_every, ..config.schedule.clone() };
        let places = valid.random_places(VALIDATION_FRAMES, seed, u64::MAX);
        let validation = valid.frames(&places);
        let undrawn = Undrawn::measure(&motion, valid, &places, &validation);
        let [good_enough, good] = UNDRAWN.map(|share| undrawn.but(share));
        // Scores under the guides say nothing about the plain loss.
        let guides = GuideClock {
            full_until: rounds * config.guide.full_until,
            zero_from: rounds * config.guide.zero_from,
            found_at: undrawn.but(UNDRAWN_AT_FIT[0]),
            at_the_latest: if config.guide.full_until > 0 || config.guide.waits {
                rounds * config.max_steps / 2
            } else {
                0
            },
            validate_every,
        };
        let timetable = Timetable::new(schedule, config.max_steps, rounds).with_guides(guides);
        Ok(Discovery {
            config,
            timetable: timetable.until(good_enough, good),
            fitted_at: fits.iter().map(|share| undrawn.but(*share)).collect(),
            train,
            seed,
            motion,
            names,
            sprites,
            smaller_steps: group as f64,
            few: model.system.cell.coordinates == Coordinates::Position
                && train.len() * train.time() < pasting::FEW_FRAMES,
            pixel_centres: model.pixel_centres(),
            validation,
        })
    }

    /// Sets the initial values from which every object is found.
    fn set_start(&self, model: &PhysicsNet) -> Result<()> {
        let _guard = tch::no_grad_guard();
        let DiscoverStart { median_background, sprites, template_bump, localiser_scale, mask_spread } =
            self.config.start;
        if median_background {
            let logit = self.motion.median.clamp(LOGIT_MARGIN, 1.0 - LOGIT_MARGIN).logit(None::<f64>);
            model.decoder.start_background(&logit, BACKGROUND_KERNEL);
        }
        if template_bump != 0.0 {
            model.decoder.start_templates(template_bump, BUMP_WIDTH);
        }
        if let Some(seen) = &self.sprites
            && sprites
            && model.system.cell.coordinates == Coordinates::Position
        {
            let behind = self.motion.median.mean_dim([1i64, 2].as_slice(), true, None);
            let reach = seen.reach * model.system.given_pixel();
            model.decoder.start_sprites(&seen.visible, &(&seen.colours + behind), reach, SPRITE_KERNEL);
        }
        if localiser_scale != 0.0 {
            model.encoder.scale_localiser(localiser_scale);
        }
        if mask_spread != 0.0 {
            let places = self.train.random_places(self.config.frames, self.seed, 0);
            let frames = self.train.frames(&places);
            let moving = self.motion.of(self.train, &places, &frames);
            model.encoder.spread_masks(&model.given(&frames), &moving.share, mask_spread);
        }
        Ok(())
    }
}

/// L_rec of a model that draws nothing of what moves, in two parts: what is left of what rests, by what is best in all frames,
/// and what moves before the median frame.
struct Undrawn {
    resting: f64,
    moving: f64,
}

impl Undrawn {
    fn measure(motion: &MotionDetector, clips: &Clips, places: &[i64], frames: &Tensor) -> Self {
        let _guard = tch::no_grad_guard();
        let moves = motion.of(clips, places, frames).moves().expand_as(frames);
        let sum = |x: Tensor| x.sum(Kind::Double).double_value(&[]);
        let moving = sum((frames - &motion.median).square() * &moves);
        let rests = moves.logical_not();
        let count = rests.sum_dim_intlist([0i64].as_slice(), false, Kind::Float);
        let best = (frames * &rests).sum_dim_intlist([0i64].as_slice(), false, None) / count.clamp_min(1.0);
        let resting = sum((frames - best).square() * &rests) / sum(count).max(1.0) * frames.numel() as f64;
        let [resting, moving] = [resting, moving].map(|error| error / places.len() as f64);
        Undrawn { resting, moving }
    }

    /// L_rec where all is drawn but this share of what moves.
    fn but(&self, share: f64) -> f64 {
        self.resting + share * self.moving
    }
}

/// Whether the last of these scores is the first one that is no larger than a limit.
fn first_below(scores: &[f64], limit: f64) -> bool {
    scores.split_last().is_some_and(|(last, before)| *last <= limit && before.iter().all(|score| *score > limit))
}

impl Discovery<'_> {
    /// Makes the second half of these frames pasted ones.
    fn paste_half(&self, model: &PhysicsNet, places: &[i64], frames: &mut Tensor, step: u64) {
        let kept = places.len().div_ceil(2);
        let seen = frames.slice(0, kept as i64, None, 1);
        let moving = self.motion.of(self.train, &places[kept..], &seen);
        let blobs = blobs::find(&moving, model.system.objects);
        let mut random = named_generator(self.seed, &format!("pasting of step {step}"));
        let pasted = pasting::pasted(&seen, &moving, &blobs, &mut random);
        *frames = Tensor::cat(&[frames.slice(0, 0, kept as i64, 1), pasted], 0);
    }

    /// Whether the equation is fitted after the last of these validations.
    fn fits_after(&self, validations: &[f64]) -> bool {
        self.fitted_at.iter().any(|limit| first_below(validations, *limit))
    }

    /// Fits the equation to a few clips, if that is wanted; a line on what it says. The networks go on without it; it is the
    /// answer until there is a better one.
    fn early_fit(&self, model: &PhysicsNet) -> Result<Option<String>> {
        let clips = self.config.first_fit.min(self.train.len());
        if clips == 0 || model.learned().next().is_none() {
            return Ok(None);
        }
        let explanation = identify::first_fit(model, self.train, &self.motion, clips)?;
        let values: Vec<String> =
            model.parameter_values().iter().map(|(name, value)| format!("{name}={value:.4}")).collect();
        Ok(Some(if explanation.explains() {
            format!("early fit - {} by {clips} clips", values.join(" "))
        } else {
            format!("early fit - the equation does not explain {clips} clips yet")
        }))
    }

    /// Which pixels are whose in these frames; none without names.
    fn responsibilities(&self, model: &PhysicsNet, moving: &Foreground) -> Result<Option<Tensor>> {
        let Some(names) = &self.names else { return Ok(None) };
        let shares = names.responsibilities(&blobs::find(moving, model.system.objects));
        Ok(Some(shares.to_device(moving.share.device())))
    }
}

impl Objective for Discovery<'_> {
    fn timetable(&self) -> &Timetable {
        &self.timetable
    }

    /// Frames; while there are guides also their weight, what moves, and which pixels are whose where names tell.
    fn inputs(&mut self, model: &PhysicsNet, step: u64, validations: &[f64]) -> Result<Vec<Tensor>> {
        let places = self.train.random_places(self.config.frames, self.seed, step);
        let mut frames = self.train.frames(&places);
        if self.few {
            self.paste_half(model, &places, &mut frames, step);
        }
        let fade = self.timetable.guides_weight(step, validations);
        if fade == 0.0 {
            return Ok(vec![frames]);
        }
        let moving = self.motion.of(self.train, &places, &frames);
        let responsibilities = self.responsibilities(model, &moving)?;
        let fade = Tensor::from(fade as f32).to_device(frames.device());
        Ok([frames, fade, moving.share].into_iter().chain(responsibilities).collect())
    }

    fn loss(&self, model: &PhysicsNet, inputs: &[Tensor]) -> Result<StepLoss> {
        let frames = &inputs[0];
        let reconstruction = |encoding: &Encoding| {
            let [drawn] = model.decoder.draw([&model.coordinates(encoding)]);
            frame_error(model.options.kernels, &drawn.unsqueeze(1), &frames.unsqueeze(1))
        };
        let [_, fade, moving, responsibilities @ ..] = inputs else {
            let loss = reconstruction(&model.first_look(frames));
            return Ok(StepLoss { total: loss.shallow_clone(), reconstruction: Some(loss), prediction: None });
        };
        // A mask is not to move for the sake of a position.
        let (encoding, positions) = model.first_look_twice(frames);
        let (guide, responsibilities) = (&self.config.guide, responsibilities.first());
        let guides = guide::loss(guide, &encoding, &positions, moving, responsibilities, &self.pixel_centres);
        let loss = reconstruction(&encoding);
        Ok(StepLoss { total: &loss + guides * fade, reconstruction: Some(loss), prediction: None })
    }

    fn learning_rate(&self, _group: VariableGroup) -> f64 {
        self.config.learning_rate / self.smaller_steps
    }

    fn ends_at_best(&self) -> bool {
        self.config.end_at_best
    }

    /// An early fit of the equation, as soon as the objects are drawn well enough.
    fn after_validation(&mut self, model: &PhysicsNet, validations: &[f64]) -> Result<Option<String>> {
        if self.fits_after(validations) { self.early_fit(model) } else { Ok(None) }
    }

    /// L_rec on frames of the validation split. What would be predicted before the parameters are known says nothing.
    fn validate(&self, model: &PhysicsNet, _losses: &dyn Fn() -> Result<MeanLosses>) -> Result<Validated> {
        let _guard = tch::no_grad_guard();
        let mut mean = RunningMean::default();
        for frames in self.validation.split(VALIDATION_BATCH, 0) {
            let [drawn] = model.decoder.draw([&model.coordinates(&model.look(&frames))]);
            mean.add(
                &frame_error(model.options.kernels, &drawn.unsqueeze(1), &frames.unsqueeze(1)),
                frames.size()[0] as f64,
            );
        }
        let score = mean.value();
        Ok(Validated { score, recons_loss: Some(score), pred_loss: None, extrap_loss: None })
    }
}

#[cfg(test)]
mod tests {
    use super::first_below;

    #[test]
    fn a_score_is_good_enough_for_the_first_time_once() {
        let scores = [4.0, 3.5, 1.5, 2.5, 0.9];
        let first = (0..=scores.len()).map(|seen| first_below(&scores[..seen], 2.0));
        assert_eq!(first.collect::<Vec<_>>(), [false, false, false, true, false, false]);
    }
}
