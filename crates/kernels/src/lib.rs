//! The network's costliest operations, written for the CPU and for GPUs, forward and backward: the U-Net, masked frames, the
//! first dense layer after them, the drawing of sprites, the squared error, the roll-out of an equation, and the optimizer's
//! step; and, for the baselines, the layers of a convolutional LSTM.
//!
//! `operations` has one contract for each, which chooses between the CPU kernel (the files beside it), the GPU kernel
//! ([`gpu`]) and libtorch. [`Kernels`] is the caller's say in that, and `backend.rs` the one place of the choice.
//!
//! libtorch's convolutions reach half of a core's speed or less at 3 to 64 channels, and every one of the passes between
//! them goes through memory. Here the frames of a batch stand side by side in blocks, one in each lane of a vector, so
//! that all operations are on whole vectors whatever the number of channels, and a block stays in the cache from layer
//! to layer. The mathematics is that of libtorch, in float32; sums are in another order. A NaN stays a NaN.
//!
//! This is the only crate with unsafe code: vectors of the processor's own width, chosen at run time; the tensors'
//! memory; the processor's control register; the node in libtorch's autograd graph; work that is shared out among threads;
//! and work on a GPU, recorded or by kernels. All pointers come from slices whose lengths are checked once for each operation, on
//! the way into it, or from tensors whose sizes are; checks for every pixel would cost as much as the arithmetic.

#![deny(clippy::print_stdout, clippy::print_stderr, clippy::exit)]

mod adam;
mod autograd;
mod backend;
mod bias_gradient;
mod capability;
mod conv1x1;
mod convolution;
mod cuda;
mod dense;
mod exponential;
mod filtering;
pub mod gpu;
mod interpolation;
mod lstm_cell;
mod masks;
mod operations;
mod packing;
mod panics;
mod planes;
mod recycled;
mod resample;
mod simd;
mod sprites;
mod squared_error;
mod subnormals;
mod tensors;
mod threads;
mod unet;
mod update;
mod vector_path;
mod weight_gradient;
mod winograd;

pub use autograd::forget_gradient;
pub use backend::Kernels;
pub use capability::libtorch_capability;
pub use cuda::{Repeated, allow_tf32, own_stream};
pub use interpolation::{AxisSample, hat_matrix, resize_bilinear_x2, sample_separable};
pub use operations::{
    Convolution, PreparedConvolution, Rendering, UNetOperation, compose, descend, draw, linear, linear_twice,
    lstm_cell, masked_frames, squared_error,
};
pub use simd::Instructions;
pub use sprites::SceneSizes;
pub use subnormals::{Flushing, flush_subnormals};
pub use threads::{KernelsAlone, in_parallel};
pub use unet::Shape;
pub use update::{Rate, Rule, Updated};
pub use vector_path::vector_path;

/// Version of the libtorch that this was built with.
pub const LIBTORCH_VERSION: &str = env!("PAIG_LIBTORCH_VERSION");
