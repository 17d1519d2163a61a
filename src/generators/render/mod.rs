//! From states to frames: draws on an enlarged canvas and shrinks it with anti-aliasing, as the original does.
//!
//! Frames are uint8 `[S, S, channels]`, row-major, RGB or grey. Grey levels are cut off, not rounded. Original:
//! `nn/datasets/generators.py`.

mod balls;
mod bar;
mod overlay;

use std::borrow::Cow;

use anyhow::{Result, bail};
use ndarray::{Array3, Array4, Axis};
use rand::Rng;

pub use balls::Balls;
pub use bar::Bar;
pub use overlay::{Backdrop, Overlay};

use super::simulate::SceneState;
use super::variant::Variant;
use crate::generators::source_images::SourceImages;
use crate::tasks::scene::{Background, Look, Motion};

/// Draws the clips of one scene.
#[derive(Debug, Clone)]
pub enum Renderer {
    Balls(Balls),
    Bar(Bar),
    Overlay(Overlay, Pictures),
}

/// What lies behind the objects of an [`Overlay`].
#[derive(Debug, Clone)]
pub enum Pictures {
    One(Backdrop),
    /// Source images of which each clip draws one, `[pictures, 32, 32, 3]`.
    Many(Array4<u8>),
}

impl Renderer {
    /// For these settings, with these source images where the scene has any.
    ///
    /// # Errors
    /// Frames smaller than the pictures behind the objects.
    pub fn new(variant: &Variant, sources: &SourceImages) -> Result<Self> {
        let (side, channels, radius) = (variant.side, variant.task.system.channels, variant.scene.radius);
        let overlay = match (variant.scene.look, variant.scene.motion) {
            (Look::Bar, Motion::Pendulum { length, .. }) => return Ok(Self::Bar(Bar::new(side, length))),
            (Look::Balls, _) if variant.background == Background::Plain => {
                return Ok(Self::Balls(Balls::new(side, radius, channels)));
            }
            (Look::Balls, _) => Overlay::balls(side, radius, channels, variant.task.system.objects)?,
            (Look::Bar, _) => bail!("a bar is drawn at the angle of a pendulum"),
            (Look::Digits, _) => Overlay::digits(side, sources)?,
        };
        let first = sources.pictures.index_axis(Axis(0), 0);
        let pictures = match variant.background {
            Background::Plain => Pictures::One(overlay.backdrop(Array3::zeros(first.dim()).view())),
            Background::Cifar => Pictures::One(overlay.backdrop(first)),
            Background::RandomCifar => Pictures::Many(sources.pictures.clone()),
        };
        Ok(Self::Overlay(overlay, pictures))
    }

    /// Draws the frames of a clip, one after the other, into `frames`. `rng` chooses the picture behind the objects.
    pub fn draw(&self, clip: &[SceneState], rng: &mut impl Rng, frames: &mut [u8]) {
        let frames = frames.chunks_exact_mut(frames.len() / clip.len()).zip(clip);
        match self {
            Self::Balls(balls) => frames.for_each(|(frame, state)| balls.draw(state.points(), frame)),
            Self::Bar(bar) => {
                let mut canvas = bar.canvas();
                frames.for_each(|(frame, state)| bar.draw(state.positions[0], &mut canvas, frame));
            }
            Self::Overlay(overlay, pictures) => {
                let backdrop = match pictures {
                    Pictures::One(backdrop) => Cow::Borrowed(backdrop),
                    Pictures::Many(pictures) => {
                        let chosen = rng.random_range(0..pictures.dim().0);
                        Cow::Owned(overlay.backdrop(pictures.index_axis(Axis(0), chosen)))
                    }
                };
                let mut canvas = backdrop.canvas.clone();
                frames.for_each(|(frame, state)| overlay.draw(state.points(), &backdrop, &mut canvas, frame));
            }
        }
    }
}

/// Writes a plane of 0..1 as grey levels into one channel of a frame.
fn quantise(plane: &[f64], channel: usize, channels: usize, frame: &mut [u8]) {
    for (pixel, value) in frame.chunks_exact_mut(channels).zip(plane) {
        pixel[channel] = (value.min(1.0) * 255.0) as u8;
    }
}
