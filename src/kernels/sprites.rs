//! Sprites moved by a separable spatial transformer and composed over a background, forward and backward, frame by frame.
//!
//! The computation is that of [`crate::network::physics_models::Decoder`]. Nothing but the frames goes to memory: what
//! the gradient needs of a frame is computed again. Loops over the pixels of a row become vectors in the compiler's hands.

use super::lanes::{Instructions, Lanes, dispatched};
use super::threads::{PARTS, in_parallel};

/// Floats that the compiler makes a vector or some of.
const WIDE: usize = 16;

/// The sizes of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scene {
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

impl Scene {
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
struct Sample {
    below: usize,
    above: usize,
    weights: [f32; 2],
}

impl Sample {
    fn new(pixel: f32, size: usize) -> Self {
        let below = pixel.floor();
        if !(below >= 0.0 && below + 1.0 <= (size - 1) as f32) {
            // What is not a number shows in the weight.
            let weight = if pixel.is_nan() { f32::NAN } else { 0.0 };
            return Sample { below: 0, above: 0, weights: [weight; 2] };
        }
        Sample { below: below as usize, above: below as usize + 1, weights: [below + 1.0 - pixel, pixel - below] }
    }

    fn is_outside(&self) -> bool {
        self.below == self.above && self.weights == [0.0; 2]
    }
}

/// Memory for one frame.
struct Workspace {
    /// Samples of each object's rows and columns, `[objects, side]`.
    rows: Vec<Sample>,
    columns: Vec<Sample>,
    /// Sprites with their columns sampled, `[objects, layers, window, row]`.
    sampled: Vec<f32>,
    /// A row of each object's layers, `[objects, layers, row]`; logits, then masks, in the first.
    line: Vec<f32>,
    /// The background's mask in a row, and the sum over all masks.
    rest: Vec<f32>,
    sum: Vec<f32>,
}

impl Workspace {
    fn new(scene: &Scene) -> Self {
        let (objects, row) = (scene.objects, scene.row());
        Workspace {
            rows: vec![Sample::default(); objects * scene.side],
            columns: vec![Sample::default(); objects * scene.side],
            sampled: vec![0.0; objects * scene.layers() * scene.window * row],
            line: vec![0.0; objects * scene.layers() * row],
            rest: vec![0.0; row],
            sum: vec![0.0; row],
        }
    }

    /// Samples the columns of a frame's sprites.
    #[inline(always)]
    fn sample_columns(&mut self, scene: &Scene, drawn: &Drawn, (frame, frames): (usize, usize)) {
        let (side, window, row) = (scene.side, scene.window, scene.row());
        for object in 0..scene.objects {
            let given = (object * frames + frame) * side;
            let sample = |pixels: &[f32], samples: &mut [Sample]| {
                for (sample, &pixel) in samples.iter_mut().zip(&pixels[given..given + side]) {
                    *sample = Sample::new(pixel, window);
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
    fn compose_row(&mut self, scene: &Scene, y: usize) {
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
    fn softmax(&mut self, scene: &Scene) {
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
    // Adding it rounds to a whole number, which then stands in the last bits.
    const ROUND: f32 = 12_582_912.0;
    let x = if x < -87.0 { -87.0 } else { x };
    let shifted = x * std::f32::consts::LOG2_E + ROUND;
    let whole = shifted - ROUND;
    let r = x - whole * 0.693_359_4 + whole * 2.121_944_4e-4;
    let polynomial =
        ((((1.987_569_1e-4 * r + 1.398_199_9e-3) * r + 8.333_452e-3) * r + 4.166_579_6e-2) * r + 0.166_666_65) * r
            + 0.5;
    let power = f32::from_bits((shifted.to_bits() << 23).wrapping_add(1.0_f32.to_bits()));
    (polynomial * r * r + r + 1.0) * power
}

/// Draws frames `[frames, channels, side, side]`.
pub fn draw(instructions: Instructions, scene: &Scene, drawn: &Drawn, to: &mut [f32]) {
    let frames = check(scene, drawn, to.len());
    let part = frames.div_ceil(PARTS).max(1);
    let parts: Vec<_> = to.chunks_mut(part * scene.frame()).enumerate().collect();
    in_parallel(parts, |(number, to)| draw_part(instructions, scene, drawn, (number * part, frames), to));
}

/// # Panics
/// Arrays that do not fit together.
fn check(scene: &Scene, drawn: &Drawn, floats: usize) -> usize {
    let frames = floats / scene.frame();
    assert_eq!(floats, frames * scene.frame());
    assert_eq!(drawn.sprites.len(), scene.objects * scene.sprite());
    assert_eq!(drawn.background.len(), scene.frame());
    assert_eq!(drawn.rows.len(), scene.objects * frames * scene.side);
    assert_eq!(drawn.columns.len(), drawn.rows.len());
    frames
}

dispatched! {
    fn draw_part(scene: &Scene, drawn: &Drawn, place: (usize, usize), to: &mut [f32]) = draw_frames
}

#[inline(always)]
fn draw_frames<L: Lanes>(scene: &Scene, drawn: &Drawn, (first, frames): (usize, usize), to: &mut [f32]) {
    let (side, row, layers) = (scene.side, scene.row(), scene.layers());
    let mut space = Workspace::new(scene);
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

/// From the gradient of the frames those of what was drawn.
pub fn draw_backward(instructions: Instructions, scene: &Scene, drawn: &Drawn, gradient: &[f32]) -> DrawnGradients {
    let frames = check(scene, drawn, gradient.len());
    let part = frames.div_ceil(PARTS).max(1);
    let parts: Vec<_> = gradient.chunks(part * scene.frame()).enumerate().collect();
    let parts = in_parallel(parts, |(number, gradient)| {
        let mut sums = PartGradients::new(scene, gradient.len() / scene.frame());
        draw_part_backward(instructions, scene, drawn, (number * part, frames), gradient, &mut sums);
        sums
    });
    let mut all = DrawnGradients {
        sprites: vec![0.0; drawn.sprites.len()],
        background: vec![0.0; drawn.background.len()],
        rows: vec![0.0; drawn.rows.len()],
        columns: vec![0.0; drawn.columns.len()],
    };
    for (number, part_sums) in parts.into_iter().enumerate() {
        let add = |sum: &mut [f32], part: &[f32]| sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        add(&mut all.sprites, &part_sums.sprites);
        add(&mut all.background, &part_sums.background);
        let count = part_sums.frames * scene.side;
        for object in 0..scene.objects {
            let to = (object * frames + number * part) * scene.side;
            all.rows[to..to + count].copy_from_slice(&part_sums.rows[object * count..][..count]);
            all.columns[to..to + count].copy_from_slice(&part_sums.columns[object * count..][..count]);
        }
    }
    all
}

/// Gradients of some frames: sums for what all frames share, `[objects, frames, side]` of rows and columns.
pub struct PartGradients {
    frames: usize,
    sprites: Vec<f32>,
    background: Vec<f32>,
    rows: Vec<f32>,
    columns: Vec<f32>,
}

impl PartGradients {
    fn new(scene: &Scene, frames: usize) -> Self {
        let lines = vec![0.0; scene.objects * frames * scene.side];
        PartGradients {
            frames,
            sprites: vec![0.0; scene.objects * scene.sprite()],
            background: vec![0.0; scene.frame()],
            rows: lines.clone(),
            columns: lines,
        }
    }
}

dispatched! {
    fn draw_part_backward(
        scene: &Scene, drawn: &Drawn, place: (usize, usize), gradient: &[f32], sums: &mut PartGradients,
    ) = draw_frames_backward
}

/// Gradients within a frame.
struct FrameGradients {
    /// As [`Workspace::sampled`].
    sampled: Vec<f32>,
    /// As [`Workspace::line`], of one object.
    line: Vec<f32>,
    /// A row of each channel of the frame's gradient.
    frame: Vec<f32>,
    /// `sum_i mask_i dmask_i` in a row.
    mean: Vec<f32>,
    behind: Vec<f32>,
}

#[inline(always)]
fn draw_frames_backward<L: Lanes>(
    scene: &Scene,
    drawn: &Drawn,
    (first, frames): (usize, usize),
    gradient: &[f32],
    sums: &mut PartGradients,
) {
    let row = scene.row();
    let mut space = Workspace::new(scene);
    let mut back = FrameGradients {
        sampled: vec![0.0; space.sampled.len()],
        line: vec![0.0; scene.layers() * row],
        frame: vec![0.0; scene.channels * row],
        mean: vec![0.0; row],
        behind: vec![0.0; row],
    };
    for (frame, gradient) in gradient.chunks_exact(scene.frame()).enumerate() {
        space.sample_columns(scene, drawn, (first + frame, frames));
        back.sampled.fill(0.0);
        for y in 0..scene.side {
            space.compose_row(scene, y);
            back.through_background(scene, drawn, &space, gradient, &mut sums.background, y);
            for object in 0..scene.objects {
                back.through_masks(scene, &space, object);
                let slope = back.through_row(scene, &space, object, y);
                sums.rows[(object * sums.frames + frame) * scene.side + y] = slope;
            }
        }
        for object in 0..scene.objects {
            let columns = &mut sums.columns[(object * sums.frames + frame) * scene.side..][..scene.side];
            let sprite = object * scene.sprite()..(object + 1) * scene.sprite();
            let sprites = (&drawn.sprites[sprite.clone()], &mut sums.sprites[sprite]);
            back.through_columns(scene, &space, object, sprites, columns);
        }
    }
}

impl FrameGradients {
    /// Takes a row of the gradient, adds the background's share of it, and finds the masks' mean gradient.
    #[inline(always)]
    fn through_background(
        &mut self,
        scene: &Scene,
        drawn: &Drawn,
        space: &Workspace,
        gradient: &[f32],
        background: &mut [f32],
        y: usize,
    ) {
        let (side, row, layers) = (scene.side, scene.row(), scene.layers());
        self.mean.fill(0.0);
        for channel in 0..scene.channels {
            let place = channel * scene.pixels() + y * side;
            self.behind[..side].copy_from_slice(&drawn.background[place..place + side]);
            let back = &mut self.frame[channel * row..][..row];
            back[..side].copy_from_slice(&gradient[place..place + side]);
            let rest = &space.rest[..row];
            for ((sum, back), mask) in background[place..place + side].iter_mut().zip(&*back).zip(rest) {
                *sum += back * mask;
            }
            let (mean, behind) = (&mut self.mean[..row], &self.behind[..row]);
            for x in 0..row {
                mean[x] += rest[x] * back[x] * behind[x];
            }
            for of_object in space.line.chunks_exact(layers * row) {
                let (masks, colours) = (&of_object[..row], &of_object[(1 + channel) * row..][..row]);
                for x in 0..row {
                    mean[x] += masks[x] * back[x] * colours[x];
                }
            }
        }
    }

    /// The gradients of an object's layers in the row.
    #[inline(always)]
    fn through_masks(&mut self, scene: &Scene, space: &Workspace, object: usize) {
        let (row, layers) = (scene.row(), scene.layers());
        let of_object = &space.line[object * layers * row..][..layers * row];
        let masks = &of_object[..row];
        let (logits, colours) = self.line.split_at_mut(row);
        let mean = &self.mean[..row];
        for x in 0..row {
            logits[x] = -mean[x];
        }
        for channel in 0..scene.channels {
            let (seen, back) = (&of_object[(1 + channel) * row..][..row], &self.frame[channel * row..][..row]);
            let colour = &mut colours[channel * row..][..row];
            for x in 0..row {
                logits[x] += back[x] * seen[x];
                colour[x] = masks[x] * back[x];
            }
        }
        for x in 0..row {
            logits[x] *= masks[x];
        }
    }

    /// Adds the row's gradients to those of the sampled sprite; gives that of the row's source pixel.
    #[inline(always)]
    fn through_row(&mut self, scene: &Scene, space: &Workspace, object: usize, y: usize) -> f32 {
        let (row, layers, window) = (scene.row(), scene.layers(), scene.window);
        let sample = space.rows[object * scene.side + y];
        if sample.is_outside() {
            return 0.0;
        }
        let mut slope = [0.0; WIDE];
        for layer in 0..layers {
            let place = (object * layers + layer) * window * row;
            let [below, above] = [sample.below, sample.above].map(|source| place + source * row);
            let line = &self.line[layer * row..][..row];
            for (place, weight) in [(below, sample.weights[0]), (above, sample.weights[1])] {
                let sampled = &mut self.sampled[place..][..row];
                for x in 0..row {
                    sampled[x] += weight * line[x];
                }
            }
            let (below, above) = (&space.sampled[below..][..row], &space.sampled[above..][..row]);
            let steps = below.chunks_exact(WIDE).zip(above.chunks_exact(WIDE));
            for (line, (below, above)) in line.chunks_exact(WIDE).zip(steps) {
                for x in 0..WIDE {
                    slope[x] += line[x] * (above[x] - below[x]);
                }
            }
        }
        slope.iter().sum()
    }

    /// From the gradients of the sampled sprite those of the sprite and of the columns' source pixels.
    #[inline(always)]
    fn through_columns(
        &self,
        scene: &Scene,
        space: &Workspace,
        object: usize,
        (sprite, sprite_sums): (&[f32], &mut [f32]),
        columns: &mut [f32],
    ) {
        let (row, window, side) = (scene.row(), scene.window, scene.side);
        let samples = &space.columns[object * side..][..side];
        let sampled = &self.sampled[object * scene.layers() * window * row..];
        let lines = sprite.chunks_exact(window).zip(sprite_sums.chunks_exact_mut(window));
        for ((source, sums), back) in lines.zip(sampled.chunks_exact(row)) {
            for ((column, sample), back) in columns.iter_mut().zip(samples).zip(back) {
                sums[sample.below] += sample.weights[0] * back;
                sums[sample.above] += sample.weights[1] * back;
                *column += (source[sample.above] - source[sample.below]) * back;
            }
        }
    }
}
