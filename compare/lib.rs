//! The port beside the original: tensors ([`parity`], against golden files), and timings ([`speed`]).

mod cases;
mod harness;
pub mod parity;
pub mod speed;
mod tolerances;
