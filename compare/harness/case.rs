//! A golden file while it is being compared: what a case takes in from it, and what it holds against it.

use std::cell::RefCell;
use std::path::Path;

use anyhow::Result;
use paig::kernels::Kernels;
use paig::network::physics_models::ModelOptions;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tch::{Kind, Tensor};

use crate::harness::golden::Golden;
use crate::harness::row::ParityRow;
use crate::tolerances::{PROBE_STEP, Tolerance};

/// Moves inputs and weights by some float32 roundings, to see what rounding alone does to the results.
#[derive(Debug)]
pub struct RoundingNoise {
    random: ChaCha8Rng,
    /// Largest relative movement.
    step: f64,
}

impl RoundingNoise {
    /// `size`: in units of [`PROBE_STEP`].
    pub fn new(probe: u64, size: f64) -> Self {
        RoundingNoise { random: ChaCha8Rng::seed_from_u64(probe), step: size * PROBE_STEP }
    }

    fn apply(&mut self, values: &Tensor) -> Tensor {
        let factors: Vec<f64> =
            (0..values.numel()).map(|_| 1.0 + self.random.random_range(-1.0..=1.0) * self.step).collect();
        values * Tensor::from_slice(&factors).reshape(values.size())
    }
}

/// How a case is computed.
#[derive(Debug)]
pub struct CaseRun {
    pub kind: Kind,
    pub kernels: Kernels,
    pub noise: Option<RoundingNoise>,
}

/// A golden file while it is being compared.
#[derive(Debug)]
pub struct Case<'a> {
    pub golden: &'a Golden,
    /// The precision in which the port computes.
    pub kind: Kind,
    /// What it computes by; its own kernels serve in single precision only.
    pub kernels: Kernels,
    /// A checkpoint's file that whole models take their weights from, instead of the formula.
    pub weights: Option<&'a Path>,
    pub rows: Vec<ParityRow>,
    noise: Option<RefCell<RoundingNoise>>,
}

impl<'a> Case<'a> {
    /// With `noise`, a probe.
    pub fn new(golden: &'a Golden, run: CaseRun, weights: Option<&'a Path>) -> Self {
        let CaseRun { kind, kernels, noise } = run;
        Case { golden, kind, kernels, weights, rows: Vec::new(), noise: noise.map(RefCell::new) }
    }

    /// The original's model, computed as this case is.
    pub fn options(&self) -> ModelOptions {
        ModelOptions { kernels: self.kernels, ..ModelOptions::original() }
    }

    /// Values as the computation takes them in: in its precision, and moved where this is a probe.
    pub fn taken_in(&self, values: &Tensor) -> Tensor {
        match &self.noise {
            Some(noise) => noise.borrow_mut().apply(values).to_kind(self.kind),
            None => values.to_kind(self.kind),
        }
    }

    /// An input of the computation.
    pub fn input(&self, name: &str, axes: usize) -> Result<Tensor> {
        Ok(self.taken_in(&self.golden.with_axes(name, axes)?))
    }

    /// An input that gradients are taken to.
    pub fn leaf(&self, name: &str, axes: usize) -> Result<Tensor> {
        Ok(self.input(name, axes)?.set_requires_grad(true))
    }

    /// Compares with the golden tensor `name`.
    ///
    /// # Errors
    /// A golden tensor that is missing, not finite, or of another shape.
    pub fn check(&mut self, name: &str, computed: &Tensor, tolerance: &'static Tolerance) -> Result<()> {
        let expected = self.golden.tensor(name, &computed.size())?;
        self.rows.push(ParityRow::new(name, &expected, computed, tolerance));
        Ok(())
    }

    /// The same of a tensor that is computed in another way, too.
    ///
    /// # Errors
    /// As for [`Case::check`].
    pub fn check_also(
        &mut self,
        name: &str,
        how: &str,
        computed: &Tensor,
        tolerance: &'static Tolerance,
    ) -> Result<()> {
        let expected = self.golden.tensor(name, &computed.size())?;
        self.rows.push(ParityRow::new(&format!("{name}, {how}"), &expected, computed, tolerance));
        Ok(())
    }

    /// Compares the golden tensor `name` one step at a time: `computed` starts from golden states, as `how` says, and
    /// holds the tensor where its own row is uninformative.
    pub fn check_single_step(&mut self, name: &str, how: &str, expected: &Tensor, computed: &Tensor) {
        self.rows.push(ParityRow::single_step(name, how, expected, computed));
    }
}

/// Channels first (last three axes `[C, H, W]`) to the golden files' channels last.
pub fn channels_last(images: &Tensor) -> Tensor {
    images.movedim_int(-3, -1)
}

/// The golden files' channels last to channels first.
pub fn channels_first(images: &Tensor) -> Tensor {
    images.movedim_int(-1, -3)
}
