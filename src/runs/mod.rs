//! The folder of a run: one typed writer and reader for each of its files.

pub mod checkpoint;
pub mod convert;
pub mod folder;
pub mod metrics;
pub mod scores;
pub mod summary;
