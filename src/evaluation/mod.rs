//! Scoring a model on clips: losses, every predicted frame, and positions where the truth is known.
//!
//! Structural similarity of frames to themselves:
//!
//! ```
//! use paig::evaluation::ssim::ssim;
//! use tch::{Device, Kind, Tensor};
//!
//! // Four frames, [frames, channels, side, side].
//! let frames = Tensor::rand([4, 3, 32, 32], (Kind::Float, Device::Cpu));
//! let similarity: Vec<f64> = ssim(&frames, &frames)?.try_into()?;
//! assert!(similarity.iter().all(|similarity| (similarity - 1.0).abs() < 1e-6));
//! # Ok::<(), anyhow::Error>(())
//! ```

pub mod frame_scores;
pub mod outputs;
mod passes;
pub mod rollout;
mod scored_clips;
pub mod ssim;
mod states;

use anyhow::{Context, Result, ensure};
use tch::{Device, Kind, Tensor};

use self::frame_scores::FrameScores;
use crate::datasets::iterators::Clips;
use crate::network::physics_models::PhysicsNet;
use crate::network::physics_models::losses::{LossAccumulator, Losses, MeanLosses};
use crate::runs::scores::Scores;
use crate::support::error::Error;

pub use passes::batch;
pub(crate) use passes::each_pass;
pub use scored_clips::ScoredClips;

/// The losses on the first `limit` clips, `batch` at a time. The whole clips are predicted. Original: `base.py`, `eval`.
///
/// # Errors
/// Clips shorter than L + T_pred.
pub fn mean_losses(model: &PhysicsNet, clips: &Clips, limit: usize, batch: usize) -> Result<MeanLosses> {
    let mut losses = LossAccumulator::default();
    each_pass(model, clips, limit, batch, |chosen, frames, pass| {
        losses.add(&Losses::new(&pass, frames, &model.system), chosen.len());
        Ok(())
    })?;
    Ok(losses.values())
}

/// Scores a model on clips, with the true states if there are any.
///
/// # Errors
/// Clips shorter than L + T_pred, states of another number of objects, losses that are not finite.
pub fn evaluate(model: &PhysicsNet, scored: &ScoredClips) -> Result<Scores, Error> {
    scores(model, scored).map_err(Error::of_work)
}

fn scores(model: &PhysicsNet, scored: &ScoredClips) -> Result<Scores> {
    let ScoredClips { clips, states, .. } = scored;
    let system = &model.system;
    let mut losses = LossAccumulator::default();
    let mut predicted_frames = FrameScores::default();
    let mut seen: [Vec<Tensor>; 3] = Default::default();
    each_pass(model, clips, clips.len(), batch(clips), |chosen, frames, pass| {
        losses.add(&Losses::new(&pass, frames, system), chosen.len());
        let predicted = pass.predictions.size()[1];
        let truth = frames.narrow(1, system.input_steps as i64, predicted);
        predicted_frames.add(&pass.predictions, &truth)?;
        if states.is_some() {
            let rolled_out = pass.sequence().chunk(2, 2);
            let parts = [&pass.positions, &rolled_out[0], &rolled_out[1]];
            for (part, states) in seen.iter_mut().zip(parts) {
                part.push((states * model.length_per_unit()).to_device(Device::Cpu).to_kind(Kind::Double));
            }
        }
        Ok(())
    })?;
    let states = match states {
        Some(truth) => {
            let [encoded, positions, velocities] = seen.map(|parts| Tensor::cat(&parts, 0));
            let twins = model.decoder.twins().unwrap_or_else(|| (0..system.objects).collect());
            let seen = states::EstimatedStates { encoded, positions, velocities, twins };
            Some(states::errors(&seen, truth, system).context("true states")?)
        }
        None => None,
    };
    let losses = losses.values();
    ensure!(
        losses.is_finite(),
        "the losses are not finite (L_rec {}, L_pred {}, L_extrap {}): in some clip what is predicted is no number; of an \
         equation keep roots and quotients away from 0",
        losses.recons_loss,
        losses.pred_loss,
        losses.extrap_loss.map_or("-".into(), |loss| loss.to_string())
    );
    let predicted_frames = predicted_frames.predicted_frames(system)?;
    Ok(Scores { clips: clips.len(), losses, predicted_frames, states })
}
