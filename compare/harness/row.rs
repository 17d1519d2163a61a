//! One compared tensor: its errors, what rounding does to it, and what it says of the port.

use tch::{Kind, Tensor};

use crate::tolerances::{PROBE_MARGIN, SINGLE_STEP, Tolerance, UNINFORMATIVE};

/// What a row says of the port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RowVerdict {
    Pass,
    Fail,
    /// Nothing: rounding alone moves the tensor by more than [`UNINFORMATIVE`] of its scale.
    Uninformative,
}

/// One line of the table.
#[derive(Debug)]
pub struct ParityRow {
    pub title: String,
    pub shape: Vec<i64>,
    /// Largest absolute error, NaN if anything computed is NaN.
    pub absolute: f64,
    /// `absolute` over the tensor's scale.
    pub relative: f64,
    pub tolerance: &'static Tolerance,
    /// The tensor that this row compares one step at a time, from golden states; none where it compares a tensor whole.
    pub single_step_of: Option<String>,
    /// Errors, and how far rounding moves each element, both as fractions of the scale.
    errors: Tensor,
    moved: Tensor,
    scale: f64,
    computed: Tensor,
}

impl ParityRow {
    pub fn new(title: &str, expected: &Tensor, computed: &Tensor, tolerance: &'static Tolerance) -> Self {
        // A copy: variables are stepped after they were compared.
        let computed = computed.detach().to_kind(Kind::Double).copy();
        let errors = (&computed - expected).abs();
        let scale = match expected.abs().max().double_value(&[]) {
            // An all-zero golden tensor has no scale of its own: errors then count as they are.
            0.0 => 1.0,
            scale => scale,
        };
        let absolute = errors.max().double_value(&[]);
        ParityRow {
            title: title.to_string(),
            shape: expected.size(),
            absolute,
            relative: absolute / scale,
            tolerance,
            single_step_of: None,
            moved: errors.zeros_like(),
            errors: errors / scale,
            scale,
            computed,
        }
    }

    /// A row that compares `tensor` one step at a time, from golden states as `how` says.
    pub fn single_step(tensor: &str, how: &str, expected: &Tensor, computed: &Tensor) -> Self {
        let row = ParityRow::new(&format!("{tensor}, {how}"), expected, computed, &SINGLE_STEP);
        ParityRow { single_step_of: Some(tensor.to_string()), ..row }
    }

    /// Takes in what rounding does to this tensor: `probe` is the same row of a run whose inputs were moved
    /// (see [`RoundingNoise`](crate::harness::case::RoundingNoise)) `size` times as far as rounding does.
    pub fn allow_for(&mut self, probe: &ParityRow, size: f64) {
        self.allow((&probe.computed - &self.computed) / size);
    }

    /// The same: how far the same computation is apart in two precisions.
    pub fn allow_between(&mut self, single: &ParityRow, double: &ParityRow) {
        self.allow(&single.computed - &double.computed);
    }

    fn allow(&mut self, difference: Tensor) {
        let moved = (difference / self.scale).abs();
        self.moved = self.moved.maximum(&moved.nan_to_num(0.0, 0.0, 0.0));
    }

    /// The most that rounding alone moves an element, as a fraction of the scale; 0 before anything is taken in.
    pub fn movement(&self) -> f64 {
        self.moved.max().double_value(&[])
    }

    /// By this row alone. Within its tolerance it passes. Beyond it, what rounding does decides whether the row says
    /// anything, before its errors are held to a bound: how far it is off never makes it uninformative.
    pub fn verdict(&self) -> RowVerdict {
        if self.within_tolerance() {
            RowVerdict::Pass
        } else if self.may_be_uninformative() && self.movement() > UNINFORMATIVE {
            RowVerdict::Uninformative
        } else if self.within_rounding() {
            RowVerdict::Pass
        } else {
            RowVerdict::Fail
        }
    }

    /// Whether all elements are within the tolerance itself; a NaN is within no bound.
    pub fn within_tolerance(&self) -> bool {
        self.relative <= self.tolerance.relative
    }

    /// Elements beyond the tolerance.
    pub fn beyond(&self) -> i64 {
        self.errors.numel() as i64 - self.errors.le(self.tolerance.relative).sum(Kind::Int64).int64_value(&[])
    }

    /// A single step has no room for chaos, and rounding makes no NaN or infinity.
    fn may_be_uninformative(&self) -> bool {
        self.single_step_of.is_none() && self.relative.is_finite()
    }

    /// Whether all elements are within what rounding does to them.
    fn within_rounding(&self) -> bool {
        // What moves half of the elements may move any, though the few probes did not show it.
        let moved = self.moved.maximum(&self.moved.median());
        let bound = (moved * PROBE_MARGIN).clamp(self.tolerance.relative, self.tolerance.chaotic);
        self.errors.le_tensor(&bound).all().int64_value(&[]) != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tolerances::FORWARD;

    /// Scale 1.
    const GOLDEN: [f64; 3] = [1.0, -0.5, 0.25];

    /// A row of errors `off`, whose computation rounding moves by `moved`, both for each element.
    fn row(off: [f64; 3], moved: [f64; 3]) -> ParityRow {
        let sum = |a: [f64; 3], b: [f64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        let of = |values: [f64; 3]| {
            ParityRow::new("out/y", &Tensor::from_slice(&GOLDEN), &Tensor::from_slice(&values), &FORWARD)
        };
        let computed = sum(GOLDEN, off);
        let mut row = of(computed);
        row.allow_for(&of(computed), 1.0);
        row.allow_for(&of(sum(computed, moved)), 1.0);
        row
    }

    #[test]
    fn rounding_beyond_a_tenth_of_the_scale_makes_a_row_uninformative() {
        // However far the row is off: within ten times what rounding does, and far beyond it.
        for off in [0.3, 4.5] {
            assert_eq!(row([0.0, off, 0.0], [0.0, 0.11, 0.0]).verdict(), RowVerdict::Uninformative, "off by {off}");
        }
        assert_eq!(row([0.0, 0.3, 0.0], [0.0, 0.11, 0.0]).movement(), 0.11);
    }

    #[test]
    fn rounding_below_a_tenth_of_the_scale_leaves_a_row_to_its_bound() {
        // The element's bound is ten times 0.09.
        assert_eq!(row([0.0, 0.89, 0.0], [0.0, 0.09, 0.0]).verdict(), RowVerdict::Pass);
        assert_eq!(row([0.0, 0.91, 0.0], [0.0, 0.09, 0.0]).verdict(), RowVerdict::Fail);
    }

    #[test]
    fn being_off_does_not_make_a_row_uninformative() {
        for off in [2e-5, 0.3, 4.5, 1e9] {
            assert_eq!(row([off; 3], [0.0; 3]).verdict(), RowVerdict::Fail, "off by {off}");
        }
        for off in [f64::NAN, f64::INFINITY] {
            assert_eq!(row([off, 0.0, 0.0], [0.0, 0.5, 0.5]).verdict(), RowVerdict::Fail, "off by {off}");
        }
    }

    #[test]
    fn a_larger_movement_counts_in_proportion() {
        let of = |value: f64| ParityRow::new("out/y", &Tensor::from(1.0), &Tensor::from(value), &FORWARD);
        // Eight times the movement moves it by 0.008; the bound is ten times an eighth of that.
        for (off, verdict) in [(0.0099, RowVerdict::Pass), (0.0101, RowVerdict::Fail)] {
            let mut row = of(1.0 + off);
            row.allow_for(&of(1.008 + off), 8.0);
            assert_eq!(row.verdict(), verdict, "off by {off}");
        }
    }

    #[test]
    fn what_is_within_its_tolerance_passes_whatever_rounding_does() {
        assert_eq!(row([9e-6; 3], [0.5; 3]).verdict(), RowVerdict::Pass);
    }

    #[test]
    fn single_step_is_never_uninformative() {
        let of = |value: f64| ParityRow::single_step("out/y", "step by step", &Tensor::from(1.0), &Tensor::from(value));
        let mut row = of(1.3);
        row.allow_for(&of(1.8), 1.0);
        assert!(row.movement() > UNINFORMATIVE);
        assert_eq!(row.verdict(), RowVerdict::Fail);
    }
}
