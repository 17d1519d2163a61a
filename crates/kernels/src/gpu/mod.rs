//! The dearest computations of a training step written for GPUs (`*.cu`): the U-Net, masked frames, the drawing of sprites, the
//! squared error, the roll-out of an equation, and the optimizer's step.
//!
//! libtorch takes them one by one, each a pass through the GPU's memory; at 8 to 128 channels its convolutions reach
//! less than a tenth of what a GPU can do. CUDA's compiler makes them where it is at hand when the program is built. Where it is not, the same text
//! is compiled for the processor (`device.h`), for the tests alone, and libtorch computes on the GPU.

mod convolution;
mod error;
mod launch;
mod logits;
mod masks;
mod optimizer;
pub mod roll_out;
mod sprites;
#[doc(hidden)]
pub mod testing;
mod unet;

pub use convolution::fits;
pub use error::squared_error;
pub use launch::{serve, suits};
pub use masks::parted;
pub use optimizer::{Rule, Updated, descend};
pub use sprites::draw;
pub use unet::unet;
