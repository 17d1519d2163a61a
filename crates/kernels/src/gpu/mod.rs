//! The dearest computations of a training step written for GPUs (`*.cu`): the U-Net, masked frames, the drawing of sprites, the
//! squared error, the roll-out of an equation, and the optimizer's step.
//!
//! libtorch takes them one by one, each a pass through the GPU's memory; at 8 to 128 channels its convolutions reach
//! less than a tenth of what a GPU can do. CUDA's compiler makes them where it is at hand when the program is built. Where it is not, the same text
//! is compiled for the processor (`device.h`), for the tests alone, and libtorch computes on the GPU.

mod convolution;
mod launch;
mod logits;
mod masks;
mod optimizer;
pub mod roll_out;
mod sprites;
mod squared_error;
#[doc(hidden)]
pub mod testing;
mod unet;

pub use convolution::fits;
pub use launch::{suits, supports};
pub use masks::{can_part, parted};
pub use optimizer::{can_update, descend};
pub use sprites::{can_draw, draw};
pub use squared_error::squared_error;
pub use unet::unet;
