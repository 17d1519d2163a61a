//! Random latents: normal distributions whose parameters a network gives, and the numbers that are drawn from them.

use rand_chacha::ChaCha8Rng;
use tch::{Kind, Tensor};

use crate::support::random::{named_generator, normal};

/// Independent normal distributions, `[batch, n]`.
#[derive(Debug)]
pub struct Gaussian {
    pub mean: Tensor,
    pub log_variance: Tensor,
}

impl Gaussian {
    /// With these standard normal numbers; the mean without.
    pub fn sample(&self, noise: Option<Tensor>) -> Tensor {
        match noise {
            Some(noise) => &self.mean + noise * (&self.log_variance * 0.5).exp(),
            None => self.mean.shallow_clone(),
        }
    }

    /// KL divergence from N(0, 1), summed over all but averaged over the batch.
    pub fn divergence(&self) -> Tensor {
        let of_each = (self.mean.square() + self.log_variance.exp() - 1.0 - &self.log_variance) * 0.5;
        of_each.sum(Kind::Float) / self.mean.size()[0] as f64
    }

    /// KL divergence of this distribution from another one, `[batch]`: never negative, 0 of equal ones.
    pub fn divergence_from(&self, other: &Gaussian) -> Tensor {
        let ratio = &self.log_variance - &other.log_variance;
        let distance = (&self.mean - &other.mean).square() * (-&other.log_variance).exp();
        ((ratio.exp() + distance - 1.0 - ratio) * 0.5).sum_dim_intlist([1i64].as_slice(), false, None)
    }
}

/// Standard normal numbers of a training step; none without one.
#[derive(Debug)]
pub struct Noise(Option<ChaCha8Rng>);

impl Noise {
    pub fn of_step(seed: u64, step: u64) -> Self {
        Noise(Some(named_generator(seed, &format!("latents of step {step}"))))
    }

    pub fn none() -> Self {
        Noise(None)
    }

    pub fn like(&mut self, x: &Tensor) -> Option<Tensor> {
        let random = self.0.as_mut()?;
        let values: Vec<f32> = (0..x.numel()).map(|_| normal(random) as f32).collect();
        Some(Tensor::from_slice(&values).reshape(x.size()))
    }
}
