//! The choice of the implementation that computes an operation.

use serde::{Deserialize, Serialize};
use tch::{Device, Kind, Tensor};

use super::gpu;
use super::simd::Instructions;
use super::vector_path::vector_path;

/// The implementations that a caller allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kernels {
    /// The kernels of this crate, in float32, on the CPU and on GPUs that they were compiled for; otherwise libtorch. On the
    /// CPU with the instructions of [`vector_path`], which may name libtorch.
    #[default]
    Own,
    /// libtorch alone.
    Libtorch,
    /// The CPU kernels with these instructions, whatever [`vector_path`] names, and however few frames there are: to test and to
    /// compare them. In no config.
    #[serde(skip)]
    With(Instructions),
}

/// One implementation of an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Backend {
    /// The CPU kernels, with these instructions.
    Cpu(Instructions),
    Gpu,
    Libtorch,
}

impl Kernels {
    /// The instructions of the CPU kernels; none where libtorch computes on the CPU.
    ///
    /// # Panics
    /// A `PAIG_INSTRUCTIONS` that [`vector_path`] refuses.
    pub(super) fn instructions(self) -> Option<Instructions> {
        match self {
            Kernels::Own => vector_path().as_ref().copied().unwrap_or_else(|why| panic!("{why}")),
            Kernels::Libtorch => None,
            Kernels::With(instructions) => Some(instructions),
        }
    }

    /// The implementation for these tensors. An operation may have further conditions on their sizes.
    ///
    /// # Panics
    /// As [`Kernels::instructions`].
    pub(super) fn backend(self, tensors: &[&Tensor]) -> Backend {
        match self.instructions() {
            Some(instructions) if on_cpu(tensors) => Backend::Cpu(instructions),
            _ if self != Kernels::Libtorch && gpu::supports(tensors) => Backend::Gpu,
            _ => Backend::Libtorch,
        }
    }
}

/// Whether all are float32 in main memory.
fn on_cpu(tensors: &[&Tensor]) -> bool {
    tensors.iter().all(|tensor| tensor.kind() == Kind::Float && tensor.device() == Device::Cpu)
}
