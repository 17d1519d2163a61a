//! End-to-end baselines: they see frames and know neither the equation nor the encoder and decoder of this program.
//!
//! Paper: section 4. [`frame_model`] is what they have in common; VideoLSTM and DDPAE are the paper's, the small PlaNet is for
//! control. [`training`] trains each in a folder of its own.

pub mod checkpoint;
pub mod config;
pub mod conv_lstm;
mod data;
pub mod ddpae;
mod descent;
pub mod frame_model;
pub mod gaussian;
pub mod planet;
pub mod scores;
pub mod training;
pub mod video_lstm;
