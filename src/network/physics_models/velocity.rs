//! Velocity estimator: each object's velocity at the last input frame from its own positions over the input.
//!
//! Original: `vel_encoder`; paper: section 3.1.

use tch::Tensor;
use tch::nn::Path;

use super::ModelOptions;
use crate::network::System;
use crate::network::blocks::{Activation, Dense, Layers};
use crate::network::cells::Coordinates;
use crate::network::dynamics::DynamicsKind;
use crate::network::system::Scaling;

const HIDDEN: usize = 100;

/// The network from input positions to velocities.
#[derive(Debug)]
pub struct VelocityEstimator {
    layers: Vec<Dense>,
    alt_vel: bool,
    /// Of the input positions; none for as they are.
    scaling: Option<Scaling>,
    objects: i64,
    coordinates: i64,
}

impl VelocityEstimator {
    pub fn new(scope: Path, system: &System, options: &ModelOptions) -> Self {
        let mut layers = Layers::new(scope);
        let coordinates = system.cell.coordinates.per_object();
        let layers = match (system.input_steps, options.alt_vel) {
            // A black box needs no velocity.
            _ if options.dynamics != DynamicsKind::Physics => vec![],
            (1, _) => vec![],
            (steps, true) => vec![layers.dense(coordinates * (steps - 1), coordinates, Activation::None)],
            (steps, false) => vec![
                layers.dense(coordinates * steps, HIDDEN, Activation::Tanh),
                layers.dense(HIDDEN, HIDDEN, Activation::Tanh),
                layers.dense(HIDDEN, coordinates, Activation::None),
            ],
        };
        let centred = options.centred_velocity_input && system.cell.coordinates == Coordinates::Position;
        VelocityEstimator {
            layers,
            alt_vel: options.alt_vel,
            scaling: centred.then(|| system.scaling()),
            objects: system.objects as i64,
            coordinates: coordinates as i64,
        }
    }

    /// `[batch, L, coordinates * objects]` to `[batch, coordinates * objects]` per time unit; zero for a single frame, and where a
    /// black box carries the positions on.
    pub fn forward(&self, positions: &Tensor) -> Tensor {
        let (batch, steps) = (positions.size()[0], positions.size()[1]);
        if self.layers.is_empty() {
            return positions.select(1, 0).zeros_like();
        }
        let inputs = if self.alt_vel {
            positions.narrow(1, 1, steps - 1) - positions.narrow(1, 0, steps - 1)
        } else {
            self.scaling.map_or_else(|| positions.shallow_clone(), |scaling| scaling.of(positions))
        };
        // All of object 0, then all of object 1, ..: [objects * batch, coordinates * steps].
        let per_object = inputs.reshape([batch, -1, self.objects, self.coordinates]).permute([2, 0, 1, 3]);
        let mut h = per_object.reshape([self.objects * batch, -1]);
        for layer in &self.layers {
            h = layer.forward(&h);
        }
        h.reshape([self.objects, batch, self.coordinates]).transpose(0, 1).flatten(1, 2)
    }
}
