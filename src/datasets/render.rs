//! From positions to frames: draws on an enlarged canvas and shrinks it with anti-aliasing, as the original does.
//!
//! Frames are uint8 `[S, S, 3]`, row-major, RGB. Grey levels are cut off, not rounded. Within 1 grey level of the
//! original's skimage for balls, 2 for digits. Original: `nn/datasets/generators.py`.

use anyhow::{Result, ensure};

use super::resize::Resize;
use super::sprites::{DIGIT_SIDE, Sprites};

/// Colour channels of a frame.
pub const CHANNELS: usize = 3;
/// Half the width of a digit, pixels: 28 px MNIST images cut to 22.
pub const DIGIT_RADIUS: f64 = 11.0;

const BALL_SCALE: usize = 10;
const DIGIT_SCALE: usize = 5;
/// Taken off the background's brightness, of 1, so that the digits stand out.
const DARKENING: f64 = 0.2;

/// Buffers that one thread reuses from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct Scratch {
    planes: Vec<f64>,
    canvas: Vec<f64>,
    line: Vec<f64>,
}

/// Draws the frames of one scene.
#[derive(Debug, Clone)]
pub enum Renderer {
    Balls(Balls),
    Digits(Digits),
}

impl Renderer {
    /// Draws objects at `positions` (pixels, `(x, y)`) into `frame` (`S * S * 3` values).
    pub fn draw(&self, positions: &[[f64; 2]], scratch: &mut Scratch, frame: &mut [u8]) {
        match self {
            Self::Balls(balls) => balls.draw(positions, scratch, frame),
            Self::Digits(digits) => digits.draw(positions, scratch, frame),
        }
    }
}

/// Filled discs on black; disc j has channel 2 - j to itself.
///
/// Shrinking is linear and the same everywhere off the border, so a disc's image depends only on where its centre lies
/// within its pixel: one small image for each of those places is kept. The mirroring border is a second,
/// reflected disc.
#[derive(Debug, Clone)]
pub struct Balls {
    side: usize,
    /// Radius on the canvas, canvas pixels.
    radius: f64,
    shrink: Resize,
    /// Pixels from a disc's own pixel to the patch's border.
    half: usize,
    /// The shrunk disc for each (row, column) of the centre within its pixel, `[2 half + 1, 2 half + 1]`.
    patches: Vec<Vec<f64>>,
}

impl Balls {
    /// Discs of `radius` pixels in frames of `side` pixels.
    pub fn new(side: usize, radius: f64) -> Self {
        let radius = radius * BALL_SCALE as f64;
        let blur = 4.0 * (BALL_SCALE as f64 - 1.0) / 2.0;
        let half = ((radius + blur) / BALL_SCALE as f64).ceil() as usize + 1;
        let patch_side = 2 * half + 1;
        let patch_shrink = Resize::shrink(patch_side, BALL_SCALE);
        let patches = (0..BALL_SCALE * BALL_SCALE)
            .map(|place| {
                let mut canvas = vec![0.0; (patch_side * BALL_SCALE).pow(2)];
                let centre = |offset: usize| (half * BALL_SCALE + offset) as isize;
                let (y, x) = (centre(place / BALL_SCALE), centre(place % BALL_SCALE));
                fill_disc(&mut canvas, patch_side * BALL_SCALE, y, x, radius);
                patch_shrink.apply(&canvas)
            })
            .collect();
        Self { side, radius, shrink: Resize::shrink(side, BALL_SCALE), half, patches }
    }

    /// Draws at most three discs.
    pub fn draw(&self, positions: &[[f64; 2]], scratch: &mut Scratch, frame: &mut [u8]) {
        frame.fill(0);
        for (ball, position) in positions.iter().enumerate() {
            let [x, y] = position.map(canvas_pixel);
            scratch.planes.clear();
            scratch.planes.resize(self.side * self.side, 0.0);
            if self.inside(x) && self.inside(y) {
                let last = (self.side * BALL_SCALE) as isize - 1;
                for row in [y, -y, 2 * last - y] {
                    for column in [x, -x, 2 * last - x] {
                        self.stamp(row, column, &mut scratch.planes);
                    }
                }
                quantise(&scratch.planes, CHANNELS - 1 - ball, frame);
            } else {
                quantise(&self.whole_canvas(x, y), CHANNELS - 1 - ball, frame);
            }
        }
    }

    /// The same by drawing and shrinking the whole canvas: slow; what tests compare [`Self::draw`] with.
    pub fn draw_whole(&self, positions: &[[f64; 2]], frame: &mut [u8]) {
        frame.fill(0);
        for (ball, position) in positions.iter().enumerate() {
            let [x, y] = position.map(canvas_pixel);
            quantise(&self.whole_canvas(x, y), CHANNELS - 1 - ball, frame);
        }
    }

    fn whole_canvas(&self, x: isize, y: isize) -> Vec<f64> {
        let side = self.side * BALL_SCALE;
        let mut canvas = vec![0.0; side * side];
        fill_disc(&mut canvas, side, y, x, self.radius);
        self.shrink.apply(&canvas)
    }

    /// Whether a disc at this coordinate stays off the border pixels. There, the disc and its mirror image overlap and
    /// do not add up. A frame smaller than a patch would need mirror images of mirror images.
    fn inside(&self, centre: isize) -> bool {
        let reach = self.radius.ceil() as isize;
        let last = (self.side * BALL_SCALE) as isize - 1;
        self.side > 2 * self.half && centre >= reach && centre + reach <= last
    }

    /// Adds the image of a disc centred at this canvas pixel, which may lie outside.
    fn stamp(&self, row: isize, column: isize, plane: &mut [f64]) {
        let scale = BALL_SCALE as isize;
        let (half, side) = (self.half as isize, self.side as isize);
        let patch_side = 2 * self.half + 1;
        let (top, left) = (row.div_euclid(scale) - half, column.div_euclid(scale) - half);
        let place = row.rem_euclid(scale) * scale + column.rem_euclid(scale);
        let patch = &self.patches[place as usize];
        let rows = top.max(0)..(top + patch_side as isize).min(side);
        let columns = left.max(0)..(left + patch_side as isize).min(side);
        if columns.is_empty() {
            return;
        }
        for y in rows {
            let from = (y - top) as usize * patch_side + (columns.start - left) as usize;
            let to = (y * side + columns.start) as usize;
            let width = (columns.end - columns.start) as usize;
            for (sum, value) in plane[to..to + width].iter_mut().zip(&patch[from..from + width]) {
                *sum += value;
            }
        }
    }
}

/// MNIST digits over a darkened picture; digit j is opaque in channel j and blots out the other two.
///
/// Blending is not linear, so the canvas is drawn anew for each frame, but shrunk only around the digits.
#[derive(Debug, Clone)]
pub struct Digits {
    side: usize,
    /// Sprites on the canvas, `[110, 110]`, opacity 0..1.
    sprites: Vec<Vec<f64>>,
    /// The background's channels on the canvas and in the frame, 0..1, channel by channel.
    background_canvas: Vec<f64>,
    background: Vec<f64>,
    shrink: Resize,
}

impl Digits {
    /// Frames of `side` pixels with these source images.
    ///
    /// # Errors
    /// A frame smaller than the background picture.
    pub fn new(side: usize, sources: &Sprites) -> Result<Self> {
        let picture = sources.background.dim().0;
        ensure!(side >= picture, "frames with digits need a side of at least {picture} px, not {side}");
        let canvas_side = side * DIGIT_SCALE;
        let enlarge = Resize::enlarge(picture, canvas_side);
        let shrink = Resize::shrink(side, DIGIT_SCALE);
        let (mut background_canvas, mut background) = (Vec::new(), Vec::new());
        for channel in 0..CHANNELS {
            let pixels = sources.background.slice(ndarray::s![.., .., channel]);
            let enlarged = enlarge.apply(&pixels.iter().map(|&v| f64::from(v) / 255.0).collect::<Vec<_>>());
            let canvas: Vec<f64> = enlarged.iter().map(|v| (v - DARKENING).clamp(0.0, 1.0)).collect();
            background.extend(shrink.apply(&canvas));
            background_canvas.extend(canvas);
        }
        let border = (DIGIT_SIDE - 2 * DIGIT_RADIUS as usize) / 2;
        let enlarge = Resize::enlarge(DIGIT_SIDE - 2 * border, sprite_side());
        let sprites = sources
            .digits
            .iter()
            .map(|digit| {
                let middle = border..DIGIT_SIDE - border;
                let pixels = digit.slice(ndarray::s![middle.clone(), middle]);
                enlarge.apply(&pixels.iter().map(|&v| f64::from(v) / 255.0).collect::<Vec<_>>())
            })
            .collect();
        Ok(Self { side, sprites, background_canvas, background, shrink })
    }

    /// Draws at most three digits, as many as there are sprites.
    pub fn draw(&self, positions: &[[f64; 2]], scratch: &mut Scratch, frame: &mut [u8]) {
        let canvas_side = self.side * DIGIT_SCALE;
        let Scratch { planes, canvas, line } = scratch;
        if canvas.len() != self.background_canvas.len() {
            canvas.clone_from(&self.background_canvas);
        }
        planes.clone_from(&self.background);
        self.blend(positions, canvas);
        for position in positions {
            let [columns, rows] = position.map(|p| span(p, canvas_side));
            let (window_rows, window_columns) =
                (self.shrink.reached(rows.clone()), self.shrink.reached(columns.clone()));
            for (plane, canvas) in
                planes.chunks_mut(self.side * self.side).zip(canvas.chunks(canvas_side * canvas_side))
            {
                self.shrink.apply_window(canvas, window_rows.clone(), window_columns.clone(), line, plane);
            }
        }
        for (channel, plane) in planes.chunks(self.side * self.side).enumerate() {
            quantise(plane, channel, frame);
        }
        // Back to the bare background for the next frame.
        for position in positions {
            let [columns, rows] = position.map(|p| span(p, canvas_side));
            for channel in 0..CHANNELS {
                for row in rows.clone() {
                    let start = (channel * canvas_side + row) * canvas_side;
                    let stretch = start + columns.start..start + columns.end;
                    canvas[stretch.clone()].copy_from_slice(&self.background_canvas[stretch]);
                }
            }
        }
    }

    /// The same by shrinking the whole canvas: slow; what tests compare [`Self::draw`] with.
    pub fn draw_whole(&self, positions: &[[f64; 2]], frame: &mut [u8]) {
        let mut canvas = self.background_canvas.clone();
        self.blend(positions, &mut canvas);
        for (channel, plane) in canvas.chunks((self.side * DIGIT_SCALE).pow(2)).enumerate() {
            quantise(&self.shrink.apply(plane), channel, frame);
        }
    }

    /// Lays the sprites over the canvas, in order.
    fn blend(&self, positions: &[[f64; 2]], canvas: &mut [f64]) {
        let side = self.side * DIGIT_SCALE;
        for (digit, (position, sprite)) in positions.iter().zip(&self.sprites).enumerate() {
            let [left, top] = position.map(sprite_start);
            let [columns, rows] = position.map(|p| span(p, side));
            for channel in 0..CHANNELS {
                let ink = if channel == digit { 1.0 } else { 0.0 };
                for row in rows.clone() {
                    let from = (row as isize - top) as usize * sprite_side() + (columns.start as isize - left) as usize;
                    let start = (channel * side + row) * side;
                    let target = &mut canvas[start + columns.start..start + columns.end];
                    for (value, opacity) in target.iter_mut().zip(&sprite[from..]) {
                        *value = opacity * ink + (1.0 - opacity) * *value;
                    }
                }
            }
        }
    }
}

/// Side of a sprite on the canvas.
fn sprite_side() -> usize {
    2 * DIGIT_RADIUS as usize * DIGIT_SCALE
}

/// First canvas row or column of a sprite; negative where it hangs over the border.
fn sprite_start(position: f64) -> isize {
    ((position - DIGIT_RADIUS) * DIGIT_SCALE as f64).round_ties_even() as isize
}

/// Canvas rows or columns that a sprite covers; empty where it lies outside.
fn span(position: f64, canvas_side: usize) -> std::ops::Range<usize> {
    let inside = |edge: isize| edge.clamp(0, canvas_side as isize) as usize;
    let start = sprite_start(position);
    inside(start)..inside(start + sprite_side() as isize)
}

/// Canvas pixel of a ball's centre.
fn canvas_pixel(position: f64) -> isize {
    (position * BALL_SCALE as f64) as isize
}

/// Sets the pixels nearer than `radius` to the centre.
fn fill_disc(canvas: &mut [f64], side: usize, y: isize, x: isize, radius: f64) {
    let reach = radius.ceil() as isize;
    let clip = |centre: isize| (centre - reach).max(0)..(centre + reach + 1).min(side as isize);
    for row in clip(y) {
        for column in clip(x) {
            let (dy, dx) = ((row - y) as f64, (column - x) as f64);
            if dy * dy + dx * dx < radius * radius {
                canvas[row as usize * side + column as usize] = 1.0;
            }
        }
    }
}

/// Writes a plane of 0..1 as grey levels into one channel of a frame.
fn quantise(plane: &[f64], channel: usize, frame: &mut [u8]) {
    for (pixel, value) in frame.chunks_exact_mut(CHANNELS).zip(plane) {
        pixel[channel] = (value.min(1.0) * 255.0) as u8;
    }
}
