//! A physical parameter of an equation, and how a number without bounds stands for it.
//!
//! What is learned, fitted and saved is that number, the *raw* value; everything that turns it into the parameter's value
//! or back does so here. A positive parameter is learned as its logarithm.

use std::fmt::{self, Display, Formatter};

use tch::Tensor;

/// The values that a parameter can have, ends not included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bounds {
    /// `value = low + exp(raw)`.
    Above(f64),
    /// `value = low + (high - low) / (1 + exp(-raw))`.
    Between(f64, f64),
}

impl Bounds {
    /// What has no other bounds is positive.
    pub const POSITIVE: Bounds = Bounds::Above(0.0);

    /// The value that a raw number stands for.
    pub fn value(self, raw: f64) -> f64 {
        match self {
            Bounds::Above(low) => low + raw.exp(),
            Bounds::Between(low, high) => low + (high - low) / (1.0 + (-raw).exp()),
        }
    }

    /// Derivative of the value by the raw number.
    pub fn slope(self, raw: f64) -> f64 {
        match self {
            Bounds::Above(_) => raw.exp(),
            Bounds::Between(low, high) => {
                let share = 1.0 / (1.0 + (-raw).exp());
                (high - low) * share * (1.0 - share)
            }
        }
    }

    /// The raw number of a value; not a finite number if the value is not within the bounds.
    pub fn raw(self, value: f64) -> f64 {
        match self {
            Bounds::Above(low) => (value - low).ln(),
            Bounds::Between(low, high) => ((value - low) / (high - value)).ln(),
        }
    }

    /// The values of raw numbers, with gradients.
    pub fn values(self, raw: &Tensor) -> Tensor {
        match self {
            // Added only where there is something to add: a positive parameter keeps its bits.
            Bounds::Above(0.0) => raw.exp(),
            Bounds::Above(low) => raw.exp() + low,
            Bounds::Between(low, high) => raw.sigmoid() * (high - low) + low,
        }
    }

    /// Whether a value lies within the bounds.
    pub(crate) fn contain(self, value: f64) -> bool {
        self.raw(value).is_finite()
    }
}

impl Display for Bounds {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        match self {
            Bounds::Above(0.0) => write!(f, "a positive number"),
            Bounds::Above(low) => write!(f, "a number above {low}"),
            Bounds::Between(low, high) => write!(f, "a number between {low} and {high}"),
        }
    }
}

/// A parameter of an equation. It is learned as a number without bounds: of a positive one its logarithm.
#[derive(Debug, Clone, PartialEq)]
pub struct PhysicalParameter {
    /// Symbol of the paper, the key under `parameters` in `summary.json`.
    pub name: &'static str,
    /// Name of its raw number in the cell's scope, `log_` and the symbol.
    pub variable: &'static str,
    /// Power of a length in its unit: what a rescaling of the coordinates does to it.
    pub length_power: i32,
    /// Power of a time in its unit; none where the unit is not known.
    pub time_power: Option<i32>,
    /// The value it is fixed at, instead of being learned, unless the config says otherwise (`model.fixed`).
    pub fixed: Option<f64>,
    /// In the model's unit of length.
    pub bounds: Bounds,
    /// The value it starts from where the config says nothing (`start`), lengths in true pixels; where there is none the
    /// raw number starts at 0.
    pub start: Option<f64>,
}

impl PhysicalParameter {
    /// A positive one that is learned.
    pub const fn learned(name: &'static str, variable: &'static str, length_power: i32) -> Self {
        PhysicalParameter {
            name,
            variable,
            length_power,
            time_power: None,
            fixed: None,
            bounds: Bounds::POSITIVE,
            start: None,
        }
    }

    /// The same with the power of a time in its unit, so that it can be given in seconds.
    pub const fn with_time(self, power: i32) -> Self {
        PhysicalParameter { time_power: Some(power), ..self }
    }

    /// The same, fixed at a value unless the config says otherwise.
    pub const fn fixed_at(self, value: f64) -> Self {
        PhysicalParameter { fixed: Some(value), ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn raw_numbers_and_values_are_inverse_and_keep_the_bounds() {
        for bounds in [Bounds::POSITIVE, Bounds::Above(-3.0), Bounds::Between(-2.0, 5.0)] {
            for raw in [-4.0, -0.3, 0.0, 1.0, 3.5] {
                let value = bounds.value(raw);
                assert!(bounds.contain(value) && (bounds.raw(value) - raw).abs() < 1e-12, "{bounds:?} at {raw}");
                let tensor = bounds.values(&Tensor::from(raw)).double_value(&[]);
                assert!((tensor - value).abs() < 1e-12, "{bounds:?} at {raw}: {tensor} and {value}");
            }
            for outside in [-3.0, -7.0, f64::NAN, f64::INFINITY] {
                assert!(!bounds.contain(outside), "{bounds:?} contain {outside}");
            }
        }
        assert_eq!(Bounds::POSITIVE.value(1.3), 1.3f64.exp());
    }
}
