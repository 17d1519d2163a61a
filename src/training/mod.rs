//! Training: the loops, the optimizers, the config, the phases.

pub mod anchors;
pub mod base;
pub mod config;
pub mod discover;
pub mod guide;
pub mod identify;
pub mod join;
pub mod optimizers;
pub mod phases;
pub mod recentre;
pub mod schedule;
pub mod velocity_fit;
