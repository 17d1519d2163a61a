//! From states to levels: draws on an enlarged canvas and shrinks it with anti-aliasing, as the original does.
//!
//! Original: `nn/datasets/generators.py`.

mod balls;
mod bar;
mod overlay;
mod scenery;
mod sprite;
mod textures;

use anyhow::{Result, bail};

pub use balls::Balls;
pub use bar::Bar;
pub use overlay::{Backdrop, Overlay};
use scenery::Scenery;

use super::film::Film;
use super::simulate::SceneState;
use super::streams::Streams;
use super::variant::Variant;
use crate::generators::source_images::SourceImages;
use crate::tasks::scene::{Look, Motion};

/// Draws the clips of one scene.
#[derive(Debug, Clone)]
pub struct Renderer {
    side: usize,
    channels: usize,
    style: Style,
}

#[derive(Debug, Clone)]
enum Style {
    /// The usual balls on black.
    Balls(Balls),
    Bar(Bar),
    /// Everything else.
    Scenery(Box<Scenery>),
}

impl Renderer {
    /// For these settings, with these source images where the scene has any.
    ///
    /// # Errors
    /// Frames smaller than the CIFAR-10 pictures behind the objects.
    pub fn new(variant: &Variant, sources: &SourceImages) -> Result<Self> {
        let (side, channels, scene) = (variant.side, variant.task.system.channels, &variant.scene);
        let usual = scene.objects.is_default() && scene.distractors.is_empty() && variant.background_look().is_black();
        let style = match (scene.look, scene.motion) {
            (Look::Bar, Motion::Pendulum { length, .. }) => Style::Bar(Bar::new(side, length)),
            (Look::Bar, _) => bail!("a bar is drawn at the angle of a pendulum"),
            (Look::Balls, _) if usual => Style::Balls(Balls::new(side, scene.radius, channels)),
            (Look::Balls | Look::Digits, _) => Style::Scenery(Box::new(Scenery::new(variant, sources)?)),
        };
        Ok(Self { side, channels, style })
    }

    /// Draws the frames of a clip. What is not said by its states is drawn from its random numbers.
    ///
    /// # Errors
    /// A distractor for which there is no room.
    pub fn draw(&self, clip: &[SceneState], streams: &Streams) -> Result<Film> {
        let frames = match &self.style {
            Style::Balls(balls) => clip.iter().map(|state| balls.levels(state.points())).collect(),
            Style::Bar(bar) => {
                let mut canvas = bar.canvas();
                clip.iter().map(|state| bar.levels(state.positions[0], &mut canvas)).collect()
            }
            Style::Scenery(scenery) => scenery.draw(clip, streams)?,
        };
        Ok(Film { side: self.side, channels: self.channels, frames })
    }
}
