//! The gradients of a drawing.

use super::super::simd::{Instructions, Lanes, dispatched};
use super::super::threads::{in_parallel, part_of};
use super::{Drawn, DrawnGradients, FrameWorkspace, SceneSizes, WIDE, check};

/// From the gradient of the frames those of what was drawn.
pub fn draw_backward(
    instructions: Instructions,
    scene: &SceneSizes,
    drawn: &Drawn,
    gradient: &[f32],
) -> DrawnGradients {
    let frames = check(scene, drawn, gradient.len());
    let part = part_of(frames);
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
    fn new(scene: &SceneSizes, frames: usize) -> Self {
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
        scene: &SceneSizes, drawn: &Drawn, place: (usize, usize), gradient: &[f32], sums: &mut PartGradients,
    ) = draw_frames_backward
}

/// Gradients within a frame.
struct FrameGradients {
    /// As [`FrameWorkspace::sampled`].
    sampled: Vec<f32>,
    /// As [`FrameWorkspace::line`], of one object.
    line: Vec<f32>,
    /// A row of each channel of the frame's gradient.
    frame: Vec<f32>,
    /// `sum_i mask_i dmask_i` in a row.
    mean: Vec<f32>,
    behind: Vec<f32>,
}

#[inline(always)]
fn draw_frames_backward<L: Lanes>(
    scene: &SceneSizes,
    drawn: &Drawn,
    (first, frames): (usize, usize),
    gradient: &[f32],
    sums: &mut PartGradients,
) {
    let row = scene.row();
    let mut space = FrameWorkspace::new(scene);
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
        scene: &SceneSizes,
        drawn: &Drawn,
        space: &FrameWorkspace,
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
    fn through_masks(&mut self, scene: &SceneSizes, space: &FrameWorkspace, object: usize) {
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
    fn through_row(&mut self, scene: &SceneSizes, space: &FrameWorkspace, object: usize, y: usize) -> f32 {
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
        scene: &SceneSizes,
        space: &FrameWorkspace,
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
