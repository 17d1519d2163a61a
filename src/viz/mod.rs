//! A run's pictures and arrays.
//!
//! What the original leaves in its run folder (`base.py`, `physics_models.py`: `example%d.jpg`, the animation,
//! `templates.jpg`, `outputs.npz`, `extra_outputs.npz`; paper: figures 4 and 5), as PNG and with captions, and two
//! plots of the training. Every file appears whole or not at all.
//!
//! A frame as a picture:
//!
//! ```
//! use paig::viz::canvas::{Canvas, picture};
//! use tch::Tensor;
//!
//! // A red frame, [channels, side, side] in 0..1, four times as large, in the middle of a white picture.
//! let frame = Tensor::from_slice(&[1.0_f32, 0.0, 0.0]).reshape([3, 1, 1]).expand([3, 8, 8], false);
//! let mut canvas = Canvas::new(64, 64);
//! canvas.paste(&picture(&frame, 4)?, (16, 16));
//! assert_eq!(canvas.pixels().get_pixel(20, 20).0, [255, 0, 0]);
//! assert_eq!(canvas.pixels().get_pixel(0, 0).0, [255, 255, 255]);
//! # Ok::<(), anyhow::Error>(())
//! ```

mod animation;
mod arrays;
pub mod canvas;
pub mod chart;
mod curves;
pub mod examples;
mod frame_scores;
mod gallery;
pub mod gif;
pub mod grid;
mod masks;
mod rollout;
mod sections;
mod sprites;
mod strip;

use std::path::Path;

use anyhow::{Context, Result, anyhow};

use crate::datasets::iterators::Clips;
use crate::evaluation::outputs::Outputs;
use crate::network::System;
use crate::network::physics_models::PhysicsNet;
use crate::support::error::Error;
use crate::support::storage::storage;

pub use arrays::write_predictions;
pub use curves::write_curves;
pub use frame_scores::{CHART_HEIGHT, frame_charts, frame_spans};
pub use frame_scores::{FRAME_SCORES, write_frame_scores};
pub use gallery::write_gallery;
pub use rollout::{check_rollout_folder, write_rollout};
pub use strip::{read_strip, write_strip};

/// Test clips whose arrays are saved, as in the original.
const SAVED_CLIPS: usize = 100;
/// Numbers that one of these arrays may hold, 256 MiB as float32: some five of them are in memory at a time.
const SAVED_NUMBERS: usize = 1 << 26;

/// Test clips of so many frames whose arrays are saved, if there are as many: 100, fewer of long or large ones.
pub fn saved_clips(system: &System, frames: usize) -> usize {
    let numbers = frames * system.channels * system.side * system.side;
    (SAVED_NUMBERS / numbers.max(1)).clamp(1, SAVED_CLIPS)
}

/// Writes what a model makes of a test set into a run folder, replacing what stood there.
///
/// * `example{i}.png` for the first `examples` clips: input and prediction, truth, reconstruction;
/// * `animation.gif`: the first clips in motion, truth above the model;
/// * `templates.png`: the learned sprites and the background, if the decoder has any;
/// * `encoder_masks.png`: how the encoder segments a few frames;
/// * `outputs.npz`: float32, channels last, of the first 100 clips, fewer of long or large ones: `input`
///   `[clips, T, S, S, C]`, `output` (the predictions) `[clips, T - L, S, S, C]`, `recons`
///   `[clips, L + T_pred, S, S, C]`, `enc_pos` `[clips, L + T_pred, n]` (n coordinates of all objects), `pos_vel_seq`
///   `[clips, 1 + T - L, 2 n]` (positions, then velocities, from the state at the last input frame on);
/// * `extra_outputs.npz`: float32, channels last: `contents` `[N, S/2, S/2, C]` and `templates` `[N, S/2, S/2, 1]`
///   (logits), `background_content` `[1, S, S, C]` (colours), if the decoder has sprites; and for the F frames that one batch of clips
///   reconstructs `transf_contents` `[N + 1, F, S, S, C]`, `transf_masks` `[N + 1, F, S, S, 1]` (the background comes
///   last), `enc_masks` `[F, S, S, N + 1]`, `masked_objs` `[N, F, S, S, C]`.
///
/// # Errors
/// No test clips, clips shorter than L + T_pred, frames with neither 1 nor 3 channels, a folder that cannot be written.
pub fn write_artifacts(folder: &Path, model: &PhysicsNet, test: &Clips, examples: usize) -> Result<(), Error> {
    let _guard = tch::no_grad_guard();
    if test.is_empty() {
        return Err(anyhow!("there are no test clips to show").into());
    }
    storage().create_folder(folder).with_context(|| format!("cannot create the run folder {}", folder.display()))?;
    let saved = saved_clips(&model.system, test.time());
    let outputs = Outputs::of(model, test, saved.max(examples))?;
    examples::write(folder, &model.system, &outputs, examples)?;
    animation::write(&folder.join("animation.gif"), &model.system, &outputs)?;
    if let Some(sprites) = model.decoder.sprites() {
        sprites::write(&folder.join("templates.png"), &model.system, &sprites)?;
    }
    masks::write(&folder.join("encoder_masks.png"), model, test)?;
    arrays::write_outputs(&folder.join("outputs.npz"), &outputs, saved)?;
    Ok(arrays::write_extra_outputs(&folder.join("extra_outputs.npz"), model, test)?)
}

#[cfg(test)]
mod tests {
    use super::{SAVED_CLIPS, saved_clips};
    use crate::tasks;

    #[test]
    fn fewer_clips_are_saved_of_long_ones_alone() {
        for task in tasks::all() {
            assert_eq!(saved_clips(&task.system, task.test_frames), SAVED_CLIPS, "{}", task.name);
        }
        // 64 x 64 pixels of three channels: 12,288 numbers a frame.
        let system = tasks::builtin("mnist_spring_color").unwrap().system;
        assert_eq!([1_000, 1_000_000].map(|frames| saved_clips(&system, frames)), [5, 1]);
    }
}
