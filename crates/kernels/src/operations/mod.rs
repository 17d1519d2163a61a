//! The operations, one contract each: a function of tensors within libtorch's autograd that chooses between the CPU kernel,
//! the GPU kernel and libtorch, all of which compute the same in float32, with sums in another order.
//!
//! The kernels keep the memory of their inputs for the backward pass: nothing may be written to it in between, and libtorch
//! does not check that. A panic means tensors whose sizes do not fit.

mod convolution;
mod draw;
mod linear;
mod lstm_cell;
mod masked;
mod optimizer;
mod squared_error;
mod unet;

pub use convolution::{Convolution, PreparedConvolution};
pub use draw::{Rendering, compose, draw};
pub use linear::{linear, linear_twice};
pub use lstm_cell::lstm_cell;
pub use masked::masked_frames;
pub use optimizer::descend;
pub use squared_error::squared_error;
pub use unet::UNetOperation;
