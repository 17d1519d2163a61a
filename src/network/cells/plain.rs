//! Cells in plain numbers: many states side by side, without tensors, gradients or allocations in a step. For planning (single
//! precision) and for fits (double), where a tensor of a few numbers costs many times the arithmetic.

use std::fmt::Debug;

use tch::Tensor;

use super::actions::Actions;
use super::integrands::{NumberRow, OnRows};
use super::integrator::{Integrator, SUBSTEPS};

/// An equation with its parameters that moves a batch of states on.
///
/// Numbers stand coordinate by coordinate, within it state by state: `[coordinates, batch]`. So several states fit into a
/// register.
pub trait PlainCell<F = f32>: Debug {
    /// All states a time `dt` later, one frame; `action` (`[batch]`) acts meanwhile.
    fn step(&mut self, positions: &mut [F], velocities: &mut [F], action: &[F], dt: F);
}

/// What accelerates the objects of an equation. With [`Euler`] it is a [`Cell::plain_double`](super::Cell::plain_double):
///
/// ```
/// use paig::network::cells::plain::{AccelerationLaw, Euler, PlainCell, columns, columns_mut};
///
/// /// One ball that falls through a medium.
/// #[derive(Debug)]
/// struct Falling {
///     g: f64,
///     drag: f64,
/// }
///
/// impl AccelerationLaw for Falling {
///     fn accelerate(&self, _positions: &[f64], velocities: &[f64], _action: &[f64], into: &mut [f64]) {
///         let [vx, vy] = columns(velocities);
///         let [ax, ay] = columns_mut(into);
///         for i in 0..vx.len() {
///             (ax[i], ay[i]) = (-self.drag * vx[i], self.g - self.drag * vy[i]);
///         }
///     }
/// }
///
/// // Two states side by side: x of both, then y of both. One of them moves to the right.
/// let (mut positions, mut velocities) = ([0.0_f64; 4], [0.0_f64, 2.0, 0.0, 0.0]);
/// Euler::new(Falling { g: 10.0, drag: 0.0 }).step(&mut positions, &mut velocities, &[0.0; 2], 1.0);
/// // A fifth of the time with each of the speeds 2, 4, 6, 8 and 10.
/// let expected = [0.0, 2.0, 6.0, 6.0];
/// assert!(positions.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-12));
/// ```
pub trait AccelerationLaw: Debug {
    /// Writes the accelerations in these states, all `[coordinates, batch]`, pixels (an angle: radians) per squared time unit;
    /// `action` (`[batch]`, 0 where nothing acts) acts.
    fn accelerate(&self, positions: &[f64], velocities: &[f64], action: &[f64], into: &mut [f64]);
}

/// A law, integrated as [`Cell::step`](super::Cell::step) does it with a substep that moves the positions by the velocities at
/// its end.
#[derive(Debug)]
pub struct Euler<L> {
    law: L,
    /// Rows for what is computed on the way.
    spare: Vec<Vec<f64>>,
}

impl<L: AccelerationLaw> Euler<L> {
    pub fn new(law: L) -> Self {
        Euler { law, spare: Vec::new() }
    }
}

impl<L: AccelerationLaw> PlainCell<f64> for Euler<L> {
    fn step(&mut self, positions: &mut [f64], velocities: &mut [f64], action: &[f64], dt: f64) {
        let Euler { law, spare } = self;
        for _ in 0..SUBSTEPS {
            let accelerate =
                |pos: &[f64], vel: &[f64], _: f64, into: &mut [f64]| law.accelerate(pos, vel, action, into);
            let state = [NumberRow::Lent(&mut *positions), NumberRow::Lent(&mut *velocities)];
            Integrator::Euler.step(&mut OnRows { accelerate, spare: &mut *spare }, state, dt / SUBSTEPS as f64);
        }
    }
}

/// The coordinates of numbers `[N, batch]`, each `[batch]`: of two objects `[x0, y0, x1, y1]`.
pub fn columns<const N: usize>(numbers: &[f64]) -> [&[f64]; N] {
    let batch = numbers.len() / N;
    std::array::from_fn(|number| &numbers[number * batch..][..batch])
}

/// The same, to be written.
///
/// # Panics
/// Fewer than `N` numbers: a mistake in the program, never in its input.
pub fn columns_mut<const N: usize>(numbers: &mut [f64]) -> [&mut [f64]; N] {
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
