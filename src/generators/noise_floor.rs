//! How low the losses of a scene can get.

use anyhow::Result;
use rayon::prelude::*;

use super::effects::{develop, expose};
use super::forecast;
use super::render::Renderer;
use super::simulate::SceneState;
use super::source_images::SourceImages;
use super::streams::{Purpose, Streams};
use super::variant::Variant;
use crate::datasets::files::Split;
use crate::datasets::settings::{Forecast, NoiseFloor};
use crate::tasks::camera::Camera;

/// Motions that are filmed, and films of each.
const CLIPS: usize = 4;
const TAKES: usize = 16;

/// What is left of the losses of a model that knows the motion and, wherever anything else is drawn by chance, draws the
/// mean over it. Measured: a few motions are filmed many times, and the variance of each grey level over the films of a
/// motion is summed over a frame, so that the cut at black and white is taken into account. Of a JPEG the whole
/// difference from the uncompressed mean counts. None where nothing but the motion is drawn by chance.
///
/// A model that finds out more about a clip than its motion (how the light is, what lies behind) may get lower. Beside it
/// stands what is left of a forecast from the input frames.
///
/// # Errors
/// Settings under which no clip can be made.
pub fn noise_floor(variant: &Variant, images: &SourceImages, frames: usize) -> Result<Option<NoiseFloor>> {
    if !variant.is_noisy() {
        return Ok(None);
    }
    let renderer = Renderer::new(variant, images)?;
    let clips = (0..CLIPS).into_par_iter().map(|index| floor_of_clip(variant, &renderer, index, frames));
    let clips: Vec<NoiseFloor> = clips.collect::<Result<_>>()?;
    let mean = |number: &dyn Fn(&NoiseFloor) -> f64| clips.iter().map(number).sum::<f64>() / CLIPS as f64;
    let forecast = |number: fn(&Forecast) -> f64| mean(&|floor| floor.forecast.as_ref().map_or(f64::NAN, number));
    Ok(Some(NoiseFloor {
        reconstruction: mean(&|floor| floor.reconstruction),
        prediction: mean(&|floor| floor.prediction),
        forecast: Some(Forecast {
            prediction: forecast(|forecast| forecast.prediction),
            extrapolation: forecast(|forecast| forecast.extrapolation),
        }),
    }))
}

/// Of one motion.
fn floor_of_clip(variant: &Variant, renderer: &Renderer, index: usize, frames: usize) -> Result<NoiseFloor> {
    let streams = Streams { seed: variant.seed, split: Split::Test, index, take: 0 };
    let motion = variant.world().clip(frames, &mut streams.of(Purpose::Motion))?;
    let camera = &variant.scene.camera;
    let held = Camera { shake: 0, ..camera.clone() };
    let noise = errors_of_levels(renderer, &held, &motion, &streams)?;
    let sum = |errors: &[f64]| errors.iter().sum::<f64>() / frames as f64;
    let reconstruction = sum(&noise);
    let shaken = || Ok(sum(&errors_of_levels(renderer, camera, &motion, &streams)?));
    let prediction: Result<f64> = if camera.shake > 0 { shaken() } else { Ok(reconstruction) };
    let wrong = forecast::errors(variant, renderer, &motion, &noise, &streams)?;
    let forecast =
        Forecast { prediction: reconstruction + wrong.prediction, extrapolation: reconstruction + wrong.extrapolation };
    Ok(NoiseFloor { reconstruction, prediction: prediction?, forecast: Some(forecast) })
}

/// Expected squared error of the mean uncompressed film at each grey level, `[frames, side, side, channels]`.
fn errors_of_levels(
    renderer: &Renderer,
    camera: &Camera,
    motion: &[SceneState],
    streams: &Streams,
) -> Result<Vec<f64>> {
    let (mut files, mut uncompressed) = (Vec::new(), Vec::new());
    for take in 1..=TAKES {
        let streams = Streams { take, ..*streams };
        let mut film = renderer.draw(motion, &streams)?;
        expose(camera, &mut film, &streams);
        let mut levels = vec![0; film.frames.iter().map(Vec::len).sum()];
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
        (squares.sum::<f64>() / takes - variance / (takes - 1.0)) / (255.0 * 255.0)
    };
    Ok((0..files[0].len()).map(error).collect())
}
