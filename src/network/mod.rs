//! The network: encoder, velocity estimator, physics, decoder. Original: `nn/network`.

pub mod blocks;
pub mod cells;
pub mod dynamics;
pub mod initial_values;
pub mod physics_models;
pub mod stn;
pub mod system;
pub mod variable_names;

pub use system::System;
