//! The network's dearest computations, written for the processor, forward and backward: the U-Net, masked frames, the
//! first dense layer that sees them, the drawing of sprites, the squared error, and the optimizer's step; and, for
//! comparison, the layers of a convolutional LSTM. [`gpu`] has those for GPUs.
//!
//! libtorch's convolutions reach half of a core's speed or less at 3 to 64 channels, and every one of the passes between
//! them goes through memory. Here the frames of a batch stand side by side in blocks, one in each lane of a vector, so
//! that all operations are on whole vectors whatever the number of channels, and a block stays in the cache from layer
//! to layer. The mathematics is that of libtorch, in float32; sums are in another order. What is not a number stays so.
//!
//! This is the only module with unsafe code: vectors of the processor's own width, chosen at run time; the tensors'
//! memory; the processor's control register; the node in libtorch's autograd graph; work that is shared out among threads;
//! and work on a GPU, recorded or by kernels. All pointers come from slices whose lengths are checked once for each operation, on
//! the way into it, or from tensors whose sizes are; checks for every pixel would cost as much as the arithmetic.

#![deny(clippy::print_stdout, clippy::print_stderr, clippy::exit)]

use serde::{Deserialize, Serialize};

mod adam;
mod autograd;
mod capability;
mod convolution;
mod cuda;
mod dense;
mod error;
mod exponential;
mod filtering;
pub mod gpu;
mod lanes;
mod masks;
mod memory;
mod mix;
mod panics;
mod planes;
mod recycled;
mod resample;
mod sprites;
mod subnormals;
mod tensors;
mod threads;
mod unet;
mod vector_path;
mod weight_gradient;
mod winograd;

pub use adam::AdamStep;
pub use autograd::forget_gradient;
pub use capability::libtorch_capability;
pub use cuda::{Repeated, allow_tf32, own_stream};
pub use lanes::Instructions;
pub use sprites::Scene;
pub use subnormals::{Flushing, flush_subnormals};
pub use tensors::{
    ConvolutionKernel, PreparedConvolution, UNetKernel, adam, draw, linear, masked, memory_step, serve, squared_error,
    taught_through,
};
pub use threads::{KernelsAlone, in_parallel};
pub use unet::Shape;
pub use vector_path::vector_path;

/// Version of the libtorch that this was built with.
pub const LIBTORCH_VERSION: &str = env!("PAIG_LIBTORCH_VERSION");

/// What computes what this module can.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kernels {
    /// The kernels of this module, in float32, on the processor and on GPUs that they were compiled for; otherwise libtorch.
    #[default]
    Own,
    /// libtorch's convolutions and autograd.
    Libtorch,
}
