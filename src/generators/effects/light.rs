//! Light that is not the same at all times and places. It multiplies the levels of all channels.

use std::f64::consts::TAU;

use rand::Rng;

use crate::generators::film::Film;
use crate::support::random::normal;

/// Standard deviation of the turn of a gradient from one frame to the next, radians.
const TURN: f64 = 0.3;

/// Multiplies each frame by one factor, drawn uniformly from 1 - a to 1 + a; `amount` is a in per cent.
pub(crate) fn flicker(film: &mut Film, amount: f64, rng: &mut impl Rng) {
    for frame in &mut film.frames {
        let factor = 1.0 + amount / 100.0 * rng.random_range(-1.0..=1.0);
        frame.iter_mut().for_each(|level| *level *= factor);
    }
}

/// Multiplies each place by 1 + a d, where d is its distance from the middle along the gradient's direction, in half
/// sides; `amount` is a in per cent. The first direction is drawn uniformly; from each frame to the next it turns by a
/// Gaussian angle of standard deviation 0.3 rad.
pub(crate) fn gradient(film: &mut Film, amount: f64, rng: &mut impl Rng) {
    let (side, half) = (film.side, film.side as f64 / 2.0);
    let mut direction: f64 = rng.random_range(0.0..TAU);
    for frame in &mut film.frames {
        let (x, y) = (direction.cos(), direction.sin());
        let from_middle = |pixel: usize| (pixel as f64 + 0.5 - half) / half;
        for plane in frame.chunks_exact_mut(side * side) {
            for (pixel, level) in plane.iter_mut().enumerate() {
                *level *= 1.0 + amount / 100.0 * (x * from_middle(pixel % side) + y * from_middle(pixel / side));
            }
        }
        direction += TURN * normal(rng);
    }
}
