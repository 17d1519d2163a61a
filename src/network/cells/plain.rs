//! Cells in plain numbers: many states side by side, without tensors, gradients or allocations in a step. For planning (single
//! precision) and for fits (double), where a tensor of a few numbers costs many times the arithmetic.

use std::fmt::Debug;

use tch::Tensor;

use super::{Actions, SUBSTEPS};

/// An equation with its parameters that moves a batch of states on.
///
/// Numbers stand coordinate by coordinate, within it state by state: `[coordinates, batch]`. So several states fit into a
/// register.
pub trait PlainCell<F = f32>: Debug {
    /// All states a time `dt` later, one frame; `action` (`[batch]`) acts meanwhile.
    fn step(&mut self, positions: &mut [F], velocities: &mut [F], action: &[F], dt: F);
}

/// What accelerates the objects of an equation.
pub(super) trait Law: Debug {
    /// Writes the accelerations in these states, all `[coordinates, batch]`; `action` (`[batch]`) acts.
    fn accelerate(&self, positions: &[f64], velocities: &[f64], action: &[f64], into: &mut [f64]);
}

/// A law, integrated as [`super::Cell::step`] does it.
#[derive(Debug)]
pub(super) struct Euler<L> {
    law: L,
    accelerations: Vec<f64>,
}

impl<L: Law> Euler<L> {
    pub(super) fn new(law: L) -> Self {
        Euler { law, accelerations: Vec::new() }
    }
}

impl<L: Law> PlainCell<f64> for Euler<L> {
    fn step(&mut self, positions: &mut [f64], velocities: &mut [f64], action: &[f64], dt: f64) {
        let h = dt / SUBSTEPS as f64;
        self.accelerations.resize(positions.len(), 0.0);
        for _ in 0..SUBSTEPS {
            self.law.accelerate(positions, velocities, action, &mut self.accelerations);
            let moved = positions.iter_mut().zip(&mut *velocities).zip(&self.accelerations);
            for ((position, velocity), acceleration) in moved {
                *velocity += acceleration * h;
                *position += *velocity * h;
            }
        }
    }
}

/// The coordinates of `N` numbers of a batch, each `[batch]`.
pub(super) fn columns<const N: usize>(numbers: &[f64]) -> [&[f64]; N] {
    let batch = numbers.len() / N;
    std::array::from_fn(|number| &numbers[number * batch..][..batch])
}

/// The same, to be written.
pub(super) fn columns_mut<const N: usize>(numbers: &mut [f64]) -> [&mut [f64]; N] {
    let mut columns = numbers.chunks_exact_mut(numbers.len() / N);
    std::array::from_fn(|_| columns.next().expect("as many columns as numbers"))
}

/// Positions of `frames` frames from `states` on (`[batch, 2 * coordinates]`, float64, at the first of them), `[batch, frames *
/// coordinates]`. Of an equation that `tells_time` the actions are the time, and it goes on where they end.
pub fn roll_out(
    cell: &mut dyn PlainCell<f64>,
    states: &Tensor,
    actions: &Actions,
    tells_time: bool,
    dt: f64,
    frames: usize,
) -> Tensor {
    let (batch, numbers) = states.size2().expect("states [batch, positions and velocities]");
    let (batch, coordinates) = (batch as usize, numbers as usize / 2);
    let mut state: Vec<f64> =
        states.transpose(0, 1).contiguous().view(-1).try_into().expect("numbers of double precision");
    let (positions, velocities) = state.split_at_mut(coordinates * batch);
    let mut seen = Vec::with_capacity(frames * coordinates * batch);
    seen.extend_from_slice(positions);
    let mut held = vec![0.0; batch];
    for frame in 0..frames.saturating_sub(1) {
        match actions.at(frame) {
            Some(action) => held = action.contiguous().view(-1).try_into().expect("numbers of double precision"),
            None if tells_time && frame > 0 => held.iter_mut().for_each(|time| *time += dt),
            None if tells_time => {}
            None => held.fill(0.0),
        }
        cell.step(positions, velocities, &held, dt);
        seen.extend_from_slice(positions);
    }
    Tensor::from_slice(&seen).reshape([(frames * coordinates) as i64, batch as i64]).transpose(0, 1).contiguous()
}
