//! Training: the loop, the optimizers, the config, and the phases, each in a file with its config.
//!
//! Read [`base`] (the loop), then the phases in their order: [`discover`], [`identify`] (or [`pretrain`], where a black box
//! is in the place of the physics), [`join`]. A [`trainer::Trainer`]
//! goes through them.

pub mod base;
pub mod config;
pub mod discover;
pub(crate) mod footprint;
mod guide_clock;
pub mod identify;
pub mod join;
pub mod layers;
pub mod objective;
pub mod objects;
pub mod observer;
pub mod optimizers;
pub mod phase;
pub mod pretrain;
mod ranges;
pub mod recorder;
pub mod saved;
pub mod schedule;
pub(crate) mod tensorboard;
pub mod trained;
pub mod trainer;
pub mod verdict;
