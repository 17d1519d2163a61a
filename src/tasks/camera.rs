//! What a camera and the light do to the frames of a scene. Pure data, part of a task file.

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};

/// `[scene.camera]`: effects in the order in which they act. The default does nothing.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Camera {
    /// Per cent: each frame's light is multiplied by a factor drawn uniformly from 1 - flicker to 1 + flicker.
    pub flicker: f64,
    /// Per cent by which the light grows from the middle to the brightest edge, and falls to the opposite one; from
    /// frame to frame the direction turns at random.
    pub gradient: f64,
    /// Standard deviation of a Gaussian blur, pixels.
    pub blur: f64,
    /// Largest shift of each frame along each axis, whole pixels.
    pub shake: usize,
    /// Standard deviation of Gaussian noise, grey levels of 255, in each channel of each pixel.
    pub noise: f64,
    /// Per cent of the pixels that are black or white, half of them each.
    pub salt_and_pepper: f64,
    /// Quality of a JPEG compression, 1 to 100.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jpeg: Option<u8>,
}

impl Camera {
    /// Whether it does nothing.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Whether it does anything that no model can draw: anything but the blur.
    pub fn is_noisy(&self) -> bool {
        Camera { blur: 0.0, ..self.clone() } != Self::default()
    }

    /// # Errors
    /// A number out of range; the message names it.
    pub(super) fn check(&self, side: usize) -> Result<()> {
        let Camera { flicker, gradient, blur, shake, noise, salt_and_pepper, jpeg } = self;
        for (key, value, largest) in [
            ("flicker", flicker, 100.0),
            ("gradient", gradient, 100.0),
            ("blur", blur, side as f64),
            ("noise", noise, 255.0),
            ("salt_and_pepper", salt_and_pepper, 100.0),
        ] {
            ensure!((0.0..=largest).contains(value), "camera.{key} = {value}: must be 0 to {largest}");
        }
        ensure!(2 * shake < side, "camera.shake = {shake}: must be less than half of the side {side}");
        if let Some(quality) = jpeg {
            ensure!((1..=100).contains(quality), "camera.jpeg = {quality}: a quality is 1 to 100");
        }
        Ok(())
    }
}
