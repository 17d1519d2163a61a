//! The folder of a run: one typed writer and reader for each of its files.

pub mod checkpoint;
pub(crate) mod config_file;
pub mod convert;
pub mod course;
pub mod find;
pub mod folder;
pub mod metrics;
pub mod names;
pub mod run;
pub mod run_config;
pub mod scores;
pub mod summary;
pub(crate) mod tensorboard;
pub mod verdict;
pub mod weights;
