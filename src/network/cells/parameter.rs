//! A physical parameter of an equation, and how a number without bounds stands for it.
//!
//! What is learned, fitted and saved is that number, the *unconstrained* parameter; everything that turns it into the
//! parameter's value or back does so here. A positive parameter is learned as its logarithm.

use std::borrow::Cow;
use std::fmt::{self, Display, Formatter};

use tch::Tensor;

/// The values that a parameter can have, ends not included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bounds {
    /// `value = low + exp(unconstrained)`.
    Above(f64),
    /// `value = low + (high - low) / (1 + exp(-unconstrained))`.
    Between(f64, f64),
}

impl Bounds {
    /// What has no other bounds is positive.
    pub const POSITIVE: Bounds = Bounds::Above(0.0);

    /// The value that an unconstrained parameter stands for.
    pub fn value(self, unconstrained: f64) -> f64 {
        match self {
            Bounds::Above(low) => low + unconstrained.exp(),
            Bounds::Between(low, high) => low + (high - low) / (1.0 + (-unconstrained).exp()),
        }
    }

    /// Derivative of the value by the unconstrained parameter.
    pub fn slope(self, unconstrained: f64) -> f64 {
        match self {
            Bounds::Above(_) => unconstrained.exp(),
            Bounds::Between(low, high) => {
                let share = 1.0 / (1.0 + (-unconstrained).exp());
                (high - low) * share * (1.0 - share)
            }
        }
    }

    /// The unconstrained parameter for a value; not a finite number if the value is not within the bounds.
    pub fn unconstrained(self, value: f64) -> f64 {
        match self {
            Bounds::Above(low) => (value - low).ln(),
            Bounds::Between(low, high) => ((value - low) / (high - value)).ln(),
        }
    }

    /// The values of unconstrained parameters, with gradients.
    pub fn values(self, unconstrained: &Tensor) -> Tensor {
        match self {
            // Added only where there is something to add: a positive parameter keeps its bits.
            Bounds::Above(0.0) => unconstrained.exp(),
            Bounds::Above(low) => unconstrained.exp() + low,
            Bounds::Between(low, high) => unconstrained.sigmoid() * (high - low) + low,
        }
    }

    /// Whether a value lies within the bounds.
    pub fn contain(self, value: f64) -> bool {
        self.unconstrained(value).is_finite()
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
    pub name: Cow<'static, str>,
    /// Name of its unconstrained parameter in the cell's scope, `log_` and the symbol.
    pub variable: Cow<'static, str>,
    /// Power of a length in its unit: what a rescaling of the coordinates does to it.
    pub length_power: i32,
    /// Power of a time in its unit; none where the unit is not known.
    pub time_power: Option<i32>,
    /// Name of the unit where constants of the equation fix it; such a value is the same at any scale.
    pub unit_name: Option<Cow<'static, str>>,
    /// The value it is fixed at, instead of being learned, unless the config says otherwise (`model.fixed`).
    pub fixed: Option<f64>,
    /// In the model's unit of length.
    pub bounds: Bounds,
    /// The value it starts from where the config says nothing (`start`), lengths in true pixels; where there is none the
    /// unconstrained parameter starts at 0.
    pub start: Option<f64>,
}

impl PhysicalParameter {
    /// A positive one that is learned.
    pub const fn learned(name: &'static str, variable: &'static str, length_power: i32) -> Self {
        PhysicalParameter {
            name: Cow::Borrowed(name),
            variable: Cow::Borrowed(variable),
            length_power,
            time_power: None,
            unit_name: None,
            fixed: None,
            bounds: Bounds::POSITIVE,
            start: None,
        }
    }

    /// The same with the power of a time in its unit, so that it can be given in seconds.
    pub const fn with_time(mut self, power: i32) -> Self {
        self.time_power = Some(power);
        self
    }

    /// The same, fixed at a value unless the config says otherwise.
    pub const fn fixed_at(mut self, value: f64) -> Self {
        self.fixed = Some(value);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unconstrained_and_values_are_inverse_and_keep_the_bounds() {
        for bounds in [Bounds::POSITIVE, Bounds::Above(-3.0), Bounds::Between(-2.0, 5.0)] {
            for unconstrained in [-4.0, -0.3, 0.0, 1.0, 3.5] {
                let value = bounds.value(unconstrained);
                assert!(
                    bounds.contain(value) && (bounds.unconstrained(value) - unconstrained).abs() < 1e-12,
                    "{bounds:?} at {unconstrained}"
                );
                let tensor = bounds.values(&Tensor::from(unconstrained)).double_value(&[]);
                assert!((tensor - value).abs() < 1e-12, "{bounds:?} at {unconstrained}: {tensor} and {value}");
            }
            for outside in [-3.0, -7.0, f64::NAN, f64::INFINITY] {
                assert!(!bounds.contain(outside), "{bounds:?} contain {outside}");
            }
        }
        assert_eq!(Bounds::POSITIVE.value(1.3), 1.3f64.exp());
    }
}
