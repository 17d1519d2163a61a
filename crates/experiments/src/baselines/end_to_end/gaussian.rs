//! Random latents: normal distributions whose parameters a network gives, and the numbers that are drawn from them.

use tch::{Kind, Tensor};

use paig::support::random::{named_generator, normal};

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

/// So many standard normal numbers for a training step, float32 `[count]`; equal ones for an equal seed and step.
pub fn normal_numbers(seed: u64, step: u64, count: usize) -> Tensor {
    let mut random = named_generator(seed, &format!("latents of step {step}"));
    let numbers: Vec<f32> = (0..count).map(|_| normal(&mut random) as f32).collect();
    Tensor::from_slice(&numbers)
}

/// Standard normal numbers, taken one after the other; or none, and what is drawn is the mean.
#[derive(Debug)]
pub struct StandardNormal<'a> {
    numbers: Option<&'a Tensor>,
    taken: i64,
}

impl<'a> StandardNormal<'a> {
    /// Of these numbers, `[count]`.
    pub fn of(numbers: Option<&'a Tensor>) -> Self {
        StandardNormal { numbers, taken: 0 }
    }

    pub fn none() -> Self {
        StandardNormal::of(None)
    }

    /// As many as a tensor has, in its shape.
    pub fn like(&mut self, x: &Tensor) -> Option<Tensor> {
        let (from, count) = (self.taken, x.numel() as i64);
        self.taken += count;
        Some(self.numbers?.narrow(0, from, count).reshape(x.size()))
    }
}
