//! Black-box decoder: a perceptron from the positions of all objects to the pixels of the frame.
//!
//! Paper: the ablation of section 4, whose sizes are not published. Two hidden layers, as wide as gives it as many weights as
//! the coordinate-consistent decoder has.

use tch::Tensor;
use tch::nn::Path;

use super::Rendering;
use crate::network::System;
use crate::network::blocks::{Activation, CONSTANT_INPUTS, HIDDEN, Layers, Mlp};
use crate::network::system::Scaling;

/// Two hidden layers of ReLU, and a sigmoid for the colours.
#[derive(Debug)]
pub struct MlpDecoder {
    layers: Mlp,
    objects: i64,
    channels: i64,
    side: i64,
    /// Of the positions.
    scaling: Scaling,
}

impl MlpDecoder {
    pub fn new(scope: Path, system: &System) -> Self {
        let (inputs, hidden, pixels) = widths(system);
        let widths = [inputs, hidden, hidden, pixels];
        MlpDecoder {
            layers: Mlp::new(&mut Layers::new(scope), &widths, Activation::Relu, Activation::None),
            objects: system.objects as i64,
            channels: system.channels as i64,
            side: system.side as i64,
            scaling: system.scaling(),
        }
    }

    /// Frames of `positions` (`[frames, coordinates * objects]`), drawn as one background.
    pub fn forward(&self, positions: &Tensor) -> Rendering {
        let logits = self.layers.forward(&self.scaling.of(positions));
        let (frames, side) = (positions.size()[0], self.side);
        let like = (positions.kind(), positions.device());
        let hidden = Tensor::zeros([self.objects, frames, side, side], like);
        let background = Tensor::ones([1, frames, side, side], like);
        Rendering {
            frames: logits.sigmoid().reshape([frames, self.channels, side, side]),
            masks: Tensor::cat(&[hidden, background], 0),
            contents: Tensor::zeros([self.objects, frames, self.channels, side, side], like),
        }
    }

    pub(crate) fn detached(&self) -> Self {
        MlpDecoder { layers: self.layers.detached(), ..*self }
    }

    /// Begins every frame at these logits, `[channels, S, S]`, the last kernel scaled by `kernel`.
    pub fn start_background(&self, logits: &Tensor, kernel: f64) {
        self.layers.output().start_at(logits, kernel);
    }
}

/// Numbers of a position, units of a hidden layer, numbers of a frame.
fn widths(system: &System) -> (usize, usize, usize) {
    let (window, pixels) = (system.side / 2, system.side * system.side * system.channels);
    let sprites = system.objects * window * window * (1 + system.channels);
    // Three learned arrays, each the output of a network, and sigma.
    let most = 3 * (CONSTANT_INPUTS + 1) * HIDDEN + (HIDDEN + 1) * (sprites + pixels) + 1;
    let inputs = system.coordinates();
    let weights = |hidden: usize| (inputs + 1) * hidden + (hidden + 1) * hidden + (hidden + 1) * pixels;
    let hidden = (1..).take_while(|hidden| weights(*hidden) <= most).last().unwrap_or(1);
    (inputs, hidden, pixels)
}
