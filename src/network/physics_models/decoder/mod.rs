//! Decoders: positions to frames.
//!
//! The paper's draws each object's sprite where the object is. The other one is a perceptron, for which a position is a
//! number like any other (paper: the ablation of section 4).

mod coordinate_consistent;
mod mlp;

use serde::{Deserialize, Serialize};
use tch::Tensor;
use tch::nn::Path;

use self::coordinate_consistent::CoordinateConsistent;
use self::mlp::MlpDecoder;
use super::ModelOptions;
use crate::network::System;

pub use paig_kernels::Rendering;

/// How frames are drawn.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DecoderKind {
    /// Sprites that are moved to their positions.
    #[default]
    CoordinateConsistent,
    Mlp,
}

/// What the decoder has learned to draw, before the sigmoid of the colours.
#[derive(Debug)]
pub struct Sprites {
    /// Mask logits, `[objects, 1, S/2, S/2]`.
    pub template: Tensor,
    /// Colour logits, `[objects, channels, S/2, S/2]`.
    pub contents: Tensor,
    /// Colours in \[0, 1\], `[1, channels, S, S]`.
    pub background: Tensor,
}

/// A decoder of either kind.
#[derive(Debug)]
pub struct Decoder(DecoderNetwork);

#[derive(Debug)]
enum DecoderNetwork {
    CoordinateConsistent(Box<CoordinateConsistent>),
    Mlp(MlpDecoder),
}

impl Decoder {
    pub fn new(scope: Path, system: &System, options: &ModelOptions) -> Self {
        Decoder(match options.decoder {
            DecoderKind::CoordinateConsistent => {
                DecoderNetwork::CoordinateConsistent(Box::new(CoordinateConsistent::new(scope, system, options)))
            }
            DecoderKind::Mlp => DecoderNetwork::Mlp(MlpDecoder::new(scope, system)),
        })
    }

    /// Draws the objects at `positions`, `[frames, coordinates * objects]`. A perceptron draws all as background.
    pub fn forward(&self, positions: &Tensor) -> Rendering {
        match &self.0 {
            DecoderNetwork::CoordinateConsistent(decoder) => decoder.forward(positions),
            DecoderNetwork::Mlp(decoder) => decoder.forward(positions),
        }
    }

    /// Only the frames of [`Decoder::forward`], `[frames, channels, S, S]` in \[0, 1\], of each of several lists of positions
    /// (`[frames, coordinates * objects]`).
    pub fn draw<const LISTS: usize>(&self, positions: [&Tensor; LISTS]) -> [Tensor; LISTS] {
        match &self.0 {
            DecoderNetwork::CoordinateConsistent(decoder) => decoder.draw(positions),
            DecoderNetwork::Mlp(decoder) => positions.map(|positions| decoder.forward(positions).frames),
        }
    }

    /// Frames drawn at `positions` (`[frames, coordinates * objects]`), and their derivative by each coordinate, `[frames,
    /// coordinates * objects, channels, S, S]`, by central differences of `probe`, without gradient. None where there are no
    /// sprites that could move.
    pub(crate) fn with_derivative(&self, positions: &Tensor, probe: f64) -> Option<(Tensor, Tensor)> {
        self.with_sprites().map(|decoder| decoder.with_derivative(positions, probe))
    }

    /// The same decoder as a constant: gradients pass through it to the positions, not to what it has learned.
    pub(crate) fn detached(&self) -> Self {
        Decoder(match &self.0 {
            DecoderNetwork::CoordinateConsistent(decoder) => {
                DecoderNetwork::CoordinateConsistent(Box::new(decoder.detached()))
            }
            DecoderNetwork::Mlp(decoder) => DecoderNetwork::Mlp(decoder.detached()),
        })
    }

    fn with_sprites(&self) -> Option<&CoordinateConsistent> {
        match &self.0 {
            DecoderNetwork::CoordinateConsistent(decoder) => Some(decoder),
            DecoderNetwork::Mlp(_) => None,
        }
    }

    /// The learned sprites and background; a perceptron has none.
    pub fn sprites(&self) -> Option<Sprites> {
        self.with_sprites().map(CoordinateConsistent::sprites)
    }

    /// What is drawn where no object is, `[1, channels, S, S]`; a perceptron has none.
    pub fn background(&self) -> Option<Tensor> {
        self.with_sprites().map(CoordinateConsistent::background)
    }

    /// How unlike the objects look: the squared error, summed over a frame, of drawing each in the place of each other before
    /// the background's mean colour. None where there are no sprites to tell.
    pub fn unlike(&self) -> Option<Vec<Vec<f64>>> {
        self.with_sprites().map(CoordinateConsistent::unlike)
    }

    /// For each object the first that looks like it; none where there are no sprites to tell.
    pub(crate) fn twins(&self) -> Option<Vec<usize>> {
        self.with_sprites().map(CoordinateConsistent::twins)
    }

    /// Whether two objects look alike.
    pub(crate) fn has_twins(&self) -> bool {
        self.twins().is_some_and(|first| first.iter().enumerate().any(|(object, &first)| object != first))
    }

    /// Begins the background at these logits, `[channels, S, S]`, its network's kernel scaled by `kernel`.
    pub fn start_background(&self, logits: &Tensor, kernel: f64) {
        match &self.0 {
            DecoderNetwork::CoordinateConsistent(decoder) => decoder.start_background(logits, kernel),
            DecoderNetwork::Mlp(decoder) => decoder.start_background(logits, kernel),
        }
    }

    /// Begins every template as a Gaussian bump from `-height` at the window's edge to `height` at its centre; `width` is
    /// its standard deviation in half windows. Nothing happens where there are no sprites.
    pub fn start_templates(&self, height: f64, width: f64) {
        if let Some(decoder) = self.with_sprites() {
            decoder.start_templates(height, width);
        }
    }

    /// Begins the sprites at masks `visible` (`[objects, S/2, S/2]`) and `colours` (`[objects, channels, S/2, S/2]`), both in
    /// \[0, 1\], on windows that reach `reach` pixels of the frame to each side; the networks' kernels are scaled by `kernel`.
    /// Nothing happens where there are no sprites.
    pub fn start_sprites(&self, visible: &Tensor, colours: &Tensor, reach: f64, kernel: f64) {
        if let Some(decoder) = self.with_sprites() {
            decoder.start_sprites(visible, colours, reach, kernel);
        }
    }

    /// Begins the sprites as those of a decoder of halved frames. Nothing happens where there are no sprites.
    pub fn begin_as(&self, coarse: &Self) {
        if let (Some(decoder), Some(coarse)) = (self.with_sprites(), coarse.with_sprites()) {
            decoder.begin_as(coarse);
        }
    }

    /// Gives the sprites another order: the one that was `order[i]` (`[objects]`) is i from now on. Nothing happens where there
    /// are none.
    pub fn reorder(&self, order: &Tensor) {
        if let Some(decoder) = self.with_sprites() {
            decoder.reorder(order);
        }
    }

    /// Shifts each object's sprite in its window by `offsets` (`[2 * objects]`, pixels of the frame), so that it is drawn
    /// where it was when its position loses as much. Nothing happens where there are no sprites.
    pub(crate) fn shift_sprites(&self, offsets: &Tensor) {
        if let Some(decoder) = self.with_sprites() {
            decoder.shift_sprites(offsets);
        }
    }
}
