//! Numbers beside the accelerations of an equation: given ones, or parameters.

use anyhow::{Context, Result, ensure};
use tch::{Kind, Tensor};

use super::parameters::Parameters;
use super::table_number::TableNumber;
use super::units::Unit;

/// A number that the table gives, or a parameter by its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum EquationNumber {
    Number(f64),
    Parameter(usize),
}

impl EquationNumber {
    pub(super) fn among(self, parameters: impl Fn(usize) -> f64) -> f64 {
        match self {
            EquationNumber::Number(number) => number,
            EquationNumber::Parameter(place) => parameters(place),
        }
    }

    /// A scalar, differentiable by the parameter.
    pub(super) fn tensor(self, parameters: &[Tensor], options: (Kind, tch::Device)) -> Tensor {
        match self {
            EquationNumber::Number(number) => Tensor::full([0_i64; 0], number, options),
            EquationNumber::Parameter(place) => parameters[place].shallow_clone(),
        }
    }

    /// Reads a number, or the name of a parameter, which is marked as `used`. The key, unit and meaning are for messages.
    ///
    /// # Errors
    /// A parameter that is not there or has another unit.
    pub(super) fn read(
        given: &TableNumber,
        (key, unit, what): (&str, Unit, &str),
        parameters: &Parameters,
        used: &mut [bool],
    ) -> Result<Self> {
        let name = match given {
            TableNumber::Number(number) => return Ok(EquationNumber::Number(*number)),
            TableNumber::Parameter(name) => name,
        };
        let place = parameters.place(name);
        let place = place.with_context(|| format!("{key} = {name:?}: there is no such parameter"))?;
        let its = parameters.all[place].unit;
        ensure!(
            its == Unit::Any || unit == Unit::Any || its == unit,
            "{key} = {name:?}: has the unit {its}, but is {what}"
        );
        used[place] = true;
        Ok(EquationNumber::Parameter(place))
    }

    /// Whether it is above 0 whatever is learned.
    pub(super) fn is_positive(self, parameters: &Parameters) -> bool {
        match self {
            EquationNumber::Number(number) => number > 0.0 && number.is_finite(),
            EquationNumber::Parameter(place) => parameters.all[place].range()[0] >= 0.0,
        }
    }

    /// Reads a mass.
    ///
    /// # Errors
    /// One that can be 0 or less, and as [`Self::read`].
    pub(super) fn mass(given: &TableNumber, key: &str, parameters: &Parameters, used: &mut [bool]) -> Result<Self> {
        let value = Self::read(given, (key, Unit::Any, "a mass"), parameters, used)?;
        ensure!(value.is_positive(parameters), "{key}: each must be more than 0");
        Ok(value)
    }

    /// Reads a coefficient of friction.
    ///
    /// # Errors
    /// One that can be negative, and as [`Self::read`].
    pub(super) fn friction(given: &TableNumber, key: &str, parameters: &Parameters, used: &mut [bool]) -> Result<Self> {
        let value = Self::read(given, (key, Unit::NONE, "a plain number"), parameters, used)?;
        let least = match value {
            EquationNumber::Number(number) if !number.is_finite() => f64::NAN,
            EquationNumber::Number(number) => number,
            EquationNumber::Parameter(place) => parameters.all[place].range()[0],
        };
        ensure!(least >= 0.0, "{key}: must be 0 or more");
        Ok(value)
    }

    /// Reads a coefficient of restitution.
    ///
    /// # Errors
    /// One that can lie outside of 0 to 1, and as [`Self::read`].
    pub(super) fn restitution(
        given: &TableNumber,
        key: &str,
        parameters: &Parameters,
        used: &mut [bool],
    ) -> Result<Self> {
        let value = Self::read(given, (key, Unit::NONE, "a plain number"), parameters, used)?;
        let ([least, most], hint) = match value {
            EquationNumber::Number(number) => ([number; 2], String::new()),
            EquationNumber::Parameter(place) => {
                let parameter = &parameters.all[place];
                (parameter.range(), format!("; say low = 0 and high = 1 of {}", parameter.name))
            }
        };
        let named = match given {
            TableNumber::Number(number) => number.to_string(),
            TableNumber::Parameter(name) => format!("{name:?}"),
        };
        ensure!(least >= 0.0 && most <= 1.0, "{key} = {named}: must be 0 to 1{hint}");
        Ok(value)
    }
}
