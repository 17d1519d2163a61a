//! The choice of the implementation that computes an operation.

use serde::{Deserialize, Serialize};
use tch::{Device, Kind, Tensor};

use super::gpu;

/// The implementations that a caller allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kernels {
    /// The kernels of this crate, in float32, on the CPU and on GPUs that they were compiled for; otherwise libtorch.
    #[default]
    Own,
    /// libtorch alone.
    Libtorch,
}

/// One implementation of an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Backend {
    Cpu,
    Gpu,
    Libtorch,
}

impl Kernels {
    /// The implementation for these tensors. An operation may have further conditions on their sizes.
    pub(super) fn backend(self, tensors: &[&Tensor]) -> Backend {
        match self {
            Kernels::Own if cpu_supports(tensors) => Backend::Cpu,
            Kernels::Own if gpu::supports(tensors) => Backend::Gpu,
            Kernels::Own | Kernels::Libtorch => Backend::Libtorch,
        }
    }
}

/// Whether the CPU kernels can compute with these tensors: float32 in main memory.
pub fn cpu_supports(tensors: &[&Tensor]) -> bool {
    tensors.iter().all(|tensor| tensor.kind() == Kind::Float && tensor.device() == Device::Cpu)
}
