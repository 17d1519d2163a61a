//! Parameters that are learned again during an episode, from its first frames: a world that has changed.
//!
//! The fit is that of the phase identify, to one clip: what is free are the parameters that are named and the state in the
//! first frame, and the known actions are taken into account.

use anyhow::{Context, Result};
use tch::Tensor;

use paig::network::cells::Actions;
use paig::network::physics_models::PhysicsNet;
use paig::training::identify::Identify;
use paig::training::identify::fit::{FitStart, Trust, fit};

/// Frames from which parameters are learned before all are there: a poor value soon is worth more than a good one late.
const EARLY: [usize; 2] = [7, 13];
const MAX_ITERATIONS: usize = 30;
/// Residuals beyond this many pixels or radians count linearly.
const HUBER: f64 = 1.0;

/// Which parameters, and from how many frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Relearning {
    pub names: Vec<String>,
    pub frames: usize,
}

/// The numbers of frames that are learned from, one after the other.
fn moments(frames: usize) -> impl Iterator<Item = usize> {
    EARLY.into_iter().filter(move |early| *early < frames).chain([frames])
}

impl Relearning {
    /// # Errors
    /// A name that is no parameter of the model, or of one that is not learned; too few frames.
    pub fn check(&self, model: &PhysicsNet) -> Result<()> {
        let learned: Vec<&str> = model.learned().map(|parameter| &*parameter.kind.name).collect();
        for name in &self.names {
            anyhow::ensure!(
                learned.contains(&name.as_str()),
                "{name} is no parameter that the model learns; those are {}",
                learned.join(", ")
            );
        }
        anyhow::ensure!(self.frames >= 4, "relearning needs at least 4 frames, not {}", self.frames);
        Ok(())
    }

    /// From how many frames to learn now that there are so many, after the fits so far took at most `learned`; none where
    /// there is nothing new.
    pub fn due(&self, frames: usize, learned: usize) -> Option<usize> {
        moments(self.frames).filter(|moment| (learned + 1..=frames).contains(moment)).last()
    }

    /// Fits the parameters to what was seen, and sets them in the model: positions `[1, frames, coordinates]`, a mask of
    /// those that count `[1, frames * coordinates]`, and the actions between the frames.
    ///
    /// # Errors
    /// Positions that are not finite, or a fit that ends at none.
    pub fn learn(&self, model: &PhysicsNet, positions: &Tensor, mask: Tensor, actions: &[f64]) -> Result<()> {
        let frames = positions.size()[1] as usize;
        let horizons = moments(frames).collect();
        let config = Identify {
            clips: 1,
            horizons,
            max_iterations: MAX_ITERATIONS,
            huber: HUBER,
            recentre: false,
            velocity_steps: 0,
            velocity_learning_rate: None,
        };
        let named = |name: &str| self.names.iter().any(|given| given == name);
        let all = FitStart::of(model);
        let learned = model.parameters.iter().map(|parameter| named(&parameter.kind.name)).collect();
        let start = FitStart { learned, free_offsets: false, ..all };
        let actions = Actions::new(Some(Tensor::from_slice(&actions[..frames - 1]).unsqueeze(0)));
        let trust = Trust { mask: Some(mask), ..Trust::default() };
        let fit = fit(&config, &model.system, positions, &actions, &start, &trust)?;
        for (parameter, log) in model.parameters.iter().zip(&fit.unconstrained).filter(|(it, _)| named(&it.kind.name)) {
            let value = log.is_finite().then_some(*log);
            model.set_unconstrained(
                parameter,
                value.with_context(|| format!("the fit of {} failed", parameter.kind.name))?,
            );
        }
        Ok(())
    }
}
