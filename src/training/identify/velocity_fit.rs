//! Fits the velocity estimator to the fitted trajectories, without images.
//!
//! Off by default: with refinement an untrained estimator does no harm. Without it the first roll-outs of `join` lead
//! anywhere; where bodies attract each other they collide, and gradients of such roll-outs cost the encoder its objects
//! within fifty steps. Not in the original.

use anyhow::{Result, ensure};
use tch::{Kind, Tensor};

use crate::network::cells::{Actions, State};
use crate::network::physics_models::losses::latent_error;
use crate::network::physics_models::{PhysicsNet, VariableGroup};
use crate::training::optimizers::{Optimizer, OptimizerKind};

/// The share of the steps after which Adam's rate is divided by `ANNEAL_FACTOR`.
const ANNEAL_AT: f64 = 0.75;
const ANNEAL_FACTOR: f64 = 10.0;

/// Descends the smooth L1 between estimated velocities and those of the trajectories that begin at `first` (positions
/// and velocities, `[clips, 2 * coordinates * objects]`) and run for `frames` frames under the model's physics. Each of
/// the `steps` steps takes all clips, and the next of the trajectories' stretches of L frames. Returns the root mean
/// square of what is left, in a coordinate's unit per time unit.
///
/// # Errors
/// Trajectories that are shorter than the input or not finite.
pub fn fit(model: &PhysicsNet, first: &Tensor, actions: &Actions, frames: usize, steps: u64, rate: f64) -> Result<f64> {
    let input = model.system.input_steps;
    ensure!(frames >= input, "identify: trajectories of {frames} frames; the velocity estimator sees {input}");
    let (positions, velocities) = trajectories(model, first, actions, frames);
    ensure!(
        positions.isfinite().all().int64_value(&[]) == 1,
        "identify: the fitted trajectories are not finite; set identify.velocity_steps=0"
    );
    let stretches = (frames - input + 1) as u64;
    let stretch = |start: i64| {
        let target = velocities.select(1, start + input as i64 - 1);
        (model.velocity.forward(&positions.narrow(1, start, input as i64)), target)
    };
    let variables: Vec<_> =
        model.named_variables().into_iter().filter(|(name, _)| model.group(name) == VariableGroup::Velocity).collect();
    let optimizer = Optimizer::new(OptimizerKind::Adam, None, &variables);
    let mut optimizer = optimizer.with_kernels(model.options.kernels);
    // Of a single input frame no velocity is estimated, and there is nothing to learn.
    let steps = if variables.is_empty() { 0 } else { steps };
    for step in 0..steps {
        let late = step as f64 >= ANNEAL_AT * steps as f64;
        let rate = if late { rate / ANNEAL_FACTOR } else { rate };
        let (estimate, target) = stretch((step % stretches) as i64);
        latent_error(&estimate, &target).backward();
        optimizer.step(&variables, |_| rate);
    }
    let _guard = tch::no_grad_guard();
    let squares: Vec<_> = (0..stretches as i64)
        .map(|start| {
            let (estimate, target) = stretch(start);
            (estimate - target).square().mean(Kind::Double)
        })
        .collect();
    Ok(Tensor::stack(&squares, 0).mean(Kind::Double).sqrt().double_value(&[]))
}

/// Positions and velocities `[clips, frames, coordinates * objects]` in the model's precision.
fn trajectories(model: &PhysicsNet, first: &Tensor, actions: &Actions, frames: usize) -> (Tensor, Tensor) {
    let _guard = tch::no_grad_guard();
    let device = model.variables.device();
    let first = State::from_joined(&first.to_device(device).to_kind(Kind::Float));
    let rolled = model.cell.roll_out(&first, actions, model.system.dt, frames - 1);
    let states = || std::iter::once(&first).chain(&rolled);
    let stack = |parts: Vec<&Tensor>| Tensor::stack(&parts, 1);
    (stack(states().map(|state| &state.pos).collect()), stack(states().map(|state| &state.vel).collect()))
}
