//! Encoder: a U-Net segments each frame into objects, a dense network localises each masked object.
//!
//! Original: `conv_encoder`; paper: section 3.1 and figure 3.

use anyhow::Result;
use tch::Tensor;
use tch::nn::Path;

use super::{BACKGROUND_LOGIT, ModelOptions};
use crate::network::System;
use crate::network::blocks::{Activation, Dense, Layers, Precision, UNet, uses_deep_unet};
use paig_kernels::{Kernels, Shape, masked_frames};

const HIDDEN: usize = 200;
/// Positions nearer to the frame's edge than this allows are not asked of the localisation network.
const LARGEST_TANH: f64 = 0.999;

/// U-Net and localisation network.
#[derive(Debug)]
pub struct Encoder {
    unet: UNet,
    localisation: [Dense; 3],
    side: usize,
    /// Whether masked frames are halved before they are localised.
    halves: bool,
    objects: i64,
    kernels: Kernels,
    dense_precision: Precision,
}

/// What the encoder makes of frames.
#[derive(Debug)]
pub struct Encoding {
    /// One mask for each object and the background, summing to 1: `[frames, objects + 1, S, S]`.
    pub masks: Tensor,
    /// Mask times frame for each object: `[objects, frames, channels, S, S]`.
    pub masked: Tensor,
    /// `[frames, 2 * objects]` as `(x0, y0, x1, y1, ..)`, pixels in (0, S).
    pub positions: Tensor,
}

impl Encoder {
    pub fn new(scope: Path, system: &System, options: &ModelOptions) -> Self {
        let ModelOptions { kernels, dense_precision, .. } = *options;
        let mut layers = Layers::new(scope);
        let shape = UNet::shape(system.side, system.channels, system.objects);
        let unet = UNet::of_shape(&mut layers, Shape { side: system.given_side(), ..shape }, kernels);
        let halves = uses_deep_unet(system.side) && !system.halved;
        let seen = if halves { system.side / 2 } else { system.given_side() };
        let localisation = [
            layers.dense(seen * seen * system.channels, HIDDEN, Activation::Relu),
            layers.dense(HIDDEN, HIDDEN, Activation::Relu),
            layers.dense(HIDDEN, 2, Activation::None),
        ];
        let (side, objects) = (system.side, system.objects as i64);
        Encoder { unet, localisation, side, halves, objects, kernels, dense_precision }
    }

    /// `[frames, channels, S, S]` in \[0, 1\].
    pub fn forward(&self, frames: &Tensor) -> Encoding {
        let [masks, masked] = self.parted(frames);
        Encoding { positions: self.localise(&masked), masks, masked }
    }

    /// The same, and the positions (`[frames, 2 * objects]`, pixels) once more without a way back to the masks.
    pub fn forward_twice(&self, frames: &Tensor) -> (Encoding, Tensor) {
        let [masks, masked] = self.parted(frames);
        let [first, second, _] = &self.localisation;
        let hidden = first.forward_wide_twice(&self.seen(&masked), self.kernels, self.dense_precision);
        let [positions, by_localiser] = hidden.map(|hidden| self.positions_of(&second.forward(&hidden)));
        (Encoding { masks, masked, positions }, by_localiser)
    }

    /// Masks and masked frames, as in an [`Encoding`].
    fn parted(&self, frames: &Tensor) -> [Tensor; 2] {
        masked_frames(self.kernels, BACKGROUND_LOGIT, &self.unet.forward(frames), frames)
    }

    /// Masked frames `[objects, frames, channels, S, S]` to positions `[frames, 2 * objects]`.
    pub fn localise(&self, masked: &Tensor) -> Tensor {
        self.positions_of(&self.localisation_features(masked))
    }

    /// What the output layer of the localisation network makes of `features`, `[frames, 2 * objects]`.
    fn positions_of(&self, features: &Tensor) -> Tensor {
        let logits = self.localisation[2].forward(features);
        let half = self.side as f64 / 2.0;
        let positions = logits.tanh() * half + half;
        positions.reshape([self.objects, -1, 2]).transpose(0, 1).flatten(1, 2)
    }

    /// What the output layer of the localisation network sees, `[objects * frames, hidden]`.
    fn localisation_features(&self, masked: &Tensor) -> Tensor {
        let [first, second, _] = &self.localisation;
        second.forward(&first.forward_wide(&self.seen(masked), self.kernels, self.dense_precision))
    }

    /// What the localisation network sees of masked frames `[objects, frames, channels, S, S]`, `[objects * frames, values]`.
    fn seen(&self, masked: &Tensor) -> Tensor {
        let stacked = masked.flatten(0, 1);
        let seen = if self.halves { stacked.avg_pool2d(2, 2, 0, false, true, None) } else { stacked };
        // Flattened in the original's order: height, width, channel.
        seen.permute([0, 2, 3, 1]).flatten(1, 3)
    }

    /// Solves the output layer of the localisation network for `positions` (`[frames, 2 * objects]`) of these frames, by
    /// least squares on the logits with a ridge around the present weights. Returns the positions that it then has there.
    ///
    /// # Errors
    /// A system that cannot be solved.
    pub(crate) fn solve_localiser(&self, frames: &Tensor, positions: &Tensor, ridge: f64) -> Result<Tensor> {
        let _guard = tch::no_grad_guard();
        let features = self.localisation_features(&self.forward(frames).masked);
        let half = self.side as f64 / 2.0;
        let wanted = positions.reshape([-1, self.objects, 2]).transpose(0, 1).reshape([-1, 2]);
        let logits = ((wanted / half - 1.0).clamp(-LARGEST_TANH, LARGEST_TANH)).atanh();
        self.localisation[2].solve(&features, &logits, ridge)?;
        Ok(self.positions_of(&features))
    }

    /// Scales the output layer of the localisation network: below 1, positions begin near the middle of the frame.
    pub(crate) fn scale_localiser(&self, factor: f64) {
        self.localisation[2].scale(factor);
    }

    /// Gives the masks another order: the one that was `order[i]` (`[objects]`) is i from now on.
    pub fn reorder(&self, order: &Tensor) {
        self.unet.reorder_logits(order);
    }

    /// Gives the objects' logits equal means and a standard deviation of `spread` between them on the moving pixels, so
    /// that no object starts without a mask and none starts equal to another. A single object only gets the mean. Where nothing
    /// moves they stay as they are.
    ///
    /// `frames`: `[frames, channels, S, S]`; `moving`: `[frames, S, S]` in \[0, 1\].
    pub fn spread_masks(&self, frames: &Tensor, moving: &Tensor, spread: f64) {
        let _guard = tch::no_grad_guard();
        let logits = self.unet.forward(frames).transpose(0, 1).flatten(1, 3);
        let weight = moving.flatten(0, 2);
        let sum = weight.sum(weight.kind());
        if sum.double_value(&[]) == 0.0 {
            return;
        }
        let weight = weight / sum;
        let mean = (&logits * &weight).sum_dim_intlist([1i64].as_slice(), false, None);
        let centred = logits - mean.unsqueeze(1);
        let between = &centred - centred.mean_dim([0i64].as_slice(), true, None);
        let deviation = ((between.square() * weight).sum(mean.kind()) / self.objects as f64).sqrt();
        let scale = if self.objects > 1 { spread / deviation } else { deviation.ones_like() };
        // The means go to the background's logit: every object begins as likely as the background.
        self.unet.rescale_logits(&scale, &mean, BACKGROUND_LOGIT);
    }
}
