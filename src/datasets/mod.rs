//! What a training reads: dataset files, true states for scoring, clips in batches.

pub mod dataset;
pub mod files;
pub mod film;
pub mod iterators;
mod light;
pub mod npz;
mod reader;
pub mod settings;
mod split_content;
pub mod states;
pub(crate) mod unpacked;
