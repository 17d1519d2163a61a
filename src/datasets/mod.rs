//! What a training reads: dataset files, true states for scoring, clips in batches.
//!
//! Clips of your own:
//!
//! ```
//! use ndarray::Array5;
//! use paig::datasets::iterators::Clips;
//! use tch::Device;
//!
//! // Three clips of twelve frames, [clips, time, side, side, channels].
//! let pixels = Array5::<u8>::zeros((3, 12, 32, 32, 3));
//! let clips = Clips::new(&pixels, None, Device::Cpu);
//! assert_eq!((clips.len(), clips.time()), (3, 12));
//! // The first ten frames of two clips, [batch, time, channels, side, side] in 0..1.
//! assert_eq!(clips.batch(&[0, 2], 10).size(), [2, 10, 3, 32, 32]);
//! ```

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
