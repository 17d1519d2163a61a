//! Physics-as-Inverse-Graphics: objects, positions and physical parameters from unlabelled video.
//!
//! A port of Jaques, Burke, Hospedales, *Physics-as-Inverse-Graphics: Unsupervised Physical Parameter Estimation from
//! Video* (ICLR 2020) and of its TensorFlow 1 code onto libtorch.

pub mod cli;
pub mod datasets;
pub mod evaluation;
pub mod generators;
pub mod network;
pub mod report;
pub mod runs;
pub mod support;
pub mod sweep;
pub mod tasks;
pub mod training;
pub mod viz;
