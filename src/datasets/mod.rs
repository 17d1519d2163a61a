//! Datasets: making them, reading them, serving them in batches.

pub mod files;
pub mod generators;
mod initial;
pub mod iterators;
mod npz;
pub mod render;
mod resize;
mod samples;
pub mod scene;
pub mod simulate;
pub mod sprites;
pub mod states;
pub mod variant;
