//! Opaque sprites over a darkened picture: the original's digits, and balls. Within 2 grey levels of its skimage.

use std::ops::Range;

use anyhow::{Result, ensure};
use ndarray::{ArrayView3, s};

use super::balls::{BALL_SCALE, canvas_pixel, fill_disc};
use super::quantise;
use crate::generators::resize::Resize;
use crate::generators::source_images::{DIGIT_SIDE, PICTURE_SIDE, SourceImages};
use crate::tasks::scene::{self, DIGIT_RADIUS};

const DIGIT_SCALE: usize = 5;
/// Taken off the picture's brightness, of 1, so that the objects stand out.
const DARKENING: f64 = 0.2;
/// Shares of red, green and blue in a grey level, the original's.
const GREY: [f64; 3] = [0.299, 0.587, 0.114];

/// SourceImages that cover what lies behind them, a later one the earlier ones; each shines in one channel, or in the only one.
///
/// Blending is not linear, so the canvas is drawn anew for each frame, but shrunk only around the sprites.
#[derive(Debug, Clone)]
pub struct Overlay {
    side: usize,
    channels: usize,
    /// The canvas is this many times as large as the frame.
    scale: usize,
    sprites: Vec<Sprite>,
    /// Side of a sprite on the canvas.
    sprite_side: usize,
    /// First canvas row or column of a sprite at a position; negative where it hangs over the border.
    start: fn(position: f64, sprite_side: usize) -> isize,
    shrink: Resize,
}

#[derive(Debug, Clone)]
struct Sprite {
    /// 0..1 on the canvas.
    opacity: Vec<f64>,
    /// In each channel, 0..1.
    colour: Vec<f64>,
}

/// A picture as it lies behind the sprites of an [`Overlay`]: 0..1, channel by channel.
#[derive(Debug, Clone)]
pub struct Backdrop {
    /// On the canvas.
    pub canvas: Vec<f64>,
    /// In the frame.
    frame: Vec<f64>,
}

impl Overlay {
    /// MNIST digits in colour frames of `side` pixels; digit j shines in channel j.
    ///
    /// # Errors
    /// A frame smaller than the picture behind.
    pub fn digits(side: usize, sources: &SourceImages) -> Result<Self> {
        let sprite_side = 2 * DIGIT_RADIUS as usize * DIGIT_SCALE;
        let border = (DIGIT_SIDE - 2 * DIGIT_RADIUS as usize) / 2;
        let enlarge = Resize::enlarge(DIGIT_SIDE - 2 * border, sprite_side);
        let sprite = |channel: usize| {
            let middle = border..DIGIT_SIDE - border;
            let pixels = sources.digits[channel].slice(s![middle.clone(), middle]);
            let opacity = enlarge.apply(&pixels.iter().map(|&v| f64::from(v) / 255.0).collect::<Vec<_>>());
            Sprite { opacity, colour: (0..3).map(|other| f64::from(other == channel)).collect() }
        };
        let sprites = (0..sources.digits.len()).map(sprite).collect();
        let start = |position: f64, _| ((position - DIGIT_RADIUS) * DIGIT_SCALE as f64).round_ties_even() as isize;
        Self::new(side, 3, DIGIT_SCALE, sprites, sprite_side, start)
    }

    /// As many discs, of the colours [`scene::colour`].
    ///
    /// # Errors
    /// A frame smaller than the picture behind.
    pub fn balls(side: usize, radius: f64, channels: usize, balls: usize) -> Result<Self> {
        let radius = radius * BALL_SCALE as f64;
        let reach = radius.ceil() as usize;
        let sprite_side = 2 * reach + 1;
        let mut opacity = vec![0.0; sprite_side * sprite_side];
        fill_disc(&mut opacity, sprite_side, reach as isize, reach as isize, radius);
        let colours = (0..balls).map_while(|ball| scene::colour(ball, channels));
        let sprites = colours.map(|colour| Sprite { opacity: opacity.clone(), colour }).collect();
        let start = |position, sprite_side| canvas_pixel(position) - (sprite_side / 2) as isize;
        Self::new(side, channels, BALL_SCALE, sprites, sprite_side, start)
    }

    fn new(
        side: usize,
        channels: usize,
        scale: usize,
        sprites: Vec<Sprite>,
        sprite_side: usize,
        start: fn(f64, usize) -> isize,
    ) -> Result<Self> {
        ensure!(
            side >= PICTURE_SIDE,
            "frames with a picture behind need a side of at least {PICTURE_SIDE} px, not {side}"
        );
        let shrink = Resize::shrink(side, scale);
        Ok(Self { side, channels, scale, sprites, sprite_side, start, shrink })
    }

    /// Prepares a source image, `[32, 32, 3]`.
    pub fn backdrop(&self, picture: ArrayView3<u8>) -> Backdrop {
        let enlarge = Resize::enlarge(picture.dim().0, self.canvas_side());
        let mut backdrop = Backdrop { canvas: Vec::new(), frame: Vec::new() };
        for channel in 0..self.channels {
            let level = |rgb: ndarray::ArrayView1<u8>| match self.channels {
                1 => rgb.iter().zip(GREY).map(|(&v, share)| share * f64::from(v)).sum::<f64>() / 255.0,
                _ => f64::from(rgb[channel]) / 255.0,
            };
            let enlarged = enlarge.apply(&picture.rows().into_iter().map(level).collect::<Vec<_>>());
            let canvas: Vec<f64> = enlarged.iter().map(|v| (v - DARKENING).clamp(0.0, 1.0)).collect();
            backdrop.frame.extend(self.shrink.apply(&canvas));
            backdrop.canvas.extend(canvas);
        }
        backdrop
    }

    /// Draws at most as many objects as there are sprites. `canvas` holds the backdrop's, before and after.
    pub fn draw(&self, positions: &[[f64; 2]], backdrop: &Backdrop, canvas: &mut [f64], frame: &mut [u8]) {
        let canvas_side = self.canvas_side();
        let mut planes = backdrop.frame.clone();
        self.blend(positions, canvas);
        let mut line = Vec::new();
        for position in positions {
            let [columns, rows] = position.map(|p| self.span(p));
            let (window_rows, window_columns) =
                (self.shrink.reached(rows.clone()), self.shrink.reached(columns.clone()));
            for (plane, canvas) in
                planes.chunks_mut(self.side * self.side).zip(canvas.chunks(canvas_side * canvas_side))
            {
                self.shrink.apply_window(canvas, window_rows.clone(), window_columns.clone(), &mut line, plane);
            }
        }
        for (channel, plane) in planes.chunks(self.side * self.side).enumerate() {
            quantise(plane, channel, self.channels, frame);
        }
        // Back to the bare backdrop for the next frame.
        for position in positions {
            let [columns, rows] = position.map(|p| self.span(p));
            for channel in 0..self.channels {
                for row in rows.clone() {
                    let start = (channel * canvas_side + row) * canvas_side;
                    let stretch = start + columns.start..start + columns.end;
                    canvas[stretch.clone()].copy_from_slice(&backdrop.canvas[stretch]);
                }
            }
        }
    }

    /// The same by shrinking the whole canvas: slow; what tests compare [`Self::draw`] with.
    pub fn draw_whole(&self, positions: &[[f64; 2]], backdrop: &Backdrop, frame: &mut [u8]) {
        let mut canvas = backdrop.canvas.clone();
        self.blend(positions, &mut canvas);
        for (channel, plane) in canvas.chunks(self.canvas_side().pow(2)).enumerate() {
            quantise(&self.shrink.apply(plane), channel, self.channels, frame);
        }
    }

    /// Lays the sprites over the canvas, in order.
    fn blend(&self, positions: &[[f64; 2]], canvas: &mut [f64]) {
        let side = self.canvas_side();
        for (position, sprite) in positions.iter().zip(&self.sprites) {
            let [left, top] = position.map(|p| (self.start)(p, self.sprite_side));
            let [columns, rows] = position.map(|p| self.span(p));
            for channel in 0..self.channels {
                let ink = sprite.colour[channel];
                for row in rows.clone() {
                    let from =
                        (row as isize - top) as usize * self.sprite_side + (columns.start as isize - left) as usize;
                    let start = (channel * side + row) * side;
                    let target = &mut canvas[start + columns.start..start + columns.end];
                    for (value, opacity) in target.iter_mut().zip(&sprite.opacity[from..]) {
                        *value = opacity * ink + (1.0 - opacity) * *value;
                    }
                }
            }
        }
    }

    fn canvas_side(&self) -> usize {
        self.side * self.scale
    }

    /// Canvas rows or columns that a sprite covers; empty where it lies outside.
    fn span(&self, position: f64) -> Range<usize> {
        let inside = |edge: isize| edge.clamp(0, self.canvas_side() as isize) as usize;
        let start = (self.start)(position, self.sprite_side);
        inside(start)..inside(start + self.sprite_side as isize)
    }
}
