//! What can be chosen of a model.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::decoder::DecoderKind;
use crate::network::System;
use crate::network::blocks::Precision;
use crate::network::cells::{Coordinates, PhysicalParameter};
use crate::network::dynamics::DynamicsKind;
use paig_kernels::Kernels;

/// Choices that change what the network computes. All off is the original.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelOptions {
    /// What carries the positions from frame to frame: the equation, or a network that is told none.
    #[serde(default)]
    pub dynamics: DynamicsKind,
    /// How frames are drawn.
    #[serde(default)]
    pub decoder: DecoderKind,
    /// Estimate the velocity from the differences of the input positions by one linear layer (original: `--alt_vel`).
    pub alt_vel: bool,
    /// Give the velocity estimator `(p - S/2) / (S/2)` instead of pixels, which saturate its tanh units at the start.
    pub centred_velocity_input: bool,
    /// Move a template by exactly one pixel for one unit of position; the original moves it by (S-1)/S pixels, so its
    /// lengths come out S/(S-1) too large.
    pub exact_shift: bool,
    /// Within a clip an object's name follows its path where the encoder would call it another's; see [`super::naming`].
    #[serde(default)]
    pub names_by_continuity: bool,
    /// Encode frames whose objects look alike twice, where nothing is learned from them; see `super::second_look`.
    #[serde(default)]
    pub second_look: bool,
    /// Give the encoder what a frame adds to the background that the decoder has learned, instead of the frame: what moves
    /// then shows by itself, however small it is beside what stands behind.
    #[serde(default)]
    pub subtract_background: bool,
    /// Improve the encoded positions of the input frames by this many Gauss-Newton steps of the drawing towards the frame;
    /// see [`super::alignment`].
    #[serde(default)]
    pub alignment_steps: usize,
    /// Physical parameters that are fixed at a value instead of being learned, by symbol. Where none is named, those that
    /// the cell fixes by itself: `m = 1` of gravity. Lengths are in true pixels.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub fixed: BTreeMap<String, f64>,
    /// Improve the estimated state before the roll-out by this many Gauss-Newton steps on all input positions under the
    /// current physics; 0 starts from the estimate as it is.
    pub refinement_steps: usize,
    /// What computes what [`crate::kernels`] can: the mathematics is the same, the rounding is not.
    #[serde(default)]
    pub kernels: Kernels,
    /// What the products of the encoder's first dense layer, the largest of all, are computed in.
    #[serde(default)]
    pub dense_precision: Precision,
    /// Whether a GPU may round the factors of all products to ten bits (TF32), which it multiplies several times as fast.
    /// A switch of the whole program: who computes with the model on a GPU sets it by
    /// [`set_tf32`](crate::support::device::set_tf32) first.
    #[serde(default)]
    pub tf32: bool,
}

impl ModelOptions {
    /// The original's computation.
    pub fn original() -> Self {
        ModelOptions {
            dynamics: DynamicsKind::Physics,
            decoder: DecoderKind::CoordinateConsistent,
            alt_vel: false,
            centred_velocity_input: false,
            exact_shift: false,
            names_by_continuity: false,
            second_look: false,
            subtract_background: false,
            alignment_steps: 0,
            fixed: BTreeMap::new(),
            refinement_steps: 0,
            kernels: Kernels::Own,
            dense_precision: Precision::Float32,
            tf32: false,
        }
    }

    /// The value at which a parameter is fixed; none if it is learned.
    pub fn fixed_at(&self, parameter: &PhysicalParameter) -> Option<f64> {
        if self.fixed.is_empty() { parameter.fixed } else { self.fixed.get(&*parameter.name).copied() }
    }

    /// True pixels for one unit of position: (S-1)/S in the original's decoder, 1 with `exact_shift`.
    pub(super) fn pixels_per_unit(&self, system: &System) -> f64 {
        if self.exact_shift { 1.0 } else { (system.side - 1) as f64 / system.side as f64 }
    }

    /// True pixels for one unit of a coordinate that is a length; 1 for angles.
    pub(super) fn length_per_unit(&self, system: &System) -> f64 {
        match system.cell.coordinates {
            Coordinates::Position => self.pixels_per_unit(system),
            Coordinates::Angle => 1.0,
        }
    }
}
