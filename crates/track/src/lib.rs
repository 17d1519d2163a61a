//! Tracks.
#![forbid(unsafe_code)]
mod background;
mod components;
mod difference;
mod error;
mod exposure;
mod linking;
mod mask;
mod options;
mod statistics;
mod video;
pub use background::Background;
pub use error::Error;
pub use options::{Hint, Options, Region};
pub use video::{Clip, Size, Video};
