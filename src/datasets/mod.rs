//! What a training reads: dataset files, true states for scoring, clips in batches.

pub mod files;
pub mod film;
pub mod iterators;
pub(crate) mod npz;
pub mod settings;
pub mod states;
