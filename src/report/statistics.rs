//! Median and range.

use serde::Serialize;

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Spread {
    pub median: f64,
    pub min: f64,
    pub max: f64,
}

impl Spread {
    /// None without values.
    pub(super) fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.collect();
        values.sort_by(f64::total_cmp);
        let (&min, &max) = (values.first()?, values.last()?);
        let middle = values.len() / 2;
        let median = if values.len() % 2 == 1 { values[middle] } else { (values[middle - 1] + values[middle]) / 2.0 };
        Some(Spread { median, min, max })
    }

    /// All values times a positive factor.
    pub(super) fn times(&self, factor: f64) -> Self {
        Spread { median: factor * self.median, min: factor * self.min, max: factor * self.max }
    }

    /// `median [min, max]`, each written by `digits`; one number where all are the same.
    pub(super) fn text(&self, digits: impl Fn(f64) -> String) -> String {
        if self.min == self.max {
            return digits(self.median);
        }
        format!("{} [{}, {}]", digits(self.median), digits(self.min), digits(self.max))
    }
}

/// Four significant digits, without an exponent for numbers of everyday size.
pub(super) fn significant(value: f64) -> String {
    if value != 0.0 && !(1e-4..1e6).contains(&value.abs()) {
        return format!("{value:.3e}");
    }
    let before = if value == 0.0 { 1 } else { value.abs().log10().floor() as i32 + 1 };
    format!("{value:.*}", (4 - before).clamp(0, 6) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_of_odd_and_even_counts() {
        assert_eq!(Spread::of([].into_iter()), None);
        assert_eq!(Spread::of([3.0, 1.0, 2.0].into_iter()), Some(Spread { median: 2.0, min: 1.0, max: 3.0 }));
        assert_eq!(Spread::of([4.0, 1.0, 2.0, 3.0].into_iter()), Some(Spread { median: 2.5, min: 1.0, max: 4.0 }));
    }

    #[test]
    fn four_digits() {
        let written = [3.99079, 60.0, 0.0360549, 123.456, 1632.85, 0.0, 1e-7].map(significant);
        assert_eq!(written, ["3.991", "60.00", "0.03605", "123.5", "1633", "0.000", "1.000e-7"]);
    }
}
