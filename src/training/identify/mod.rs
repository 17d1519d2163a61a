//! Phase 2, identify: fit the physical parameters to encoded trajectories, without images, and re-centre the templates.
//!
//! From poor parameters the image loss leads to free motion (k to 0): that is where reruns of the original end. Fitted
//! to trajectories of growing length the parameters have no such trap. Not in the original.

pub mod encoded_positions;
pub mod explain;
pub mod fit;
pub mod missing;
mod order;
pub mod rank;
pub mod recentre;
pub mod velocity_fit;

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};

use self::encoded_positions::EncodedPositions;
use self::explain::{Explanation, LEAST_HUBER};
use self::fit::FitStart;
use super::base::{Session, TrainingOutcome};
use super::objects::motion::MotionDetector;
use super::observer::TrainingEvent;
use super::phase::Phase;
use super::ranges::at_least_one;
use crate::datasets::iterators::Clips;
use crate::network::physics_models::{DecoderKind, PhysicsNet};
use crate::runs::metrics::{Record, RecordKind};

/// Clips on which the positions are re-centred.
const RECENTRE_CLIPS: usize = 200;

/// Frames of a clip in the first fit, at most, and clips that are seen at a time.
const LONGEST_OF_FIRST: usize = 12;
const FIRST_BATCH: usize = 25;

/// The phase's config.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identify {
    /// Training clips that are fitted.
    pub clips: usize,
    /// Frames of a clip that are fitted, growing.
    pub horizons: Vec<usize>,
    /// For each horizon.
    pub max_iterations: usize,
    /// Residuals beyond this count linearly; pixels or radians. The last fits have a limit by the noise, where that is less.
    pub huber: f64,
    /// Whether templates and positions are re-centred where the motion is explained.
    pub recentre: bool,
    /// Steps on the velocity estimator, towards the fitted trajectories' velocities. A config without it means none.
    #[serde(default)]
    pub velocity_steps: u64,
    /// Adam's rate in them; a tenth of it in the last quarter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity_learning_rate: Option<f64>,
}

/// The rate where a config gives none.
const VELOCITY_RATE: f64 = 1e-3;

impl Identify {
    /// A fit of clips of so many frames with settings that are the same whatever the recipe: those of the judge, so that verdicts
    /// can be compared, and of the first fits.
    pub fn usual(clip_frames: usize) -> Self {
        let horizons = [3, 4, 6, 8].into_iter().filter(|horizon| *horizon < clip_frames).chain([clip_frames]).collect();
        Identify {
            clips: 400,
            horizons,
            max_iterations: 30,
            huber: 1.0,
            recentre: false,
            velocity_steps: 0,
            velocity_learning_rate: None,
        }
    }

    pub(super) fn check(&self, clip_frames: usize) -> Result<()> {
        at_least_one("identify.clips", self.clips as u64)?;
        for (key, number, least) in
            [("huber", self.huber, LEAST_HUBER), ("velocity_learning_rate", self.velocity_rate(), 0.0)]
        {
            ensure!(
                number.is_finite() && number > 0.0 && number >= least,
                "config: identify.{key} = {number}: must be a positive number{}",
                if least > 0.0 { format!(", at least {least}") } else { String::new() }
            );
        }
        ensure!(
            !self.horizons.is_empty()
                && self.horizons.is_sorted()
                && self.horizons.iter().all(|&h| h >= 3 && h <= clip_frames),
            "config: identify.horizons = {:?}: there must be at least one, none smaller than the one before, and each \
             between 3 and the clip length {clip_frames}",
            self.horizons
        );
        Ok(())
    }

    fn velocity_rate(&self) -> f64 {
        self.velocity_learning_rate.unwrap_or(VELOCITY_RATE)
    }

    /// Moves positions and templates to where the objects were seen; whether it did.
    fn recentre(&self, session: &mut Session, explanation: &Explanation) -> Result<bool> {
        let model = session.model;
        // A perceptron that draws has no sprites that could be shifted.
        if !self.recentre || model.options.decoder == DecoderKind::Mlp {
            return Ok(false);
        }
        let count = (explanation.positions.size()[0]).min(RECENTRE_CLIPS as i64);
        let chosen: Vec<i64> = (0..count).collect();
        let frames = session.train.batch(&chosen, session.train.time()).flatten(0, 1);
        let positions = explanation.positions.narrow(0, 0, count).flatten(0, 1);
        let left = recentre::recentre(model, &frames, &positions, &explanation.offsets)?;
        let largest = explanation.offsets.iter().fold(0.0f64, |largest, offset| largest.max(offset.abs()));
        session.tell(&TrainingEvent::Note(&format!("recentre - largest offset {largest:.3} px, {left:.4} px left")))?;
        Ok(true)
    }
}

/// Fits the equation to the first `clips` clips as they are encoded now, and gives the model its parameters if that explains
/// them. Positions and templates stay.
///
/// # Errors
/// Positions that are not finite.
pub(super) fn first_fit(
    model: &PhysicsNet,
    train: &Clips,
    motion: &MotionDetector,
    clips: usize,
) -> Result<Explanation> {
    let explanation = explain_some(model, train, motion, clips, &FitStart::of(model))?;
    explanation.apply(model);
    Ok(explanation)
}

/// The fit of the equation to the first `clips` clips as they are encoded now; the model stays as it is.
fn explain_some(
    model: &PhysicsNet,
    train: &Clips,
    motion: &MotionDetector,
    clips: usize,
    start: &FitStart,
) -> Result<Explanation> {
    let config = Identify { clips, ..Identify::usual(train.time().min(LONGEST_OF_FIRST)) };
    let seen = EncodedPositions::of(model, train, motion, clips, FIRST_BATCH);
    explain::explain(&config, model, &seen, start)
}

impl Phase for Identify {
    fn name(&self) -> &'static str {
        "identify"
    }

    fn run(&self, session: &mut Session) -> Result<TrainingOutcome> {
        let model = session.model;
        session.tell(&TrainingEvent::PhaseBegins { phase: self.name(), done: 0, of: 0 })?;
        let motion = session.motion();
        let fits = self.max_iterations > 0;
        if let Some(order) =
            fits.then(|| order::find(model, session.train, &motion, &session.begun)).transpose()?.flatten()
        {
            let numbers: Vec<_> = order.iter().map(|number| number + 1).collect();
            session
                .tell(&TrainingEvent::Note(&format!("identify - the objects' order in the equation is {numbers:?}")))?;
        }
        let seen = EncodedPositions::of(model, session.train, &motion, self.clips, session.validation.pass);
        let explanation = explain::explain(self, model, &seen, &FitStart::of(model))?;
        explanation.apply(model);
        let fit = &explanation.fit;
        let explains = explanation.explains();
        let recentred = explains && self.recentre(session, &explanation)?;
        let unit = model.system.cell.coordinates.unit();
        let mut record = Record {
            residual: Some(fit.residual),
            iterations: Some(fit.iterations),
            recentred: Some(recentred),
            ..session.record(RecordKind::Identify, self.name())
        };
        session.tell(&TrainingEvent::Note(&format!(
            "identify - residual={:.4} {unit} iterations={} offsets={:.3?} {}",
            fit.residual,
            fit.iterations,
            explanation.offsets,
            record.parameters_text()
        )))?;
        session.tell(&TrainingEvent::Note(&explanation.text(unit)))?;
        if let Some(unidentifiable) = explanation.unidentifiable(model) {
            session.tell(&TrainingEvent::Note(&unidentifiable.text()))?;
        }
        record.offsets = Some(explanation.offsets);
        // A motion that the equation does not explain teaches nothing.
        if self.velocity_steps > 0 && explains {
            let (steps, rate) = (self.velocity_steps, self.velocity_rate());
            let left = velocity_fit::fit(model, &fit.states, &seen.actions, session.train.time(), steps, rate)?;
            session.tell(&TrainingEvent::Note(&format!("velocity - residual={left:.4} {unit} per time unit")))?;
            record.velocity_residual = Some(left);
        }
        session.tell(&TrainingEvent::Recorded { record: &record, model: session.model })?;
        session.tell(&TrainingEvent::PhaseEnds { phase: self.name() })?;
        Ok(TrainingOutcome::Finished)
    }
}
