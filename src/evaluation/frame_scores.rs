//! Squared error and structural similarity of each predicted frame, gathered batch by batch.

use anyhow::Result;
use tch::{Device, Kind, Tensor};

use super::ssim::ssim;
use crate::network::System;
use crate::runs::scores::PredictedFrame;

/// What was predicted so far.
#[derive(Debug, Default)]
pub struct FrameScores {
    /// `[batch, frames]` each.
    squared_errors: Vec<Tensor>,
    similarities: Vec<Tensor>,
}

impl FrameScores {
    /// Adds predicted and true frames, `[batch, frames, channels, S, S]`.
    ///
    /// # Errors
    /// Frames that are smaller than the window of the similarity.
    pub fn add(&mut self, predicted: &Tensor, truth: &Tensor) -> Result<()> {
        let over_frame = [2i64, 3, 4];
        let errors = (predicted - truth).square().sum_dim_intlist(over_frame.as_slice(), false, Kind::Double);
        self.squared_errors.push(errors.to_device(Device::Cpu));
        let similar = ssim(&predicted.flatten(0, 1), &truth.flatten(0, 1))?;
        self.similarities.push(similar.reshape([-1, predicted.size()[1]]).to_device(Device::Cpu));
        Ok(())
    }

    /// The means over all clips, in the order of time.
    ///
    /// # Errors
    /// Nothing was added.
    pub fn predicted_frames(&self, system: &System) -> Result<Vec<PredictedFrame>> {
        let per_frame = |parts: &[Tensor]| -> Result<Vec<f64>> {
            Ok(Tensor::f_cat(parts, 0)?.mean_dim([0i64].as_slice(), false, Kind::Double).try_into()?)
        };
        let scores = per_frame(&self.squared_errors)?.into_iter().zip(per_frame(&self.similarities)?);
        let frame = |(place, (squared_error, ssim))| PredictedFrame {
            frame: system.input_steps + place,
            extrapolated: place >= system.pred_steps,
            squared_error,
            ssim,
        };
        Ok(scores.enumerate().map(frame).collect())
    }
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::*;
    use crate::support::random::named_generator;

    fn frames(purpose: &str) -> Tensor {
        let mut random = named_generator(1, purpose);
        let values: Vec<f32> = (0..3 * 5 * 3 * 16 * 16).map(|_| random.random()).collect();
        Tensor::from_slice(&values).reshape([3, 5, 3, 16, 16])
    }

    #[test]
    fn each_frame_has_its_own_similarity() {
        let (predicted, truth) = (frames("predicted"), frames("truth"));
        let mut scores = FrameScores::default();
        scores.add(&predicted, &truth).unwrap();
        let system = crate::tasks::find("spring_color").unwrap().system;
        let of_frames = scores.predicted_frames(&system).unwrap();
        assert_eq!(of_frames.len(), 5);
        for (frame, score) in (0..).zip(of_frames) {
            let alone = ssim(&predicted.select(1, frame), &truth.select(1, frame)).unwrap();
            let alone = alone.mean(Kind::Double).double_value(&[]);
            // Float64 sums in another order.
            assert!((score.ssim - alone).abs() < 1e-12, "frame {frame}: {} and alone {alone}", score.ssim);
        }
    }
}
