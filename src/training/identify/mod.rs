//! Phase 2, identify: fit the physical parameters to encoded trajectories, without images, and re-centre the templates.
//!
//! From poor parameters the image loss leads to free motion (k to 0): that is where reruns of the original end. Fitted
//! to trajectories of growing length the parameters have no such trap. Not in the original.

pub mod fit;
pub mod recentre;
pub mod velocity_fit;

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};
use tch::Tensor;

use super::base::{Outcome, Session};
use super::observer::Event;
use super::phase::Phase;
use super::ranges::{at_least_one, not_negative};
use crate::network::cells::{Actions, Coordinates};
use crate::runs::metrics::{Kind, Record};

/// Frames on which the positions are re-centred.
const RECENTRE_FRAMES: usize = 1000;

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
    /// Residuals beyond this count linearly; pixels or radians.
    pub huber: f64,
    /// Re-centre the templates when an offset is larger than this many pixels; 0 never does.
    pub recentre_above: f64,
    /// Steps on the velocity estimator, towards the fitted trajectories' velocities. A config without it means none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub velocity_steps: u64,
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

impl Identify {
    pub(super) fn check(&self, clip_frames: usize) -> Result<()> {
        at_least_one("identify.clips", self.clips as u64)?;
        ensure!(self.huber > 0.0, "config: identify.huber = {}: must be positive", self.huber);
        not_negative("identify.recentre_above", self.recentre_above)?;
        ensure!(
            !self.horizons.is_empty() && self.horizons.iter().all(|&h| h >= 3 && h <= clip_frames),
            "config: identify.horizons = {:?}: there must be at least one, and each between 3 and the clip length \
             {clip_frames}",
            self.horizons
        );
        Ok(())
    }

    /// Takes the offsets off templates and positions if the largest is above the config's limit; whether it did.
    fn recentre(&self, session: &mut Session, offsets: &[f64]) -> Result<bool> {
        let largest = offsets.iter().fold(0.0f64, |largest, offset| largest.max(offset.abs()));
        // An angle is tied to where the rod is seen, which leaves little of an offset.
        let positions = session.model.system.cell.coordinates == Coordinates::Position;
        if !positions || self.recentre_above <= 0.0 || largest <= self.recentre_above {
            return Ok(false);
        }
        let frames = session.train.random_frames(RECENTRE_FRAMES, session.seed, session.state.steps);
        let left = recentre::recentre(session.model, &frames, offsets)?;
        session.tell(&Event::Note(&format!("recentre - largest offset {largest:.3} px, {left:.4} px left")))?;
        Ok(true)
    }
}

impl Phase for Identify {
    fn name(&self) -> &'static str {
        "identify"
    }

    fn run(&self, session: &mut Session) -> Result<Outcome> {
        let model = session.model;
        if model.learned().next().is_none() && self.velocity_steps == 0 {
            return Ok(Outcome::Finished);
        }
        session.tell(&Event::PhaseBegins { phase: self.name(), done: 0, of: 0 })?;
        let (positions, actions) = encode_clips(session, self.clips);
        let fit = fit::fit(self, &model.system, &positions, &actions, &model.parameters)?;
        for (parameter, log) in model.parameters.iter().zip(&fit.logs).filter(|(parameter, _)| parameter.learned) {
            model.set_log(parameter, *log);
        }
        let recentred = self.recentre(session, &fit.offsets)?;
        let unit = model.system.cell.coordinates.unit();
        let mut record = Record {
            residual: Some(fit.residual),
            iterations: Some(fit.iterations),
            recentred: Some(recentred),
            ..session.record(Kind::Identify, self.name())
        };
        session.tell(&Event::Note(&format!(
            "identify - residual={:.4} {unit} iterations={} offsets={:.3?} {}",
            fit.residual,
            fit.iterations,
            fit.offsets,
            record.parameters_text()
        )))?;
        record.offsets = Some(fit.offsets);
        if self.velocity_steps > 0 {
            let (frames, steps) = (session.train.time(), self.velocity_steps);
            let left = velocity_fit::fit(model, &fit.states, &actions, frames, steps)?;
            session.tell(&Event::Note(&format!("velocity - residual={left:.4} {unit} per time unit")))?;
            record.velocity_residual = Some(left);
        }
        session.tell(&Event::Recorded(&record))?;
        session.tell(&Event::PhaseEnds { phase: self.name() })?;
        Ok(Outcome::Finished)
    }
}

/// Encoded positions of the first `count` training clips, `[clips, time, coordinates * objects]`, and what acts on them.
fn encode_clips(session: &Session, count: usize) -> (Tensor, Actions) {
    let _guard = tch::no_grad_guard();
    let (clips, model) = (session.train, session.model);
    let chosen: Vec<i64> = (0..clips.len().min(count) as i64).collect();
    let batches = chosen.chunks(session.validation.batch);
    let encoded: Vec<Tensor> = batches.map(|chosen| model.encode(&clips.batch(chosen, clips.time())).1).collect();
    (Tensor::cat(&encoded, 0), clips.actions(&chosen))
}
