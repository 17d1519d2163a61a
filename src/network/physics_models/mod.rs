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
pub mod refinement;
pub mod second_look;
mod velocity;

use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};
use tch::nn::{Init, VarStore};
use tch::{Device, Kind, Tensor};

use crate::kernels::{Kernels, allow_tf32};
use crate::network::System;
use crate::network::blocks::Precision;
use crate::network::cells::{Actions, Cell, Coordinates, PhysicalParameter, State};
use crate::network::dynamics::{BlackBox, DynamicsKind};
use crate::network::initial_values;

pub use decoder::{Decoder, DecoderKind, Rendering, Sprites};
pub use encoder::{Encoder, Encoding};
pub use velocity::VelocityEstimator;

/// The constant logit of the background in the softmax over masks, of the encoder and of the decoder.
pub(crate) const BACKGROUND_LOGIT: f64 = 1.0;

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
    /// Within a clip an object's name follows its path where the encoder would call it another's; see [`naming`].
    #[serde(default)]
    pub names_by_continuity: bool,
    /// Encode frames whose objects look alike twice, where nothing is learned from them; see [`second_look`].
    #[serde(default)]
    pub second_look: bool,
    /// Give the encoder what a frame adds to the background that the decoder has learned, instead of the frame: what moves
    /// then shows by itself, however small it is beside what stands behind.
    #[serde(default)]
    pub subtract_background: bool,
    /// Improve the encoded positions of the input frames by this many Gauss-Newton steps of the drawing towards the frame;
    /// see [`alignment`].
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
        if self.fixed.is_empty() { parameter.fixed } else { self.fixed.get(parameter.name).copied() }
    }

    /// True pixels for one unit of position: (S-1)/S in the original's decoder, 1 with `exact_shift`.
    fn pixels_per_unit(&self, system: &System) -> f64 {
        if self.exact_shift { 1.0 } else { (system.side - 1) as f64 / system.side as f64 }
    }

    /// True pixels for one unit of a coordinate that is a length; 1 for angles.
    fn length_per_unit(&self, system: &System) -> f64 {
        match system.cell.coordinates {
            Coordinates::Position => self.pixels_per_unit(system),
            Coordinates::Angle => 1.0,
        }
    }
}

/// A parameter of a model's equation.
#[derive(Debug)]
pub struct Parameter {
    pub kind: &'static PhysicalParameter,
    /// The number without bounds that stands for the value, a scalar: the logarithm of a positive one. Lengths are in the
    /// model's unit of position.
    pub raw: Tensor,
    /// Otherwise it is fixed.
    pub learned: bool,
}

/// The raw number of a value in the model's unit.
fn raw_within(kind: &PhysicalParameter, value: f64) -> Result<f64> {
    let PhysicalParameter { name, bounds, .. } = kind;
    ensure!(bounds.contain(value), "parameter {name} = {value} in the model's unit: must be {bounds}");
    Ok(bounds.raw(value))
}

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
pub enum Gradients {
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

/// What the vision part makes of clips.
#[derive(Debug)]
pub struct Seen {
    pub encoding: Encoding,
    /// As the encoder says, in its own order of the objects, `[batch, time, coordinates * objects]`.
    pub encoded: Tensor,
    /// From which the state is estimated: aligned on the input frames, in the order of the names; the same shape.
    pub positions: Tensor,
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
        let parameter = |kind: &'static PhysicalParameter| {
            let raw = |value: f64| raw_within(kind, value / length.powi(kind.length_power));
            let fixed = |raw: f64| Parameter { kind, raw: Tensor::from(raw as f32).to_device(device), learned: false };
            if let Some(value) = options.fixed_at(kind) {
                return Ok(fixed(raw(value)?));
            }
            let start = kind.start.map_or(Ok(0.0), raw)?;
            if black_box.is_some() {
                return Ok(fixed(start));
            }
            Ok(Parameter { kind, raw: scope.var(kind.variable, &[], Init::Const(start)), learned: true })
        };
        let parameters = system.cell.parameters.iter().map(parameter).collect::<Result<Vec<_>>>()?;
        grouped(VariableGroup::Physics);
        let raw: Vec<_> = parameters.iter().map(|parameter| parameter.raw.shallow_clone()).collect();
        let cell = system.build_cell(&raw);
        initial_values::glorot_uniform(&variables, seed);
        if device != Device::Cpu {
            // A switch of the whole program: a model computes as the last one that was made.
            allow_tf32(options.tf32);
        }
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

    /// The parameters that are learned.
    pub fn learned(&self) -> impl Iterator<Item = &Parameter> {
        self.parameters.iter().filter(|parameter| parameter.learned)
    }

    /// Sets the raw number of a parameter that is learned: of a positive one the logarithm.
    pub fn set_raw(&self, parameter: &Parameter, raw: f64) {
        let _guard = tch::no_grad_guard();
        let _ = parameter.raw.shallow_clone().fill_(raw);
    }

    /// Sets a parameter that is learned, lengths in true pixels.
    ///
    /// # Errors
    /// A value that is not within the parameter's bounds.
    pub fn set_value(&self, parameter: &Parameter, value: f64) -> Result<()> {
        self.set_raw(parameter, raw_within(parameter.kind, value / self.true_unit(parameter.kind))?);
        Ok(())
    }

    /// The value that a raw number of a parameter stands for, lengths in true pixels.
    pub fn true_value(&self, kind: &PhysicalParameter, raw: f64) -> f64 {
        kind.bounds.value(raw) * self.true_unit(kind)
    }

    /// The learned parameters as `(symbol, value)`, lengths in true pixels whatever the decoder's scale.
    pub fn parameter_values(&self) -> Vec<(&'static str, f64)> {
        self.learned().map(|p| (p.kind.name, self.true_value(p.kind, p.raw.double_value(&[])))).collect()
    }

    /// What one model unit of a parameter is in true pixels.
    pub fn true_unit(&self, kind: &PhysicalParameter) -> f64 {
        self.options.length_per_unit(&self.system).powi(kind.length_power)
    }

    /// True pixels for one unit of position.
    pub fn pixels_per_unit(&self) -> f64 {
        self.options.pixels_per_unit(&self.system)
    }

    /// True pixels for one unit of a coordinate that is a length; 1 for angles.
    pub fn length_per_unit(&self) -> f64 {
        self.options.length_per_unit(&self.system)
    }

    /// Positions of frames `[batch, time, channels, S, S]` in the equation's coordinates, `[batch, time, coordinates *
    /// objects]`, with the encoder's masks.
    pub fn encode(&self, frames: &Tensor) -> (Encoding, Tensor) {
        let (batch, time) = (frames.size()[0], frames.size()[1]);
        let encoding = self.look(&frames.flatten(0, 1));
        let positions = self.clip_coordinates(&encoding.positions.reshape([batch, time, -1]));
        (encoding, positions)
    }

    /// What the encoder makes of single frames `[frames, channels, S, S]`; where no gradients are wanted and the options say so,
    /// after a second look.
    pub fn look(&self, frames: &Tensor) -> Encoding {
        let given = self.given(frames);
        let encoding = self.encoder.forward(&given);
        if encoding.positions.requires_grad() || !self.looks_twice() {
            return encoding;
        }
        second_look::better_drawn(&self.encoder, &self.decoder, [frames, &given], encoding)
    }

    /// Numbers the objects anew: the one that was `order[i]` is i from now on. Masks and sprites go together.
    pub fn reorder(&self, order: &[i64]) {
        let order = Tensor::from_slice(order).to_device(self.variables.device());
        self.encoder.reorder(&order);
        self.decoder.reorder(&order);
    }

    /// What the encoder makes of single frames `[frames, channels, S, S]` at first.
    pub fn first_look(&self, frames: &Tensor) -> Encoding {
        self.encoder.forward(&self.given(frames))
    }

    /// The same, and the positions once more without a way back to the masks.
    pub fn first_look_twice(&self, frames: &Tensor) -> (Encoding, Tensor) {
        self.encoder.forward_twice(&self.given(frames))
    }

    /// What the encoder is given of frames, all `[frames, channels, S, S]`: see [`ModelOptions::subtract_background`].
    pub fn given(&self, frames: &Tensor) -> Tensor {
        match self.options.subtract_background.then(|| self.decoder.background()).flatten() {
            Some(background) => frames - background.detach(),
            None => frames.shallow_clone(),
        }
    }

    fn looks_twice(&self) -> bool {
        let plane = self.system.cell.coordinates == Coordinates::Position;
        self.options.second_look && plane && self.decoder.has_twins()
    }

    /// Which of these frames are encoded as the encoder saw them first, by their places.
    pub fn at_first_look(&self, frames: &Tensor) -> Tensor {
        let all = Tensor::arange(frames.size()[0], (Kind::Int64, frames.device()));
        if !self.looks_twice() {
            return all;
        }
        let _guard = tch::no_grad_guard();
        let given = self.given(frames);
        let first = self.encoder.forward(&given);
        let positions = first.positions.shallow_clone();
        let chosen = second_look::better_drawn(&self.encoder, &self.decoder, [frames, &given], first);
        let changed = (chosen.positions - positions).abs();
        all.masked_select(&changed.amax([1], false).eq(0.0))
    }

    /// Positions in the frames of clips, `[batch, time, 2 * objects]` (pixels), in the equation's coordinates, `[batch, time,
    /// coordinates * objects]`.
    pub fn clip_coordinates(&self, positions: &Tensor) -> Tensor {
        let (kind, size) = (self.system.cell.coordinates, positions.size());
        let single = coordinates::of(kind, &positions.flatten(0, 1), self.system.side);
        coordinates::continuous(kind, single.reshape([size[0], size[1], -1]))
    }

    /// The position of each pixel of a row or column, `[S]`: pixel i is drawn at i + 1/2 by an exact decoder, and at
    /// i S/(S-1) by the original's.
    pub fn pixel_centres(&self) -> Tensor {
        let index = Tensor::arange(self.system.given_side() as i64, (Kind::Float, self.variables.device()));
        let centres = if self.options.exact_shift { index + 0.5 } else { index / self.pixels_per_unit() };
        centres * self.system.given_pixel()
    }

    /// What is seen in clips `[batch, time, channels, S, S]`: as [`PhysicsNet::encode`], and the positions of the first `input`
    /// frames improved on the picture, all in the order of their names.
    pub fn see(&self, clips: &Tensor, input: usize) -> Seen {
        let seen = self.see_unnamed(clips, self.look(&clips.flatten(0, 1)), input);
        Seen { positions: self.named(&seen.positions, input), ..seen }
    }

    /// The same in the encoder's order, by what the encoder made of the frames.
    fn see_unnamed(&self, clips: &Tensor, encoding: Encoding, input: usize) -> Seen {
        let (batch, time, count) = (clips.size()[0], clips.size()[1], input as i64);
        let encoded = self.clip_coordinates(&encoding.positions.reshape([batch, time, -1]));
        let places = encoding.positions.reshape([batch, time, -1]);
        let of_input = |x: &Tensor| x.narrow(1, 0, count).flatten(0, 1);
        let aligned = self.aligned_places(&of_input(clips), &of_input(&places)).reshape([batch, count, -1]);
        let places = Tensor::cat(&[aligned, places.narrow(1, count, time - count)], 1);
        let positions = self.clip_coordinates(&places);
        Seen { encoding, encoded, positions }
    }

    /// Which of the encoder's objects bears each name in clips `[batch, L + T_pred, channels, S, S]`, `[batch, L + T_pred,
    /// objects]`, as a step of training has it; none where names do not change.
    pub fn order(&self, clips: &Tensor) -> Option<Tensor> {
        let _guard = tch::no_grad_guard();
        let (unlike, input) = (self.unlike()?, self.system.input_steps);
        let seen = self.see_unnamed(clips, self.first_look(&clips.flatten(0, 1)), input);
        Some(naming::follow(&seen.positions, &unlike, input).order)
    }

    /// Encoded places `[frames, 2 * objects]` (pixels) in single frames `[frames, channels, S, S]`, improved on the picture if
    /// the options say so. What is drawn turned by an angle is turned about the middle of the frame.
    pub fn aligned_places(&self, frames: &Tensor, encoded: &Tensor) -> Tensor {
        let (kind, steps) = (self.system.cell.coordinates, self.options.alignment_steps);
        let positions = coordinates::of(kind, encoded, self.system.side);
        let aligned = alignment::align(&self.decoder, kind, frames, &positions, steps);
        match kind {
            Coordinates::Position => aligned,
            Coordinates::Angle => coordinates::turned(encoded, &(aligned - positions), self.system.side),
        }
    }

    /// Encoded positions `[batch, time, coordinates * objects]` in the order of their names: within a clip a name stays with
    /// its object. The names in the first `input` frames do not depend on what comes after.
    pub fn named(&self, positions: &Tensor, input: usize) -> Tensor {
        match self.unlike() {
            Some(unlike) => naming::renamed(positions, &naming::follow(positions, &unlike, input).order),
            None => positions.shallow_clone(),
        }
    }

    /// How unlike the objects look, where names follow them.
    fn unlike(&self) -> Option<Vec<Vec<f64>>> {
        let one = self.system.objects == 1 || self.system.cell.coordinates == Coordinates::Angle;
        if one || !self.options.names_by_continuity { None } else { self.decoder.unlike() }
    }

    /// Positions of single frames in the equation's coordinates, `[frames, coordinates * objects]`.
    pub fn coordinates(&self, encoding: &Encoding) -> Tensor {
        coordinates::of(self.system.cell.coordinates, &encoding.positions, self.system.side)
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

    /// Decodes lists of positions `[batch, time, coordinates * objects]`, each to `[batch, time, channels, S, S]`.
    fn decode<const LISTS: usize>(&self, decoder: &Decoder, positions: [&Tensor; LISTS]) -> [Tensor; LISTS] {
        let batch = positions[0].size()[0];
        let [channels, side] = [self.system.channels as i64, self.system.given_side() as i64];
        let flat = positions.map(|positions| positions.flatten(0, 1));
        let drawn = decoder.draw(flat.each_ref());
        drawn.map(|frames| frames.reshape([batch, -1, channels, side, side]))
    }

    /// Decodes encoded and predicted positions; the latter teach the decoder only where gradients are joint.
    fn decode_both(&self, encoded: &Tensor, predicted: &Tensor, gradients: Gradients) -> [Tensor; 2] {
        if gradients == Gradients::Joint {
            return self.decode(&self.decoder, [encoded, predicted]);
        }
        let [reconstructions] = self.decode(&self.decoder, [encoded]);
        let [predictions] = self.decode(&self.decoder.detached(), [predicted]);
        [reconstructions, predictions]
    }

    /// The whole model on clips `[batch, time, channels, S, S]` and what acts during them: the first L + T_pred frames are
    /// encoded, and all frames after the first L are predicted.
    ///
    /// # Errors
    /// A clip that is shorter than L + T_pred.
    pub fn forward(&self, clips: &Tensor, actions: &Actions) -> Result<ForwardPass> {
        self.forward_with(clips, actions, None, Gradients::Joint)
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
        gradients: Gradients,
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
        let from = if gradients == Gradients::Separate { from.detach() } else { from };
        let (initial, states) = self.roll_out(&from, actions, time - input);
        let predicted: Vec<_> = states.iter().map(|state| state.pos.shallow_clone()).collect();
        let predicted = Tensor::stack(&predicted, 1);
        let [reconstructions, predictions] = self.decode_both(&seen.encoded, &predicted, gradients);
        let (Seen { encoding, .. }, kernels) = (seen, self.options.kernels);
        Ok(ForwardPass { encoding, positions, initial, states, reconstructions, predictions, kernels })
    }
}
