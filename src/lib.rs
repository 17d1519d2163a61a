//! Physics-as-Inverse-Graphics: objects, positions and physical parameters from unlabelled video.
//!
//! A port of Jaques, Burke, Hospedales, *Physics-as-Inverse-Graphics: Unsupervised Physical Parameter Estimation from
//! Video* (ICLR 2020) and of its TensorFlow 1 code onto libtorch. Modules are named after the original's files. To read
//! it beside the paper, follow the data: [`tasks`], [`physics_models`] (encoder, velocity, decoder, losses), [`cells`],
//! [`stn`], then [`recipe`] and [`base`] for the training.

pub mod base;
pub mod blocks;
pub mod cells;
pub mod checkpoint;
pub mod config;
pub mod convert;
pub mod datasets;
pub mod device;
pub mod durable;
pub mod evaluation;
pub mod initial_values;
pub mod interrupt;
pub mod optimizers;
pub mod physics_models;
pub mod progress;
pub mod recipe;
pub mod report;
pub mod rollout;
pub mod run;
pub mod run_folder;
pub mod ssim;
pub mod stn;
pub mod sweep;
pub mod tasks;
pub mod variable_names;
pub mod viz;
