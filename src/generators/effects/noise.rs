//! Noise of the sensor, drawn anew for each pixel of each frame.

use rand::Rng;

use crate::generators::film::Film;
use crate::support::random::normal;

/// Adds Gaussian noise of standard deviation `deviation`, grey levels of 255, to each channel of each pixel.
pub fn gaussian(film: &mut Film, deviation: f64, rng: &mut impl Rng) {
    for level in film.frames.iter_mut().flatten() {
        *level += deviation / 255.0 * normal(rng);
    }
}

/// Makes `amount` per cent of the pixels black or white in all channels, each with the same chance.
pub(crate) fn salt_and_pepper(film: &mut Film, amount: f64, rng: &mut impl Rng) {
    let pixels = film.side * film.side;
    for frame in &mut film.frames {
        for pixel in 0..pixels {
            let chance = 100.0 * rng.random::<f64>();
            if chance < amount {
                let level = if chance < amount / 2.0 { 0.0 } else { 1.0 };
                frame.iter_mut().skip(pixel).step_by(pixels).for_each(|channel| *channel = level);
            }
        }
    }
}
