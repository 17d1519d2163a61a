//! The physical parameters of a model.

use anyhow::{Result, ensure};
use tch::Tensor;

use super::PhysicsNet;
use crate::network::cells::PhysicalParameter;

/// A parameter of a model's equation.
#[derive(Debug)]
pub struct Parameter {
    pub kind: PhysicalParameter,
    /// The number without bounds that stands for the value, a scalar: the logarithm of a positive one. Lengths are in the
    /// model's unit of position.
    pub unconstrained: Tensor,
    /// The unconstrained parameter with which it begins where a config says nothing; of one that is fixed its own.
    pub usual_start: f64,
    /// Otherwise it is fixed.
    pub learned: bool,
}

/// The unconstrained parameter for a value in the model's unit.
pub(super) fn unconstrained_within(kind: &PhysicalParameter, value: f64) -> Result<f64> {
    let PhysicalParameter { name, bounds, .. } = kind;
    ensure!(bounds.contain(value), "parameter {name} = {value} in the model's unit: must be {bounds}");
    Ok(bounds.unconstrained(value))
}

impl PhysicsNet {
    /// Whether it matters to the equation which object is which, as its parameters are held.
    pub(crate) fn tells_objects_apart(&self) -> bool {
        let held = self
            .parameters
            .iter()
            .map(|parameter| (!parameter.learned).then(|| parameter.unconstrained.double_value(&[])));
        self.system.cell.tells_objects_apart(&held.collect::<Vec<_>>())
    }

    /// The parameters that are learned.
    pub fn learned(&self) -> impl Iterator<Item = &Parameter> {
        self.parameters.iter().filter(|parameter| parameter.learned)
    }

    /// Sets a learned parameter by its unconstrained value: of a positive one the logarithm.
    pub fn set_unconstrained(&self, parameter: &Parameter, unconstrained: f64) {
        let _guard = tch::no_grad_guard();
        let _ = parameter.unconstrained.shallow_clone().fill_(unconstrained);
    }

    /// Sets a parameter that is learned, lengths in true pixels.
    ///
    /// # Errors
    /// A value that is not within the parameter's bounds.
    pub fn set_value(&self, parameter: &Parameter, value: f64) -> Result<()> {
        self.set_unconstrained(
            parameter,
            unconstrained_within(&parameter.kind, value / self.true_unit(&parameter.kind))?,
        );
        Ok(())
    }

    /// The value that an unconstrained parameter stands for, lengths in true pixels.
    pub fn true_value(&self, kind: &PhysicalParameter, unconstrained: f64) -> f64 {
        kind.bounds.value(unconstrained) * self.true_unit(kind)
    }

    /// The learned parameters as `(symbol, value)`, lengths in true pixels whatever the decoder's scale.
    pub fn parameter_values(&self) -> Vec<(&str, f64)> {
        self.learned().map(|p| (&*p.kind.name, self.true_value(&p.kind, p.unconstrained.double_value(&[])))).collect()
    }

    /// What one model unit of a parameter is in true pixels.
    fn true_unit(&self, kind: &PhysicalParameter) -> f64 {
        self.options.length_per_unit(&self.system).powi(kind.length_power)
    }
}
