//! What the training loop needs of a model.

use anyhow::Result;
use tch::Device;

use crate::datasets::iterators::Clips;
use crate::evaluation;
use crate::network::physics_models::losses::MeanLosses;
use crate::network::physics_models::{PhysicsNet, VariableGroup};
use crate::runs::weights::NamedTensors;
use paig_kernels::Kernels;

/// A model that a [`Session`](super::base::Session) can train.
pub trait Trainable {
    /// Parts of the model that may have learning rates of their own.
    type Group;

    /// All variables with their names, sorted by name.
    fn named_variables(&self) -> NamedTensors;

    fn device(&self) -> Device;

    /// What computes the optimizer's steps.
    fn kernels(&self) -> Kernels;

    /// The part that a variable belongs to.
    fn group(&self, name: &str) -> Self::Group;

    /// The physical parameters, for the records; none without an equation.
    fn parameter_values(&self) -> Vec<(&str, f64)> {
        Vec::new()
    }

    /// The losses on the first `count` clips, `pass` at a time.
    ///
    /// # Errors
    /// Clips that are too short.
    fn mean_losses(&self, clips: &Clips, count: usize, pass: usize) -> Result<MeanLosses>;
}

impl Trainable for PhysicsNet {
    type Group = VariableGroup;

    fn named_variables(&self) -> NamedTensors {
        PhysicsNet::named_variables(self)
    }

    fn device(&self) -> Device {
        self.variables.device()
    }

    fn kernels(&self) -> Kernels {
        self.options.kernels
    }

    fn group(&self, name: &str) -> VariableGroup {
        PhysicsNet::group(self, name)
    }

    fn parameter_values(&self) -> Vec<(&str, f64)> {
        PhysicsNet::parameter_values(self)
    }

    fn mean_losses(&self, clips: &Clips, count: usize, pass: usize) -> Result<MeanLosses> {
        evaluation::mean_losses(self, clips, count, pass)
    }
}
