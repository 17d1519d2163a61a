//! Physics-as-Inverse-Graphics.

pub mod blocks;
pub mod cells;
pub mod datasets;
pub mod initial_values;
pub mod optimizers;
pub mod physics_models;
pub mod stn;
pub mod tasks;
