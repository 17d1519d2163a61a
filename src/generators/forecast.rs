//! How exactly a clip's future can be told from its input frames, however good the model.
//!
//! Noise hides where the objects are; the start of their motion is known no better than that, and the forecast runs away
//! with time. To first order (Cramer and Rao): each frame tells the positions by how much its levels change with them,
//! against their noise; the frames together tell the start of the motion by how much it moves them.

use std::ops::Range;

use anyhow::Result;
use tch::{Kind, Tensor};

use super::effects::expose;
use super::film::Film;
use super::render::Renderer;
use super::simulate::SceneState;
use super::streams::{Purpose, Streams};
use super::variant::Variant;
use crate::datasets::settings::Forecast;
use crate::network::cells::Coordinates;
use crate::support::random::normal;
use crate::tasks::camera::Camera;

/// Forecasts that are drawn for a clip.
const FORECASTS: usize = 8;
/// Step of the slopes: a share of the frame's side, or a share of a radian.
const STEP: f64 = 1.0 / WIDEST;
/// The widest spread of a place, in steps: the frame's side, or a radian.
const WIDEST: f64 = 128.0;
/// Variance of a level that is cut to a whole one of 255.
const CUT: f64 = 1.0 / (12.0 * 255.0 * 255.0);

/// What wrong forecasts add to the losses, summed over a frame: the start of the motion is drawn as often from what the
/// input frames leave open, and the film of its future compared with that of the true one, as a shaking camera shows it.
///
/// * `noise`: the expected squared error of each grey level, `[frames, side, side, channels]`, taken as independent.
///
/// # Errors
/// A film that cannot be drawn.
pub fn errors(
    variant: &Variant,
    renderer: &Renderer,
    motion: &[SceneState],
    noise: &[f64],
    streams: &Streams,
) -> Result<Forecast> {
    let (world, system) = (variant.world(), &variant.task.system);
    let input = system.input_steps.min(motion.len());
    let step = STEP * if variant.coordinates() == system.objects { 1.0 } else { world.side };
    let start = &motion[0];
    let places = start.positions.len();
    let begun = |changes: &[f64]| {
        let [p, v] = [0, places].map(|first| &changes[first..first + places]);
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect::<Vec<_>>();
        world.replay(motion, &sum(&start.positions, p), &sum(&start.velocities, v))
    };
    // By how much each position at each frame changes with each number of the start, `[frames, places, 2 places]`.
    let per_number = (0..2 * places).map(|number| {
        let step = if number < places { step } else { step / world.dt };
        let mut change = vec![0.0; 2 * places];
        let [up, down] = [step, -step].map(|step| {
            change[number] = step;
            begun(&change)
        });
        let slope = |(up, down): (&f64, &f64)| (up - down) / (2.0 * step);
        let slopes = up.iter().zip(&down).flat_map(|(up, down)| up.positions.iter().zip(&down.positions).map(slope));
        Tensor::from_slice(&slopes.collect::<Vec<f64>>()).reshape([motion.len() as i64, places as i64])
    });
    let of_start = Tensor::stack(&per_number.collect::<Vec<_>>(), 2).narrow(0, 0, input as i64);
    let told = told_by_frames(variant, renderer, &motion[..input], step, noise, streams)?;
    let told =
        (of_start.transpose(1, 2).matmul(&told).matmul(&of_start)).sum_dim_intlist([0i64].as_slice(), false, None);
    // Where an object is hidden it is still in the frame, and does not cross it between two of them.
    let [place, speed] =
        [WIDEST * step, WIDEST * step / world.dt].map(|widest| Tensor::from(widest.powi(-2)).repeat([places as i64]));
    let told = told + Tensor::cat(&[place, speed], 0).diag(0);
    let spread = spread(&told);
    let truth = renderer.draw(motion, streams)?;
    let mut random = streams.of(Purpose::Forecast);
    let (mut prediction, mut extrapolation) = (0.0, 0.0);
    for take in 1..=FORECASTS {
        let normals: Vec<f64> = (0..2 * places).map(|_| normal(&mut random)).collect();
        let changes: Vec<f64> = spread.matmul(&Tensor::from_slice(&normals).unsqueeze(1)).view(-1).try_into()?;
        let forecast = renderer.draw(&begun(&changes), streams)?;
        let mut seen = truth.clone();
        expose(
            &Camera { shake: variant.scene.camera.shake, ..Camera::default() },
            &mut seen,
            &Streams { take, ..*streams },
        );
        let predicted = (input + system.pred_steps).min(motion.len());
        prediction += difference(&forecast, &seen, input..predicted) / FORECASTS as f64;
        extrapolation += difference(&forecast, &seen, predicted..motion.len()) / FORECASTS as f64;
    }
    Ok(Forecast { prediction, extrapolation })
}

/// What turns independent normal numbers into ones of which so much is told, the inverse of their covariance: `[n, n]` each.
fn spread(told: &Tensor) -> Tensor {
    // In units of their own, for places and speeds may be told by some billion times as much as others are.
    let units = told.diagonal(0, 0, 1).rsqrt();
    let told = told * units.unsqueeze(0) * units.unsqueeze(1);
    let (told, ways) = ((&told + told.transpose(0, 1)) * 0.5).linalg_eigh("L");
    units.unsqueeze(1) * ways * told.clamp_min(ROUNDING).rsqrt()
}

/// Of what is told of a combination of numbers, beside what is told of each, no less can be told from rounding.
const ROUNDING: f64 = 1e-12;

/// Deviation of a position that no frame tells anything of, pixels.
const UNSEEN: f64 = 1e4;

/// What each frame tells of the positions, the inverse of their covariance: `[frames, places, places]`.
fn told_by_frames(
    variant: &Variant,
    renderer: &Renderer,
    motion: &[SceneState],
    step: f64,
    noise: &[f64],
    streams: &Streams,
) -> Result<Tensor> {
    let places = motion[0].positions.len();
    let (frames, channels) = (motion.len() as i64, variant.task.system.channels as i64);
    let mut slopes = Vec::new();
    for place in 0..places {
        let film = |step: f64| {
            let mut moved = motion.to_vec();
            moved.iter_mut().for_each(|state| state.positions[place] += step);
            renderer.draw(&moved, streams)
        };
        let (up, down) = (film(step)?, film(-step)?);
        let slope: Vec<f64> = levels(&up).zip(levels(&down)).map(|(up, down)| (up - down) / (2.0 * step)).collect();
        slopes.push(Tensor::from_slice(&slope).reshape([frames, channels, -1]));
    }
    // [frames, places, channels, pixels]
    let slopes = Tensor::stack(&slopes, 1);
    // Measured on few films a variance may come out below 0.
    let variance = Tensor::from_slice(noise).reshape([-1, slopes.size()[3], channels]).narrow(0, 0, frames);
    let variance = variance.clamp_min(0.0) + CUT;
    let scaled = (slopes / variance.transpose(1, 2).unsqueeze(1).sqrt()).flatten(2, 3);
    let told = scaled.matmul(&scaled.transpose(1, 2));
    let shake = variant.scene.camera.shake as f64;
    if shake == 0.0 || variant.task.system.cell.coordinates == Coordinates::Angle {
        return Ok(told);
    }
    // A shaking camera moves all objects by the same whole pixels, from -shake to shake along each axis.
    let axes = Tensor::eye(2, (Kind::Double, tch::Device::Cpu)).repeat([places as i64 / 2, places as i64 / 2]);
    // A hidden object is known to so many pixels, which is as good as not at all.
    let told = told + Tensor::eye(places as i64, (Kind::Double, tch::Device::Cpu)) * UNSEEN.powi(-2);
    Ok((told.inverse() + axes * (shake * (shake + 1.0) / 3.0)).inverse())
}

fn levels(film: &Film) -> impl Iterator<Item = f64> {
    film.frames.iter().flatten().map(|level| level.clamp(0.0, 1.0))
}

/// Squared difference of these frames, summed over a frame; 0 of none.
fn difference(a: &Film, b: &Film, frames: Range<usize>) -> f64 {
    let count = frames.len().max(1) as f64;
    let pairs = a.frames[frames.clone()].iter().flatten().zip(b.frames[frames].iter().flatten());
    pairs.map(|(a, b)| (a.clamp(0.0, 1.0) - b.clamp(0.0, 1.0)).powi(2)).sum::<f64>() / count
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is told of three numbers, in units a million times apart, two of which hardly show but by their sum.
    #[test]
    fn numbers_spread_by_what_is_told_of_them() {
        let ways = Tensor::from_slice(&[1.0, 1.0, 0.0, 0.0, 1e-5, 0.0, 0.0, 0.0, 1.0]).reshape([3, 3]);
        let units = Tensor::from_slice(&[1e6, 1e6, 1.0]);
        let told = ways.transpose(0, 1).matmul(&ways) * units.unsqueeze(0) * units.unsqueeze(1);
        let spread = spread(&told);
        let left = spread.transpose(0, 1).matmul(&told).matmul(&spread);
        let off = (left - Tensor::eye(3, (Kind::Double, tch::Device::Cpu))).abs().max().double_value(&[]);
        // The flattest way is told 1e-10 as much: six of sixteen digits are left of it.
        assert!(off < 1e-4, "{off}");
        // Two that show by their sum alone.
        let sum = Tensor::from_slice(&[1.0, 1.0, 1.0, 1.0]).reshape([2, 2]);
        assert!(super::spread(&sum).isfinite().all().int64_value(&[]) == 1);
    }
}
