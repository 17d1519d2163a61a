//! Opaque sprites over a background: the original's digits, and balls. Within 2 grey levels of its skimage.

use std::ops::Range;

use ndarray::{ArrayView1, ArrayView3};

use super::balls::BALL_SCALE;
use super::sprite::{Disc, Sprite};
use crate::generators::film::quantise;
use crate::generators::resize::Resize;
use crate::generators::source_images::SourceImages;
use crate::tasks::looks::{Distractor, ObjectLooks};
use crate::tasks::scene;

const DIGIT_SCALE: usize = 5;
/// Taken off a CIFAR-10 picture's brightness, of 1, so that the objects stand out.
const DARKENING: f64 = 0.2;
/// Shares of red, green and blue in a grey level, the original's.
const GREY: [f64; 3] = [0.299, 0.587, 0.114];

/// Sprites over a background, a later one over the earlier ones.
///
/// Blending is not linear, so the canvas is drawn anew for each frame, but shrunk only around the sprites.
#[derive(Debug, Clone)]
pub struct Overlay {
    side: usize,
    channels: usize,
    /// The canvas is this many times as large as the frame.
    scale: usize,
    sprites: Vec<Sprite>,
    blending: Blending,
    shrink: Resize,
}

/// What becomes of what lies behind a sprite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Blending {
    /// It is covered.
    Cover,
    /// In each channel the brighter of both shows.
    Lighten,
}

/// A background as it lies behind the sprites of an [`Overlay`]: 0..1, channel by channel.
#[derive(Debug, Clone)]
pub struct Backdrop {
    /// On the canvas.
    pub canvas: Vec<f64>,
    /// In the frame.
    frame: Vec<f64>,
}

impl Overlay {
    /// MNIST digits in colour frames of `side` pixels; digit j shines in channel j.
    pub fn digits(side: usize, sources: &SourceImages) -> Self {
        let levels = |digit: &ndarray::Array2<u8>| digit.iter().map(|&v| f64::from(v) / 255.0).collect::<Vec<_>>();
        let digits = sources.digits.iter().enumerate();
        let sprites = digits.map(|(channel, digit)| Sprite::digit(&levels(digit), channel, DIGIT_SCALE)).collect();
        Self::new(side, 3, DIGIT_SCALE, sprites)
    }

    /// As many discs; their radius and the colours [`scene::colour`] where the looks say nothing else.
    pub fn balls(side: usize, radius: f64, channels: usize, balls: usize, looks: &ObjectLooks) -> Self {
        let sprite = |ball: usize| {
            let colour = looks.colours.get(ball).cloned().or_else(|| scene::colour(ball, channels))?;
            let disc = Disc {
                radius: looks.radii.get(ball).copied().unwrap_or(radius),
                colour: &colour,
                shading: looks.shading,
                half: looks.halves.get(ball),
            };
            Some(Sprite::disc(&disc, BALL_SCALE))
        };
        Self::new(side, channels, BALL_SCALE, (0..balls).map_while(sprite).collect())
    }

    fn new(side: usize, channels: usize, scale: usize, sprites: Vec<Sprite>) -> Self {
        let shrink = Resize::shrink(side, scale);
        Self { side, channels, scale, sprites, blending: Blending::Cover, shrink }
    }

    /// With these behind the objects; their positions come before those of the objects.
    pub(crate) fn with_distractors(mut self, distractors: &[Distractor]) -> Self {
        let disc = |thing: &Distractor| {
            let disc = Disc { radius: thing.radius, colour: &thing.colour, shading: 0.0, half: None };
            Sprite::disc(&disc, self.scale)
        };
        let sprites: Vec<_> = distractors.iter().map(disc).collect();
        self.sprites.splice(..0, sprites);
        self
    }

    /// With sprites that cover nothing: in each channel the brighter of both shows.
    pub(crate) fn like_lights(self) -> Self {
        Self { blending: Blending::Lighten, ..self }
    }

    /// Prepares a CIFAR-10 image, `[32, 32, 3]`, which is darkened.
    pub fn backdrop(&self, picture: ArrayView3<u8>) -> Backdrop {
        self.of_picture(picture, |level| (level - DARKENING).clamp(0.0, 1.0))
    }

    /// Prepares a square picture of three channels; `shade` turns its levels, 0..1, into those behind the sprites.
    pub(crate) fn of_picture(&self, picture: ArrayView3<u8>, shade: impl Fn(f64) -> f64) -> Backdrop {
        let enlarge = Resize::enlarge(picture.dim().0, self.canvas_side());
        let plane = |channel: usize| {
            let level = |rgb: ArrayView1<u8>| match self.channels {
                1 => rgb.iter().zip(GREY).map(|(&v, share)| share * f64::from(v)).sum::<f64>() / 255.0,
                _ => f64::from(rgb[channel]) / 255.0,
            };
            enlarge.apply(&picture.rows().into_iter().map(level).collect::<Vec<_>>())
        };
        self.of_canvas((0..self.channels).flat_map(plane).map(shade).collect())
    }

    /// Prepares the levels of a frame, 0..1, channel by channel.
    pub(crate) fn of_frame(&self, levels: &[f64]) -> Backdrop {
        let enlarge = Resize::enlarge(self.side, self.canvas_side());
        self.of_canvas(levels.chunks(self.side * self.side).flat_map(|plane| enlarge.apply(plane)).collect())
    }

    /// One level everywhere.
    pub fn plain(&self, level: f64) -> Backdrop {
        self.of_canvas(vec![level; self.channels * self.canvas_side().pow(2)])
    }

    /// Prepares what stands on the canvas, channel by channel.
    pub(super) fn of_canvas(&self, canvas: Vec<f64>) -> Backdrop {
        let frame = canvas.chunks(self.canvas_side().pow(2)).flat_map(|plane| self.shrink.apply(plane)).collect();
        Backdrop { canvas, frame }
    }

    /// Draws at most as many objects as there are sprites. `canvas` holds the backdrop's, before and after.
    pub fn draw(&self, positions: &[[f64; 2]], backdrop: &Backdrop, canvas: &mut [f64], frame: &mut [u8]) {
        quantise(&self.levels(positions, backdrop, canvas), self.channels, frame);
    }

    /// The same before the levels become grey levels: channel by channel.
    pub fn levels(&self, positions: &[[f64; 2]], backdrop: &Backdrop, canvas: &mut [f64]) -> Vec<f64> {
        let canvas_side = self.canvas_side();
        let mut planes = backdrop.frame.clone();
        self.blend(positions, canvas);
        let mut line = Vec::new();
        for (position, sprite) in positions.iter().zip(&self.sprites) {
            let [columns, rows] = position.map(|p| self.span(sprite, p));
            let (window_rows, window_columns) = (self.shrink.reached(rows), self.shrink.reached(columns));
            for (plane, canvas) in
                planes.chunks_mut(self.side * self.side).zip(canvas.chunks(canvas_side * canvas_side))
            {
                self.shrink.apply_window(canvas, window_rows.clone(), window_columns.clone(), &mut line, plane);
            }
        }
        // Back to the bare backdrop for the next frame.
        for (position, sprite) in positions.iter().zip(&self.sprites) {
            let [columns, rows] = position.map(|p| self.span(sprite, p));
            for channel in 0..self.channels {
                for row in rows.clone() {
                    let start = (channel * canvas_side + row) * canvas_side;
                    let stretch = start + columns.start..start + columns.end;
                    canvas[stretch.clone()].copy_from_slice(&backdrop.canvas[stretch]);
                }
            }
        }
        planes
    }

    /// The same as [`Self::draw`] by shrinking the whole canvas: slow; what tests compare it with.
    pub fn draw_whole(&self, positions: &[[f64; 2]], backdrop: &Backdrop, frame: &mut [u8]) {
        let mut canvas = backdrop.canvas.clone();
        self.blend(positions, &mut canvas);
        quantise(&self.of_canvas(canvas).frame, self.channels, frame);
    }

    /// Lays the sprites over the canvas, in order.
    fn blend(&self, positions: &[[f64; 2]], canvas: &mut [f64]) {
        let side = self.canvas_side();
        for (position, sprite) in positions.iter().zip(&self.sprites) {
            let [left, top] = position.map(|p| sprite.start(p));
            let [columns, rows] = position.map(|p| self.span(sprite, p));
            if columns.is_empty() {
                continue;
            }
            for (channel, ink) in sprite.ink.iter().enumerate() {
                for row in rows.clone() {
                    let from = (row as isize - top) as usize * sprite.side + (columns.start as isize - left) as usize;
                    let start = (channel * side + row) * side;
                    let target = &mut canvas[start + columns.start..start + columns.end];
                    for ((value, opacity), ink) in target.iter_mut().zip(&sprite.opacity[from..]).zip(&ink[from..]) {
                        *value = match self.blending {
                            Blending::Cover => opacity * ink + (1.0 - opacity) * *value,
                            Blending::Lighten => value.max(opacity * ink),
                        };
                    }
                }
            }
        }
    }

    /// Pixels.
    pub(super) fn canvas_side(&self) -> usize {
        self.side * self.scale
    }

    /// Canvas rows or columns that a sprite covers; empty where it lies outside.
    fn span(&self, sprite: &Sprite, position: f64) -> Range<usize> {
        let inside = |edge: isize| edge.clamp(0, self.canvas_side() as isize) as usize;
        let start = sprite.start(position);
        inside(start)..inside(start + sprite.side as isize)
    }
}
