//! Median, range and comparison.

use serde::{Deserialize, Serialize};

/// Standard deviation of normal numbers whose median size is 1.
pub const MEDIAN_TO_DEVIATION: f64 = 1.4826;

/// The middle one of some numbers, of an even count the upper of the two; none without numbers.
pub fn upper_median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Whether an error is smaller than another; what is not a number is the largest, whatever its sign bit says.
pub fn is_smaller(error: f64, other: f64) -> bool {
    error < other || other.is_nan() && !error.is_nan()
}

/// How some numbers are spread.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    pub median: f64,
    pub min: f64,
    pub max: f64,
}

impl Spread {
    /// None without values.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.into_iter().collect();
        values.sort_by(f64::total_cmp);
        let (&min, &max) = (values.first()?, values.last()?);
        let middle = values.len() / 2;
        let median = if values.len() % 2 == 1 { values[middle] } else { (values[middle - 1] + values[middle]) / 2.0 };
        Some(Spread { median, min, max })
    }

    /// All values times a positive factor.
    pub fn times(&self, factor: f64) -> Self {
        Spread { median: factor * self.median, min: factor * self.min, max: factor * self.max }
    }

    /// `median [min, max]`, each written by `digits`; one number where all are the same.
    pub fn text(&self, digits: impl Fn(f64) -> String) -> String {
        if self.min == self.max {
            return digits(self.median);
        }
        format!("{} [{}, {}]", digits(self.median), digits(self.min), digits(self.max))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_of_odd_and_even_counts() {
        assert_eq!((Spread::of([]), upper_median([])), (None, None));
        assert_eq!((upper_median([3.0, 1.0, 2.0]), upper_median([4.0, 1.0, 2.0, 3.0])), (Some(2.0), Some(3.0)));
        assert_eq!(Spread::of([3.0, 1.0, 2.0]), Some(Spread { median: 2.0, min: 1.0, max: 3.0 }));
        assert_eq!(Spread::of([4.0, 1.0, 2.0, 3.0]), Some(Spread { median: 2.5, min: 1.0, max: 4.0 }));
    }

    /// A difference of infinities is a NaN with a sign on some processors, which an order of all numbers puts first.
    #[test]
    fn no_number_is_the_largest_error() {
        for none in [f64::NAN, -f64::NAN] {
            assert!(is_smaller(3.0, none) && !is_smaller(none, 3.0) && !is_smaller(none, none));
        }
        assert!(is_smaller(2.0, 3.0) && !is_smaller(3.0, 3.0) && is_smaller(3.0, f64::INFINITY));
    }
}
