//! Physics-as-Inverse-Graphics.

pub mod base;
pub mod blocks;
pub mod cells;
pub mod checkpoint;
pub mod config;
pub mod datasets;
pub mod device;
pub mod durable;
pub mod initial_values;
pub mod interrupt;
pub mod optimizers;
pub mod physics_models;
pub mod progress;
pub mod recipe;
pub mod run;
pub mod run_folder;
pub mod stn;
pub mod sweep;
pub mod tasks;
pub mod variable_names;
pub mod viz;
