//! Sprites moved by a separable spatial transformer and composed over a background.

use tch::{Device, Kind, Tensor};

use crate::autograd;
use crate::backend::{Backend, Kernels};
use crate::gpu;
use crate::interpolation::sample_separable;
use crate::simd::Instructions;
use crate::sprites::{self, Drawn, SceneSizes};
use crate::tensors::{floats, floats_mut};

/// Drawn frames and their layers.
#[derive(Debug)]
pub struct Rendering {
    /// `[frames, channels, S, S]` in \[0, 1\].
    pub frames: Tensor,
    /// Visibility of each object and of the background, summing to 1: `[objects + 1, frames, S, S]`.
    pub masks: Tensor,
    /// Each object's moved colours, `[objects, frames, channels, S, S]`.
    pub contents: Tensor,
}

/// Sprites `[objects, 1 + channels, window, window]` (mask logits, then colours), and a background
/// `[1, channels, side, side]`.
pub type SpriteLayers = [Tensor; 2];
/// Source pixels in a sprite of each row and each column of the frames, `[objects, frames, side]`.
pub type SourcePixels = [Tensor; 2];

/// The frames of a scene, `[frames, channels, side, side]`, for each of some lists of places, differentiable by
/// layers and places.
///
/// `layers` gives what is drawn: one value for all lists where a kernel draws them, one for each list where libtorch does.
pub fn draw<const LISTS: usize>(
    kernels: Kernels,
    scene: SceneSizes,
    layers: impl Fn() -> SpriteLayers,
    places: [SourcePixels; LISTS],
) -> [Tensor; LISTS] {
    let inputs: Vec<&Tensor> = places.iter().flatten().collect();
    match kernels.backend(&inputs) {
        Backend::Cpu(instructions) => {
            let [sprites, background] = layers();
            places.map(|[rows, columns]| on_cpu(instructions, scene, [&sprites, &background, &rows, &columns]))
        }
        Backend::Gpu if gpu::can_draw(&scene) => {
            let [sprites, background] = layers();
            places.map(|[rows, columns]| gpu::draw(scene, [&sprites, &background, &rows, &columns]))
        }
        Backend::Gpu | Backend::Libtorch => places.map(|places| by_libtorch(scene, layers(), places)),
    }
}

fn on_cpu(instructions: Instructions, scene: SceneSizes, inputs: [&Tensor; 4]) -> Tensor {
    let values = inputs.map(|input| input.detach().contiguous());
    let frames = inputs[2].size()[1];
    let [channels, side] = [scene.channels, scene.side].map(|n| n as i64);
    let mut frames = Tensor::empty([frames, channels, side, side], (Kind::Float, Device::Cpu));
    sprites::draw(instructions, &scene, &drawn(&values), floats_mut(&mut frames));
    if !autograd::records(&inputs) {
        return frames;
    }
    let sizes = inputs.map(|input| input.size());
    autograd::attach(frames, &inputs, move |gradient| {
        let gradient = gradient.contiguous();
        let gradients = sprites::draw_backward(instructions, &scene, &drawn(&values), floats(&gradient));
        let gradients = [gradients.sprites, gradients.background, gradients.rows, gradients.columns];
        gradients.iter().zip(&sizes).map(|(values, size)| Tensor::from_slice(values).reshape(size)).collect()
    })
}

fn drawn(values: &[Tensor; 4]) -> Drawn<'_> {
    let [sprites, background, rows, columns] = values.each_ref().map(floats);
    Drawn { sprites, background, rows, columns }
}

/// The same by libtorch.
pub fn by_libtorch(scene: SceneSizes, [sprites, background]: SpriteLayers, [rows, columns]: SourcePixels) -> Tensor {
    let moved = sample_separable(&sprites, &rows, &columns);
    compose(&moved, &background, f64::from(scene.outside), f64::from(scene.background)).frames
}

/// Moved layers, `[objects, frames, 1 + channels, S, S]`, over a background, by libtorch. `outside` is taken off the logits
/// of the objects' masks; `background_logit` is the background's.
pub fn compose(moved: &Tensor, background: &Tensor, outside: f64, background_logit: f64) -> Rendering {
    let (objects, channels) = (moved.size()[0], moved.size()[2] - 1);
    let template = moved.select(2, 0) - outside;
    let background_logit = template.narrow(0, 0, 1).full_like(background_logit);
    let masks = Tensor::cat(&[template, background_logit], 0).softmax(0, moved.kind());
    let contents = moved.narrow(2, 1, channels);
    let drawn = (masks.narrow(0, 0, objects).unsqueeze(2) * &contents).sum_dim_intlist([0i64].as_slice(), false, None);
    let frames = drawn + masks.select(0, objects).unsqueeze(1) * background;
    Rendering { frames, masks, contents }
}
