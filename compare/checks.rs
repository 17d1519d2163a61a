//! Comparing one tensor, and the table of all comparisons.

use std::cell::RefCell;
use std::path::Path;

use anyhow::Result;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tch::{Kind, Tensor};

use crate::golden::Golden;
use crate::tolerances::{PROBE_MARGIN, PROBE_STEP, Tolerance};

/// One line of the table.
#[derive(Debug)]
pub struct Row {
    pub tensor: String,
    pub shape: Vec<i64>,
    /// Largest absolute error, NaN if anything computed is NaN.
    pub absolute: f64,
    /// `absolute` over the tensor's scale.
    pub relative: f64,
    pub tolerance: &'static Tolerance,
    /// Errors, and how far rounding moves each element, both as fractions of the scale.
    errors: Tensor,
    moved: Tensor,
    scale: f64,
    computed: Tensor,
}

impl Row {
    fn new(tensor: &str, expected: &Tensor, computed: &Tensor, tolerance: &'static Tolerance) -> Self {
        let computed = computed.detach().to_kind(Kind::Double);
        let errors = (&computed - expected).abs();
        let scale = match expected.abs().max().double_value(&[]) {
            // An all-zero golden tensor has no scale of its own: errors then count as they are.
            0.0 => 1.0,
            scale => scale,
        };
        let absolute = errors.max().double_value(&[]);
        Row {
            tensor: tensor.to_string(),
            shape: expected.size(),
            absolute,
            relative: absolute / scale,
            tolerance,
            moved: errors.zeros_like(),
            errors: errors / scale,
            scale,
            computed,
        }
    }

    /// For `--rows`; a NaN becomes null.
    pub fn json(&self, path: &Path) -> serde_json::Value {
        serde_json::json!({
            "file": path.file_stem().unwrap_or_default().to_string_lossy(),
            "tensor": self.tensor,
            "absolute": self.absolute,
            "relative": self.relative,
            "tolerance": self.tolerance.relative,
            "beyond": self.beyond(),
            "passes": self.passes(),
        })
    }

    /// Whether all elements are within the tolerance itself; a NaN is within no bound.
    pub fn within_tolerance(&self) -> bool {
        self.relative <= self.tolerance.relative
    }

    /// Whether all elements are within the tolerance or within what rounding does to them.
    pub fn passes(&self) -> bool {
        // What moves half of the elements may move any, though the few probes did not show it.
        let moved = self.moved.maximum(&self.moved.median());
        let bound = (moved * PROBE_MARGIN).clamp(self.tolerance.relative, self.tolerance.chaotic);
        self.within_tolerance() || self.errors.le_tensor(&bound).all().int64_value(&[]) != 0
    }

    /// Elements beyond the tolerance.
    pub fn beyond(&self) -> i64 {
        self.errors.numel() as i64 - self.errors.le(self.tolerance.relative).sum(Kind::Int64).int64_value(&[])
    }

    /// Takes in what rounding does to this tensor: `probe` is the same row of a run whose inputs were moved (see
    /// [`Noise`]).
    pub fn allow_for(&mut self, probe: &Row) {
        let moved = ((&probe.computed - &self.computed) / self.scale).abs();
        self.moved = self.moved.maximum(&moved.nan_to_num(0.0, 0.0, 0.0));
    }
}

/// Moves inputs and weights by some float32 roundings, to see what rounding alone does to the results.
#[derive(Debug)]
pub struct Noise(ChaCha8Rng);

impl Noise {
    pub fn new(probe: u64) -> Self {
        Noise(ChaCha8Rng::seed_from_u64(probe))
    }

    fn apply(&mut self, values: &Tensor) -> Tensor {
        let factors: Vec<f64> =
            (0..values.numel()).map(|_| 1.0 + self.0.random_range(-1.0..=1.0) * PROBE_STEP).collect();
        values * Tensor::from_slice(&factors).reshape(values.size())
    }
}

/// A golden file while it is being compared.
#[derive(Debug)]
pub struct Case<'a> {
    pub golden: &'a Golden,
    /// The precision in which the port computes.
    pub kind: Kind,
    pub rows: Vec<Row>,
    noise: Option<RefCell<Noise>>,
}

impl<'a> Case<'a> {
    pub fn new(golden: &'a Golden, kind: Kind, noise: Option<Noise>) -> Self {
        Case { golden, kind, rows: Vec::new(), noise: noise.map(RefCell::new) }
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
        self.check_values(name, &expected, computed, tolerance);
        Ok(())
    }

    /// Compares two tensors of one shape under a title of its own.
    pub fn check_values(&mut self, title: &str, expected: &Tensor, computed: &Tensor, tolerance: &'static Tolerance) {
        self.rows.push(Row::new(title, expected, computed, tolerance));
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
