//! What a camera does to the frames of a clip, in the order in which it happens: the light on the scene (flicker,
//! gradient), the lens (blur), the hand (shake), the sensor (noise, salt and pepper, grey levels), the file (JPEG).
//!
//! Each effect draws from random numbers of its own.

pub mod blur;
pub(crate) mod jpeg;
pub(crate) mod light;
pub(crate) mod noise;
pub(crate) mod shake;

use anyhow::Result;

use super::film::Film;
use super::streams::{Purpose, Streams};
use crate::tasks::camera::Camera;

/// All effects up to the sensor's, on levels that are not cut off yet.
pub(crate) fn expose(camera: &Camera, film: &mut Film, streams: &Streams) {
    let &Camera { flicker, gradient, blur, shake, noise, salt_and_pepper, jpeg: _ } = camera;
    if flicker > 0.0 {
        light::flicker(film, flicker, &mut streams.of(Purpose::Flicker));
    }
    if gradient > 0.0 {
        light::gradient(film, gradient, &mut streams.of(Purpose::Gradient));
    }
    if blur > 0.0 {
        blur::blur(film, blur);
    }
    if shake > 0 {
        shake::shake(film, shake, &mut streams.of(Purpose::Shake));
    }
    if noise > 0.0 {
        noise::gaussian(film, noise, &mut streams.of(Purpose::Noise));
    }
    if salt_and_pepper > 0.0 {
        noise::salt_and_pepper(film, salt_and_pepper, &mut streams.of(Purpose::SaltAndPepper));
    }
}

/// The grey levels of a film, uint8 `[frames, side, side, channels]`, and what a file makes of them.
///
/// # Errors
/// A frame that cannot be compressed.
pub(crate) fn develop(camera: &Camera, film: &Film, frames: &mut [u8]) -> Result<()> {
    film.quantise(frames);
    match camera.jpeg {
        Some(quality) => jpeg::compress(frames, film.side, film.channels, quality),
        None => Ok(()),
    }
}
