//! Losses: squared error summed over a frame, averaged over frames and clips.
//!
//! Original: `PhysicsNet.compute_loss`; paper: section 3.4, equation 7.

use serde::{Deserialize, Deserializer, Serialize};
use tch::{Kind, Tensor};

use super::ForwardPass;
use crate::network::System;
use paig_kernels::{Kernels, squared_error};

/// Mean over frames of the squared error summed over channels, height and width.
///
/// Both `[batch, time, channels, S, S]`.
pub fn frame_error(kernels: Kernels, frames: &Tensor, truth: &Tensor) -> Tensor {
    let frames_in_all = frames.size()[0] * frames.size()[1];
    squared_error(kernels, frames, truth) / frames_in_all as f64
}

/// The three losses of one pass. T_ext may be empty, then `extrapolation` is none.
#[derive(Debug)]
pub struct Losses {
    /// L_rec over the first L + T_pred frames, encoder to decoder. A scalar, as the others.
    pub reconstruction: Tensor,
    /// L_pred over the T_pred frames after the input, roll-out to decoder.
    pub prediction: Tensor,
    /// L_extrap over the frames after those; scored, never trained.
    pub extrapolation: Option<Tensor>,
}

impl Losses {
    /// Of a pass over these true clips, `[batch, T, channels, S, S]` in \[0, 1\].
    pub fn new(pass: &ForwardPass, clips: &Tensor, system: &System) -> Self {
        let (input, pred) = (system.input_steps as i64, system.pred_steps as i64);
        let predicted = pass.predictions.size()[1];
        let error = |first: i64, count: i64| {
            frame_error(pass.kernels, &pass.predictions.narrow(1, first, count), &clips.narrow(1, input + first, count))
        };
        Losses {
            reconstruction: frame_error(pass.kernels, &pass.reconstructions, &clips.narrow(1, 0, input + pred)),
            prediction: error(0, pred),
            extrapolation: (predicted > pred).then(|| error(pred, predicted - pred)),
        }
    }

    /// The training loss `L_pred + alpha L_rec`.
    pub fn train(&self, alpha: f64) -> Tensor {
        &self.prediction + &self.reconstruction * alpha
    }
}

/// Smooth L1 (quadratic within 1, in the coordinates' unit) between rolled-out and encoded positions or velocities, both
/// `[.., coordinates * objects]`.
///
/// The encoded side is detached: it teaches the physics and the initial state, not the encoder.
pub fn latent_error(rolled_out: &Tensor, encoded: &Tensor) -> Tensor {
    rolled_out.smooth_l1_loss(&encoded.detach(), tch::Reduction::Mean, 1.0)
}

/// The three losses of the paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Loss {
    #[serde(rename = "recons_loss")]
    Recons,
    #[serde(rename = "pred_loss")]
    Pred,
    #[serde(rename = "extrap_loss")]
    Extrap,
}

impl Loss {
    pub const ALL: [Loss; 3] = [Loss::Recons, Loss::Pred, Loss::Extrap];

    /// As files name it.
    pub fn key(self) -> &'static str {
        match self {
            Loss::Recons => "recons_loss",
            Loss::Pred => "pred_loss",
            Loss::Extrap => "extrap_loss",
        }
    }

    /// As the paper writes it.
    pub fn symbol(self) -> &'static str {
        match self {
            Loss::Recons => "L_rec",
            Loss::Pred => "L_pred",
            Loss::Extrap => "L_extrap",
        }
    }
}

/// The three losses, averaged over clips: squared error summed over a frame, averaged over frames and clips.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeanLosses {
    #[serde(deserialize_with = "nan_if_null")]
    pub recons_loss: f64,
    #[serde(deserialize_with = "nan_if_null")]
    pub pred_loss: f64,
    /// None where the clips end with the prediction.
    pub extrap_loss: Option<f64>,
}

impl MeanLosses {
    /// Whether all are numbers.
    pub fn is_finite(&self) -> bool {
        [Some(self.recons_loss), Some(self.pred_loss), self.extrap_loss].into_iter().flatten().all(f64::is_finite)
    }

    /// One of them; none where it is not a number or the clips have no such frames.
    pub fn of(&self, loss: Loss) -> Option<f64> {
        let value = match loss {
            Loss::Recons => Some(self.recons_loss),
            Loss::Pred => Some(self.pred_loss),
            Loss::Extrap => self.extrap_loss,
        };
        value.filter(|value| !value.is_nan())
    }
}

/// JSON has no NaN: `null` stands for it.
fn nan_if_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// The losses of a set of clips, batch by batch.
#[derive(Debug, Default)]
pub struct LossAccumulator {
    reconstruction: RunningMean,
    prediction: RunningMean,
    extrapolation: RunningMean,
}

impl LossAccumulator {
    /// Adds a batch of `clips` clips.
    pub fn add(&mut self, losses: &Losses, clips: usize) {
        let weight = clips as f64;
        self.reconstruction.add(&losses.reconstruction, weight);
        self.prediction.add(&losses.prediction, weight);
        losses.extrapolation.iter().for_each(|loss| self.extrapolation.add(loss, weight));
    }

    pub fn values(&self) -> MeanLosses {
        MeanLosses {
            recons_loss: self.reconstruction.value(),
            pred_loss: self.prediction.value(),
            extrap_loss: self.extrapolation.sum.is_some().then(|| self.extrapolation.value()),
        }
    }
}

/// Mean of a loss over a set, gathered on the device and read once at the end.
#[derive(Debug, Default)]
pub struct RunningMean {
    sum: Option<Tensor>,
    weight: f64,
}

impl RunningMean {
    /// Adds a batch's mean with the batch's size.
    pub fn add(&mut self, value: &Tensor, weight: f64) {
        let weighted = value.detach().to_kind(Kind::Double) * weight;
        self.sum = Some(match self.sum.take() {
            Some(sum) => sum + weighted,
            None => weighted,
        });
        self.weight += weight;
    }

    /// The mean so far; NaN if nothing was added.
    pub fn value(&self) -> f64 {
        self.sum.as_ref().map_or(f64::NAN, |sum| sum.double_value(&[]) / self.weight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_batch_counts_by_its_clips() {
        let all = |loss: f64| {
            let [reconstruction, prediction, extrapolation] = [(); 3].map(|()| Tensor::from(loss));
            Losses { reconstruction, prediction, extrapolation: Some(extrapolation) }
        };
        let mut losses = LossAccumulator::default();
        losses.add(&all(1.0), 3);
        losses.add(&all(5.0), 1);
        assert_eq!(losses.values(), MeanLosses { recons_loss: 2.0, pred_loss: 2.0, extrap_loss: Some(2.0) });
    }
}
