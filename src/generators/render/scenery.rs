//! Objects and distractors before whatever lies behind them.

use anyhow::{Result, ensure};
use ndarray::{Array4, Axis};
use rand::Rng;

use super::overlay::{Backdrop, Overlay};
use super::textures::{Clouds, leaves};
use crate::generators::simulate::{SceneState, World};
use crate::generators::source_images::{PICTURE_SIDE, SourceImages};
use crate::generators::streams::{Purpose, Streams, of_dataset};
use crate::generators::variant::Variant;
use crate::tasks::looks::Distractor;
use crate::tasks::scene::{Background, Look, Motion};

/// All that is drawn of a scene.
#[derive(Debug, Clone)]
pub(super) struct Scenery {
    overlay: Overlay,
    behind: Behind,
    /// Each with the box in which it moves.
    distractors: Vec<(Distractor, World)>,
}

/// What lies behind the sprites.
#[derive(Debug, Clone)]
enum Behind {
    /// The same in all clips.
    One(Backdrop),
    /// CIFAR-10 images of which each clip draws one, `[pictures, 32, 32, 3]`.
    RandomPicture(Array4<u8>),
    /// Each clip draws a texture of this brightness.
    RandomTexture(f64),
    /// Clouds that change from frame to frame.
    Drifting(Clouds),
}

impl Scenery {
    /// # Errors
    /// Frames smaller than the CIFAR-10 pictures behind the objects.
    pub(super) fn new(variant: &Variant, sources: &SourceImages) -> Result<Self> {
        let (side, scene, system) = (variant.side, &variant.scene, &variant.task.system);
        let objects = match scene.look {
            Look::Digits => Overlay::digits(side, sources),
            _ => Overlay::balls(side, scene.radius, system.channels, system.objects, &scene.objects),
        };
        let alone = variant.background_look().is_black() && scene.distractors.is_empty();
        let transparent = scene.look == Look::Balls && alone && !scene.objects.occlude;
        let objects = if transparent { objects.like_lights() } else { objects };
        let overlay = objects.with_distractors(&scene.distractors);
        let world = |&Distractor { radius, speed, .. }: &Distractor| World {
            motion: Motion::Bouncing {},
            law: None,
            objects: 1,
            speed: [speed; 2],
            radius,
            wall_margin: radius,
            ..variant.world()
        };
        let distractors = scene.distractors.iter().map(|thing| (thing.clone(), world(thing))).collect();
        Ok(Self { behind: Behind::new(variant, &overlay, sources)?, overlay, distractors })
    }

    /// The levels of a clip's frames, each channel by channel.
    ///
    /// # Errors
    /// A distractor for which there is no room.
    pub(super) fn draw(&self, clip: &[SceneState], streams: &Streams) -> Result<Vec<Vec<f64>>> {
        let mut positions = self.distractor_positions(clip.len(), streams)?;
        for (all, state) in positions.iter_mut().zip(clip) {
            all.extend(state.points());
        }
        let rng = &mut streams.of(Purpose::Background);
        let over = |backdrop: &Backdrop| {
            let mut canvas = backdrop.canvas.clone();
            positions.iter().map(|all| self.overlay.levels(all, backdrop, &mut canvas)).collect()
        };
        Ok(match &self.behind {
            Behind::One(backdrop) => over(backdrop),
            Behind::RandomPicture(pictures) => {
                let chosen = rng.random_range(0..pictures.dim().0);
                over(&self.overlay.backdrop(pictures.index_axis(Axis(0), chosen)))
            }
            &Behind::RandomTexture(brightness) => over(&leaves(&self.overlay, brightness, rng)),
            Behind::Drifting(clouds) => {
                let start = clouds.random_time(rng);
                let frame = |(time, all): (usize, &Vec<[f64; 2]>)| {
                    let backdrop = self.overlay.of_frame(&clouds.levels(start + time as f64));
                    self.overlay.levels(all, &backdrop, &mut backdrop.canvas.clone())
                };
                positions.iter().enumerate().map(frame).collect()
            }
        })
    }

    /// Of all distractors in each frame.
    fn distractor_positions(&self, frames: usize, streams: &Streams) -> Result<Vec<Vec<[f64; 2]>>> {
        let mut positions = vec![Vec::new(); frames];
        let rng = &mut streams.of(Purpose::Distractors);
        for (distractor, world) in &self.distractors {
            let path = world.clip(frames, rng)?;
            for (all, state) in positions.iter_mut().zip(path) {
                all.push(distractor.position.unwrap_or(state.points()[0]));
            }
        }
        Ok(positions)
    }
}

impl Behind {
    fn new(variant: &Variant, overlay: &Overlay, sources: &SourceImages) -> Result<Self> {
        let (side, channels) = (variant.side, variant.task.system.channels);
        let look = variant.background_look();
        let brightness = look.brightness();
        let of_dataset = &mut of_dataset(variant.seed);
        ensure!(
            side >= PICTURE_SIDE || !matches!(look.kind, Background::Cifar | Background::RandomCifar),
            "frames with a CIFAR-10 picture behind need a side of at least {PICTURE_SIDE} px, not {side}"
        );
        let first = sources.pictures.index_axis(Axis(0), 0);
        Ok(match look.kind {
            Background::Plain => Behind::One(overlay.plain(brightness)),
            Background::Cifar => Behind::One(overlay.backdrop(first)),
            Background::RandomCifar => Behind::RandomPicture(sources.pictures.clone()),
            Background::Picture => Behind::One(overlay.of_picture(first, |level| level * brightness)),
            Background::Texture => Behind::One(leaves(overlay, brightness, of_dataset)),
            Background::RandomTexture => Behind::RandomTexture(brightness),
            Background::Drifting => Behind::Drifting(Clouds::new(side, channels, brightness, look.drift(), of_dataset)),
        })
    }
}
