//! How low the losses of a scene can get.

use anyhow::Result;
use rayon::prelude::*;

use super::effects::{develop, expose};
use super::render::Renderer;
use super::source_images::SourceImages;
use super::streams::{Purpose, Streams};
use super::variant::Variant;
use crate::datasets::files::Split;
use crate::datasets::settings::NoiseFloor;
use crate::tasks::camera::Camera;

/// Motions that are filmed, and films of each.
const CLIPS: usize = 4;
const TAKES: usize = 16;

/// What is left of the losses of a model that knows the motion and, wherever anything else is drawn by chance, draws the
/// mean over it. Measured: a few motions are filmed many times, and the variance of each grey level over the films of a
/// motion is summed over a frame, so that the cut at black and white is taken into account. Of a JPEG the whole
/// difference from the uncompressed mean counts. None where nothing but the motion is drawn by chance.
///
/// A model that finds out more about a clip than its motion (how the light is, what lies behind) may get lower.
///
/// # Errors
/// Settings under which no clip can be made.
pub fn noise_floor(variant: &Variant, images: &SourceImages, frames: usize) -> Result<Option<NoiseFloor>> {
    if !variant.is_noisy() {
        return Ok(None);
    }
    let renderer = Renderer::new(variant, images)?;
    let camera = &variant.scene.camera;
    let mean = |camera: &Camera| -> Result<f64> {
        let clips = (0..CLIPS).into_par_iter().map(|index| floor_of_clip(variant, &renderer, camera, index, frames));
        Ok(clips.collect::<Result<Vec<_>>>()?.iter().sum::<f64>() / CLIPS as f64)
    };
    let reconstruction = mean(&Camera { shake: 0, ..camera.clone() })?;
    let prediction = if camera.shake > 0 { mean(camera)? } else { reconstruction };
    Ok(Some(NoiseFloor { reconstruction, prediction }))
}

/// Of one motion: expected squared error of the mean uncompressed film, summed over a frame.
fn floor_of_clip(variant: &Variant, renderer: &Renderer, camera: &Camera, index: usize, frames: usize) -> Result<f64> {
    let streams = |take| Streams { seed: variant.seed, split: Split::Test, index, take };
    let motion = variant.world().clip(frames, &mut streams(0).of(Purpose::Motion))?;
    let (mut files, mut uncompressed) = (Vec::new(), Vec::new());
    for take in 1..=TAKES {
        let mut film = renderer.draw(&motion, &streams(take))?;
        expose(camera, &mut film, &streams(take));
        let mut levels = vec![0; frames * variant.frame_bytes()];
        develop(&Camera { jpeg: None, ..camera.clone() }, &film, &mut levels)?;
        uncompressed.push(levels.clone());
        develop(camera, &film, &mut levels)?;
        files.push(levels);
    }
    // In whole grey levels: what is the same in all films leaves exactly nothing.
    let error = |pixel: usize| {
        let all = || uncompressed.iter().map(|film| f64::from(film[pixel]));
        let (sum, takes) = (all().sum::<f64>(), TAKES as f64);
        // Each film against the mean of the others, whose own error is taken off.
        let others = |film: &Vec<u8>| (sum - f64::from(film[pixel])) / (takes - 1.0);
        let squares =
            files.iter().zip(&uncompressed).map(|(file, film)| (f64::from(file[pixel]) - others(film)).powi(2));
        let variance = all().map(|level| (takes * level - sum).powi(2)).sum::<f64>() / (takes * takes * (takes - 1.0));
        squares.sum::<f64>() / takes - variance / (takes - 1.0)
    };
    Ok((0..frames * variant.frame_bytes()).map(error).sum::<f64>() / (frames as f64 * 255.0 * 255.0))
}
