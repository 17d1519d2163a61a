//! Dynamics that are told no equation: what the paper holds the physics against, on the same vision modules.
//!
//! Paper: section 4, the black-box baselines. A network takes in one frame's positions after the other, all L of the
//! input, and gives the change of the positions to the next frame; from the last input frame on it takes in its own
//! predictions. Every network predicts a change, `p' = p + f(..)`, and sees positions as -1..1 and angles as sine and cosine,
//! so that none is helped more than another. The sizes are ours: LSTM, GRU, interaction network and MLP have about 42,000
//! weights each for two objects and L = 4; the linear one is the least that can predict.

mod gru;
mod interaction_network;
mod linear;
mod lstm;
mod mlp;

use std::fmt::Debug;

use serde::{Deserialize, Serialize};
use tch::Tensor;
use tch::nn::Path;

use super::System;
use super::blocks::Layers;
use super::cells::{Actions, Coordinates, State};
use super::system::Scaling;

pub use gru::GruCell;
pub use interaction_network::InteractionNetwork;
pub use lstm::{FORGET_BIAS, LstmCell};

/// Numbers that the position of an object is seen by: x and y, or sine and cosine.
const SEEN: usize = 2;

/// What carries the positions from frame to frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DynamicsKind {
    /// The task's equation, from an estimated velocity.
    #[default]
    Physics,
    Lstm,
    Gru,
    InteractionNetwork,
    Mlp,
    Linear,
}

impl DynamicsKind {
    /// As it stands in a config.
    pub fn name(self) -> &'static str {
        match self {
            DynamicsKind::Physics => "physics",
            DynamicsKind::Lstm => "lstm",
            DynamicsKind::Gru => "gru",
            DynamicsKind::InteractionNetwork => "interaction_network",
            DynamicsKind::Mlp => "mlp",
            DynamicsKind::Linear => "linear",
        }
    }
}

/// A network that predicts the next frame's positions from those it has taken in.
trait Predictor: Debug {
    /// Takes in one more frame, `[batch, features]`; the memory is empty before the first.
    fn see(&self, memory: &mut Vec<Tensor>, frame: &Tensor);

    /// The change of the positions to the frame after the last, `[batch, coordinates * objects]`.
    fn change(&self, memory: &[Tensor]) -> Tensor;
}

/// The numbers of one frame as a network takes them in: the positions of all objects, then what acts, if anything does.
#[derive(Debug, Clone, Copy)]
struct Features {
    objects: usize,
    /// Of one object.
    coordinates: usize,
    /// 1 where something acts from outside.
    actions: usize,
    /// L.
    frames: usize,
}

impl Features {
    fn positions(&self) -> usize {
        self.objects * self.coordinates
    }

    /// Numbers that the positions of all objects are seen by.
    fn in_positions(&self) -> usize {
        self.objects * SEEN
    }

    fn in_frame(&self) -> usize {
        self.in_positions() + self.actions
    }
}

/// A roll-out without an equation.
#[derive(Debug)]
pub struct BlackBox {
    network: Box<dyn Predictor>,
    features: Features,
    coordinates: Coordinates,
    /// Of the positions; a change is foretold in units of one over the scale.
    scaling: Scaling,
    dt: f64,
}

impl BlackBox {
    /// None for the physics, which is no black box.
    pub fn new(scope: Path, kind: DynamicsKind, system: &System) -> Option<Self> {
        let coordinates = system.cell.coordinates;
        let features = Features {
            objects: system.objects,
            coordinates: coordinates.per_object(),
            actions: usize::from(system.cell.actions),
            frames: system.input_steps,
        };
        let mut layers = Layers::new(scope);
        let network: Box<dyn Predictor> = match kind {
            DynamicsKind::Physics => return None,
            DynamicsKind::Lstm => Box::new(lstm::Lstm::new(&mut layers, &features)),
            DynamicsKind::Gru => Box::new(gru::Gru::new(&mut layers, &features)),
            DynamicsKind::InteractionNetwork => Box::new(InteractionNetwork::new(&mut layers, &features)),
            DynamicsKind::Mlp => Box::new(mlp::StackedMlp::new(&mut layers, &features)),
            DynamicsKind::Linear => Box::new(linear::Linear::new(&mut layers, &features)),
        };
        Some(BlackBox { network, features, coordinates, scaling: system.scaling(), dt: system.dt })
    }

    /// The states at the last of the input positions `[batch, L, coordinates * objects]` and at the next `frames` frames.
    /// `actions` begin at the first input frame. A velocity is the change of the position since the frame before, per time
    /// unit.
    pub fn roll_out(&self, input: &Tensor, actions: &Actions, frames: usize) -> (State, Vec<State>) {
        let last = input.size()[1] - 1;
        let mut memory = self.remember(&input.narrow(1, 0, last), actions);
        let before = input.select(1, (last - 1).max(0));
        let pos = input.select(1, last);
        let initial = State { vel: (&pos - before) / self.dt, pos };
        let mut states: Vec<State> = Vec::with_capacity(frames);
        for frame in 0..frames {
            let from = &states.last().unwrap_or(&initial).pos;
            states.push(self.step(&mut memory, from, actions.at(last as usize + frame)));
        }
        (initial, states)
    }

    /// What a network keeps of positions `[batch, frames, coordinates * objects]` and the actions from them on; each tensor's
    /// first axis is the batch. It may be empty.
    pub fn remember(&self, positions: &Tensor, actions: &Actions) -> Vec<Tensor> {
        let mut memory = Vec::new();
        for frame in 0..positions.size()[1] {
            self.see(&mut memory, &positions.select(1, frame), actions.at(frame as usize));
        }
        memory
    }

    /// Takes in the positions of one more frame (`[batch, coordinates * objects]`) and what acts from it on (`[batch, 1]`),
    /// and foretells the next.
    pub fn step(&self, memory: &mut Vec<Tensor>, positions: &Tensor, action: Option<Tensor>) -> State {
        self.see(memory, positions, action);
        let change = self.network.change(memory) / self.scaling.scale;
        State { pos: positions + &change, vel: change / self.dt }
    }

    /// Takes in positions `[batch, coordinates * objects]` and what acts from their frame on (`[batch, 1]`; nothing: zero).
    fn see(&self, memory: &mut Vec<Tensor>, positions: &Tensor, action: Option<Tensor>) {
        let mut frame = match self.coordinates {
            Coordinates::Position => self.scaling.of(positions),
            // An angle and the same after a full turn are one place.
            Coordinates::Angle => Tensor::stack(&[positions.sin(), positions.cos()], 2).flatten(1, 2),
        };
        if self.features.actions > 0 {
            let action = action.unwrap_or_else(|| positions.narrow(1, 0, 1).zeros_like());
            frame = Tensor::cat(&[frame, action], 1);
        }
        self.network.see(memory, &frame);
    }
}

/// Appends a frame to the last ones and forgets those before the last `count`.
fn keep_last(memory: &mut Vec<Tensor>, frame: &Tensor, count: usize) {
    memory.push(frame.shallow_clone());
    let forgotten = memory.len().saturating_sub(count);
    memory.drain(..forgotten);
}
