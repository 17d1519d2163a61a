//! The model: encoder, velocity estimator, physics, decoder, in the order in which the data flow. For comparison a network
//! that is told no equation ([`dynamics`](crate::network::dynamics)) can stand in the place of velocity estimator and physics.
//!
//! Original: `nn/network/physics_models.py`, class `PhysicsNet`; paper: section 3. Frames are
//! `[batch, time, channels, S, S]` in \[0, 1\]; positions are `[batch, time, coordinates * objects]`, in pixels or radians
//! as the equation has them (see [`crate::network::cells::Coordinates`]).

pub mod alignment;
mod coordinates;
mod decoder;
mod encoder;
pub mod losses;
pub mod naming;
mod options;
mod parameters;
pub mod refinement;
pub(crate) mod second_look;
mod velocity;
mod vision;

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};
use tch::nn::{Init, VarStore};
use tch::{Device, Kind, Tensor};

use self::parameters::unconstrained_within;
use crate::network::System;
use crate::network::cells::{Actions, Cell, OnGpu, PhysicalParameter, State};
use crate::network::dynamics::BlackBox;
use crate::network::initial_values;
use paig_kernels::Kernels;

pub use decoder::{Decoder, DecoderKind, Rendering, Sprites};
pub use encoder::{Encoder, Encoding};
pub use options::ModelOptions;
pub use parameters::Parameter;
pub use velocity::VelocityEstimator;
pub use vision::EncodedClips;

/// The constant logit of the background in the softmax over masks, of the encoder and of the decoder.
pub(crate) const BACKGROUND_LOGIT: f64 = 1.0;

/// Which part of the model a variable belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VariableGroup {
    Encoder,
    Velocity,
    Physics,
    /// A black box, in the place of velocity estimator and physics.
    Dynamics,
    Decoder,
}

/// Which loss teaches which part.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GradientPaths {
    /// Both losses teach all parts.
    #[default]
    Joint,
    /// Encoder and decoder learn from the encoded frames alone; velocity estimator and physics (or what is in their place)
    /// from the predicted ones alone.
    Separate,
}

/// Encoder, velocity estimator, physics cell and decoder of one system, with their variables.
#[derive(Debug)]
pub struct PhysicsNet {
    pub system: System,
    pub options: ModelOptions,
    pub variables: VarStore,
    /// By variable's name.
    groups: BTreeMap<String, VariableGroup>,
    pub encoder: Encoder,
    pub velocity: VelocityEstimator,
    pub cell: Box<dyn Cell>,
    /// In the cell's order. Where a black box is in the place of the physics none is learned, and the cell is not used.
    pub parameters: Vec<Parameter>,
    /// None where the positions follow the equation.
    pub black_box: Option<BlackBox>,
    pub decoder: Decoder,
}

/// Everything one pass over clips computes.
#[derive(Debug)]
pub struct ForwardPass {
    /// Masks, masked frames and positions of the first L + T_pred frames.
    pub encoding: Encoding,
    /// Encoded positions in the equation's coordinates, `[batch, L + T_pred, coordinates * objects]`.
    pub positions: Tensor,
    /// State at the last input frame.
    pub initial: State,
    /// Rolled-out states, one for each frame after the input.
    pub states: Vec<State>,
    /// Decoded encoder positions, `[batch, L + T_pred, channels, S, S]`.
    pub reconstructions: Tensor,
    /// Decoded roll-out, `[batch, T - L, channels, S, S]`.
    pub predictions: Tensor,
    /// What computes losses of it.
    pub kernels: Kernels,
}

impl ForwardPass {
    /// The states from the last input frame on, `[batch, 1 + T - L, 2 * coordinates * objects]`.
    pub fn sequence(&self) -> Tensor {
        State::sequence(std::iter::once(&self.initial).chain(&self.states))
    }
}

impl PhysicsNet {
    /// A fresh model with initial values drawn from `seed`.
    ///
    /// # Errors
    /// A system that the network cannot be built for, see [`System::check`]; a parameter that starts or is fixed outside of
    /// its bounds.
    pub fn new(system: &System, options: &ModelOptions, device: Device, seed: u64) -> Result<Self> {
        system.check()?;
        let variables = VarStore::new(device);
        let mut groups = BTreeMap::new();
        // Whatever was added since the last call.
        let mut grouped = |group: VariableGroup| {
            for name in variables.variables().into_keys() {
                groups.entry(name).or_insert(group);
            }
        };
        let root = variables.root();
        let encoder = Encoder::new(&root / "encoder", system, options);
        grouped(VariableGroup::Encoder);
        let decoder = Decoder::new(&root / "decoder", system, options);
        grouped(VariableGroup::Decoder);
        let velocity = VelocityEstimator::new(&root / "init_vel", system, options);
        grouped(VariableGroup::Velocity);
        let black_box = BlackBox::new(&root / "dynamics", options.dynamics, system);
        grouped(VariableGroup::Dynamics);
        let scope = &root / system.cell.scope;
        let length = options.length_per_unit(system);
        let parameter = |kind: &PhysicalParameter| {
            let unconstrained = |value: f64| unconstrained_within(kind, value / length.powi(kind.length_power));
            let fixed = |usual_start: f64| {
                let unconstrained = Tensor::from(usual_start as f32).to_device(device);
                Parameter { kind: kind.clone(), unconstrained, usual_start, learned: false }
            };
            if let Some(value) = options.fixed_at(kind) {
                return Ok(fixed(unconstrained(value)?));
            }
            let usual_start = kind.start.map_or(Ok(0.0), unconstrained)?;
            if black_box.is_some() {
                return Ok(fixed(usual_start));
            }
            let unconstrained = scope.var(&kind.variable, &[], Init::Const(usual_start));
            Ok(Parameter { kind: kind.clone(), unconstrained, usual_start, learned: true })
        };
        let parameters = system.cell.parameters.iter().map(parameter).collect::<Result<Vec<_>>>()?;
        grouped(VariableGroup::Physics);
        let unconstrained: Vec<_> =
            parameters.iter().map(|parameter| parameter.unconstrained.shallow_clone()).collect();
        let mut cell = system.build_cell(&unconstrained);
        if device != Device::Cpu && options.kernels == Kernels::Own {
            cell = Box::new(OnGpu::new(&system.cell, system.walls, unconstrained, cell));
        }
        initial_values::glorot_uniform(&variables, seed);
        Ok(PhysicsNet {
            system: system.clone(),
            options: options.clone(),
            variables,
            groups,
            encoder,
            velocity,
            cell,
            parameters,
            black_box,
            decoder,
        })
    }

    /// The whole model on clips `[batch, time, channels, S, S]` and what acts during them: the first L + T_pred frames are
    /// encoded, and all frames after the first L are predicted.
    ///
    /// # Errors
    /// A clip that is shorter than L + T_pred.
    pub fn forward(&self, clips: &Tensor, actions: &Actions) -> Result<ForwardPass> {
        self.forward_with(clips, actions, None, GradientPaths::Joint)
    }

    /// The same, with names in an [`order`](Self::order) that is known already, and with gradients that go as said.
    ///
    /// # Errors
    /// As for [`Self::forward`].
    pub fn forward_with(
        &self,
        clips: &Tensor,
        actions: &Actions,
        order: Option<&Tensor>,
        gradients: GradientPaths,
    ) -> Result<ForwardPass> {
        let (input, encoded) = (self.system.input_steps, self.system.input_steps + self.system.pred_steps);
        let time = clips.size()[1] as usize;
        ensure!(time >= encoded, "a clip has {time} frames; at least input and prediction, {encoded}, are needed");
        let seen_clips = clips.narrow(1, 0, encoded as i64);
        let seen = self.see_unnamed(&seen_clips, self.look(&seen_clips.flatten(0, 1)), input);
        let positions = match order {
            Some(order) => naming::renamed(&seen.positions, order),
            None => self.named(&seen.positions, input),
        };
        let from = positions.narrow(1, 0, input as i64);
        let from = if gradients == GradientPaths::Separate { from.detach() } else { from };
        let (initial, states) = self.roll_out(&from, actions, time - input);
        let predicted = State::positions(&states);
        let [reconstructions, predictions] = self.decode_both(&seen.encoded, &predicted, gradients);
        let (EncodedClips { encoding, .. }, kernels) = (seen, self.options.kernels);
        Ok(ForwardPass { encoding, positions, initial, states, reconstructions, predictions, kernels })
    }

    /// The state at the last of the input positions `[batch, L, coordinates * objects]`: encoded position, estimated
    /// velocity, both refined under the physics if the options say so. `actions` begin at the first frame.
    pub fn initial_state(&self, input_positions: &Tensor, actions: &Actions) -> State {
        let last = input_positions.select(1, input_positions.size()[1] - 1);
        let estimate = State { pos: last, vel: self.velocity.forward(input_positions) };
        let steps = self.options.refinement_steps;
        refinement::refine(self.cell.as_ref(), self.system.dt, input_positions, actions, estimate, steps)
    }

    /// The states at the last of the input positions `[batch, L, coordinates * objects]` and at the next `frames` frames, by
    /// the equation or by what is in its place. `actions` begin at the first frame.
    pub fn roll_out(&self, input_positions: &Tensor, actions: &Actions, frames: usize) -> (State, Vec<State>) {
        if let Some(black_box) = &self.black_box {
            return black_box.roll_out(input_positions, actions, frames);
        }
        let initial = self.initial_state(input_positions, actions);
        let since = actions.since(input_positions.size()[1] as usize - 1);
        let states = self.cell.roll_out(&initial, &since, self.system.dt, frames);
        (initial, states)
    }

    /// Decodes encoded and predicted positions; the latter teach the decoder only where gradients are joint.
    fn decode_both(&self, encoded: &Tensor, predicted: &Tensor, gradients: GradientPaths) -> [Tensor; 2] {
        if gradients == GradientPaths::Joint {
            return self.decode(&self.decoder, [encoded, predicted]);
        }
        let [reconstructions] = self.decode(&self.decoder, [encoded]);
        let [predictions] = self.decode(&self.decoder.detached(), [predicted]);
        [reconstructions, predictions]
    }

    /// Decodes lists of positions `[batch, time, coordinates * objects]`, each to `[batch, time, channels, S, S]`.
    fn decode<const LISTS: usize>(&self, decoder: &Decoder, positions: [&Tensor; LISTS]) -> [Tensor; LISTS] {
        let batch = positions[0].size()[0];
        let [channels, side] = [self.system.channels as i64, self.system.given_side() as i64];
        let flat = positions.map(|positions| positions.flatten(0, 1));
        let drawn = decoder.draw(flat.each_ref());
        drawn.map(|frames| frames.reshape([batch, -1, channels, side, side]))
    }

    /// Which part of the model a variable belongs to.
    ///
    /// # Panics
    /// A name that no variable of the model has.
    pub fn group(&self, name: &str) -> VariableGroup {
        self.groups[name]
    }

    /// All variables with their names, sorted by name.
    pub fn named_variables(&self) -> Vec<(String, Tensor)> {
        let mut named: Vec<_> = self.variables.variables().into_iter().collect();
        named.sort_by(|a, b| a.0.cmp(&b.0));
        named
    }

    /// Begins encoder, sprites and parameters as those of a model of the halved system ([`System::halved`]).
    pub fn begin_as(&self, coarse: &PhysicsNet) {
        let _guard = tch::no_grad_guard();
        let learned = coarse.variables.variables();
        for (name, variable) in self.variables.variables() {
            if matches!(self.group(&name), VariableGroup::Encoder | VariableGroup::Physics) {
                variable.shallow_clone().copy_(&learned[&name]);
            }
        }
        self.decoder.begin_as(&coarse.decoder);
    }

    /// Numbers the objects anew: the one that was `order[i]` is i from now on. Masks and sprites go together.
    pub fn reorder(&self, order: &[i64]) {
        let order = Tensor::from_slice(order).to_device(self.variables.device());
        self.encoder.reorder(&order);
        self.decoder.reorder(&order);
    }

    /// True pixels for one unit of position.
    pub fn pixels_per_unit(&self) -> f64 {
        self.options.pixels_per_unit(&self.system)
    }

    /// True pixels for one unit of a coordinate that is a length; 1 for angles.
    pub fn length_per_unit(&self) -> f64 {
        self.options.length_per_unit(&self.system)
    }

    /// The position of each pixel of a row or column, `[S]`: pixel i is drawn at i + 1/2 by an exact decoder, and at
    /// i S/(S-1) by the original's. A pixel of a halved frame is where the middle of its two is.
    pub fn pixel_centres(&self) -> Tensor {
        let index = Tensor::arange(self.system.given_side() as i64, (Kind::Float, self.variables.device()));
        let centres = (index + 0.5) * self.system.given_pixel();
        if self.options.exact_shift { centres } else { (centres - 0.5) / self.pixels_per_unit() }
    }
}
