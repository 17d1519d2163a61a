//! Sprites moved by a separable spatial transformer and composed over a background, frame by frame.
//!
//! The computation is that of [`crate::compose`], at the places of [`crate::draw`]. Nothing but the frames goes to memory: what
//! the gradient needs of a frame is computed again. Loops over the pixels of a row become vectors in the compiler's hands.

mod backward;

use super::exponential::reduced;
use super::simd::{Instructions, Lanes, dispatched};
use super::threads::{in_parallel, part_of};

pub use backward::draw_backward;

/// Floats that the compiler makes a vector or some of.
const WIDE: usize = 16;

/// The sizes of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneSizes {
    pub objects: usize,
    /// Colours of a pixel. A sprite has one channel more, its mask's logits, which come first.
    pub channels: usize,
    /// Side of a sprite.
    pub window: usize,
    /// Side of a frame.
    pub side: usize,
    /// Taken off a mask's logit after it was sampled.
    pub outside: f32,
    /// The background's logit.
    pub background: f32,
}

impl SceneSizes {
    fn layers(&self) -> usize {
        1 + self.channels
    }

    /// Floats of a row, filled up to whole vectors.
    fn row(&self) -> usize {
        self.side.next_multiple_of(WIDE)
    }

    fn pixels(&self) -> usize {
        self.side * self.side
    }

    fn sprite(&self) -> usize {
        self.layers() * self.window * self.window
    }

    fn frame(&self) -> usize {
        self.channels * self.pixels()
    }
}

/// What is drawn: sprites `[objects, 1 + channels, window, window]`, a background `[channels, side, side]`, and the
/// source pixel of each row and column, `[objects, frames, side]`.
#[derive(Debug, Clone, Copy)]
pub struct Drawn<'a> {
    pub sprites: &'a [f32],
    pub background: &'a [f32],
    pub rows: &'a [f32],
    pub columns: &'a [f32],
}

/// Gradients of what was drawn, in the same order and layout.
#[derive(Debug)]
pub struct DrawnGradients {
    pub sprites: Vec<f32>,
    pub background: Vec<f32>,
    pub rows: Vec<f32>,
    pub columns: Vec<f32>,
}

/// Where a row or column falls in a sprite: between two pixels with these weights, or outside, where both weights are 0.
#[derive(Debug, Clone, Copy, Default)]
struct SpriteSample {
    below: usize,
    above: usize,
    weights: [f32; 2],
}

impl SpriteSample {
    fn new(pixel: f32, size: usize) -> Self {
        let below = pixel.floor();
        if !(below >= 0.0 && below + 1.0 <= (size - 1) as f32) {
            // What is no place shows in the weight.
            let weight = if pixel.is_finite() { 0.0 } else { f32::NAN };
            return SpriteSample { below: 0, above: 0, weights: [weight; 2] };
        }
        SpriteSample { below: below as usize, above: below as usize + 1, weights: [below + 1.0 - pixel, pixel - below] }
    }

    fn is_outside(&self) -> bool {
        self.below == self.above && self.weights == [0.0; 2]
    }
}

/// Memory for one frame.
struct FrameWorkspace {
    /// Samples of each object's rows and columns, `[objects, side]`.
    rows: Vec<SpriteSample>,
    columns: Vec<SpriteSample>,
    /// Sprites with their columns sampled, `[objects, layers, window, row]`.
    sampled: Vec<f32>,
    /// A row of each object's layers, `[objects, layers, row]`; logits, then masks, in the first.
    line: Vec<f32>,
    /// The background's mask in a row, and the sum over all masks.
    rest: Vec<f32>,
    sum: Vec<f32>,
}

impl FrameWorkspace {
    fn new(scene: &SceneSizes) -> Self {
        let (objects, row) = (scene.objects, scene.row());
        FrameWorkspace {
            rows: vec![SpriteSample::default(); objects * scene.side],
            columns: vec![SpriteSample::default(); objects * scene.side],
            sampled: vec![0.0; objects * scene.layers() * scene.window * row],
            line: vec![0.0; objects * scene.layers() * row],
            rest: vec![0.0; row],
            sum: vec![0.0; row],
        }
    }

    /// Samples the columns of a frame's sprites.
    #[inline(always)]
    fn sample_columns(&mut self, scene: &SceneSizes, drawn: &Drawn, (frame, frames): (usize, usize)) {
        let (side, window, row) = (scene.side, scene.window, scene.row());
        for object in 0..scene.objects {
            let given = (object * frames + frame) * side;
            let sample = |pixels: &[f32], samples: &mut [SpriteSample]| {
                for (sample, &pixel) in samples.iter_mut().zip(&pixels[given..given + side]) {
                    *sample = SpriteSample::new(pixel, window);
                }
            };
            sample(drawn.rows, &mut self.rows[object * side..][..side]);
            sample(drawn.columns, &mut self.columns[object * side..][..side]);
            let columns = &self.columns[object * side..][..side];
            let sprite = &drawn.sprites[object * scene.sprite()..][..scene.sprite()];
            let sampled = &mut self.sampled[object * scene.layers() * window * row..];
            for (source, sampled) in sprite.chunks_exact(window).zip(sampled.chunks_exact_mut(row)) {
                for (value, sample) in sampled.iter_mut().zip(columns) {
                    *value = sample.weights[0] * source[sample.below] + sample.weights[1] * source[sample.above];
                }
            }
        }
    }

    /// The layers of a row, the masks of its objects and of the background.
    #[inline(always)]
    fn compose_row(&mut self, scene: &SceneSizes, y: usize) {
        let (row, layers, window) = (scene.row(), scene.layers(), scene.window);
        for object in 0..scene.objects {
            let sample = self.rows[object * scene.side + y];
            for layer in 0..layers {
                let source = &self.sampled[(object * layers + layer) * window * row..][..window * row];
                let below = &source[sample.below * row..][..row];
                let above = &source[sample.above * row..][..row];
                let line = &mut self.line[(object * layers + layer) * row..][..row];
                let less = if layer == 0 { scene.outside } else { 0.0 };
                for x in 0..row {
                    line[x] = sample.weights[0] * below[x] + sample.weights[1] * above[x] - less;
                }
            }
        }
        self.softmax(scene);
    }

    #[inline(always)]
    fn softmax(&mut self, scene: &SceneSizes) {
        let (row, stride) = (scene.row(), scene.layers() * scene.row());
        // `rest` holds the largest logit first.
        self.rest.fill(scene.background);
        for logits in self.line.chunks_exact(stride) {
            for (largest, &logit) in self.rest.iter_mut().zip(&logits[..row]) {
                *largest = if logit > *largest { logit } else { *largest };
            }
        }
        self.sum.fill(0.0);
        for logits in self.line.chunks_exact_mut(stride) {
            let (logits, largest, sum) = (&mut logits[..row], &self.rest[..row], &mut self.sum[..row]);
            for x in 0..row {
                logits[x] = exp(logits[x] - largest[x]);
                sum[x] += logits[x];
            }
        }
        let (rest, sum) = (&mut self.rest[..row], &mut self.sum[..row]);
        for x in 0..row {
            rest[x] = exp(scene.background - rest[x]);
            sum[x] = 1.0 / (sum[x] + rest[x]);
            rest[x] *= sum[x];
        }
        for masks in self.line.chunks_exact_mut(stride) {
            let (masks, sum) = (&mut masks[..row], &self.sum[..row]);
            for x in 0..row {
                masks[x] *= sum[x];
            }
        }
    }
}

/// e to the power of a number that is not above 0, to a rounding or two: Cephes's polynomial.
#[inline(always)]
fn exp(x: f32) -> f32 {
    let [power, r] = reduced(if x < -87.0 { -87.0 } else { x });
    let polynomial =
        ((((1.987_569_1e-4 * r + 1.398_199_9e-3) * r + 8.333_452e-3) * r + 4.166_579_6e-2) * r + 0.166_666_65) * r
            + 0.5;
    (polynomial * r * r + r + 1.0) * power
}

/// Draws frames `[frames, channels, side, side]`.
pub fn draw(instructions: Instructions, scene: &SceneSizes, drawn: &Drawn, to: &mut [f32]) {
    let frames = check(scene, drawn, to.len());
    let part = part_of(frames);
    let parts: Vec<_> = to.chunks_mut(part * scene.frame()).enumerate().collect();
    in_parallel(parts, |(number, to)| draw_part(instructions, scene, drawn, (number * part, frames), to));
}

/// # Panics
/// Arrays that do not fit together.
fn check(scene: &SceneSizes, drawn: &Drawn, floats: usize) -> usize {
    let frames = floats / scene.frame();
    assert_eq!(floats, frames * scene.frame());
    assert_eq!(drawn.sprites.len(), scene.objects * scene.sprite());
    assert_eq!(drawn.background.len(), scene.frame());
    assert_eq!(drawn.rows.len(), scene.objects * frames * scene.side);
    assert_eq!(drawn.columns.len(), drawn.rows.len());
    frames
}

dispatched! {
    fn draw_part(scene: &SceneSizes, drawn: &Drawn, place: (usize, usize), to: &mut [f32]) = draw_frames
}

#[inline(always)]
fn draw_frames<L: Lanes>(scene: &SceneSizes, drawn: &Drawn, (first, frames): (usize, usize), to: &mut [f32]) {
    let (side, row, layers) = (scene.side, scene.row(), scene.layers());
    let mut space = FrameWorkspace::new(scene);
    let mut background = vec![0.0; row];
    let mut line = vec![0.0; row];
    for (frame, to) in to.chunks_exact_mut(scene.frame()).enumerate() {
        space.sample_columns(scene, drawn, (first + frame, frames));
        for y in 0..side {
            space.compose_row(scene, y);
            for channel in 0..scene.channels {
                let place = channel * scene.pixels() + y * side;
                background[..side].copy_from_slice(&drawn.background[place..place + side]);
                for ((value, behind), mask) in line.iter_mut().zip(&background).zip(&space.rest) {
                    *value = behind * mask;
                }
                for of_object in space.line.chunks_exact(layers * row) {
                    let (masks, colours) = (&of_object[..row], &of_object[(1 + channel) * row..][..row]);
                    for x in 0..row {
                        line[x] += masks[x] * colours[x];
                    }
                }
                to[place..place + side].copy_from_slice(&line[..side]);
            }
        }
    }
}
