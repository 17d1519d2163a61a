//! Numbers that methods of integration are applied to: tensors of a batch, rows of states side by side, one number.

use std::ops::{Deref, DerefMut};

use num_traits::Float;
use tch::Tensor;

use super::integrator::{Integrand, Integrator};
use super::state::State;

/// Accelerations of a batch as a tensor, with gradients: of positions, velocities and the time since the step began.
#[derive(Debug)]
pub(super) struct OnTensors<A>(pub A);

impl<A: FnMut(&Tensor, &Tensor, f64) -> Tensor> Integrand for OnTensors<A> {
    type Values = Tensor;
    type Scalar = f64;

    fn acceleration(&mut self, pos: &Tensor, vel: &Tensor, since: f64) -> Tensor {
        (self.0)(pos, vel, since)
    }

    fn along(&mut self, from: Tensor, rate: &Tensor, h: f64) -> Tensor {
        from + rate * h
    }

    fn plus(&mut self, a: Tensor, b: &Tensor) -> Tensor {
        a + b
    }

    fn twice(&mut self, values: Tensor) -> Tensor {
        values * 2.0
    }

    fn copy(&mut self, values: &Tensor) -> Tensor {
        values.shallow_clone()
    }
}

/// The state a step of Euler's method later, with this acceleration in `state`, `[batch, coordinates]`.
pub(super) fn euler(state: &State, acceleration: &Tensor, h: f64) -> State {
    let mut accelerated = OnTensors(|_: &Tensor, _: &Tensor, _| acceleration.shallow_clone());
    let [pos, vel] =
        Integrator::Euler.step(&mut accelerated, [state.pos.shallow_clone(), state.vel.shallow_clone()], h);
    State { pos, vel }
}

/// A row of plain numbers: the caller's, which is written over, or one for what is computed on the way.
#[derive(Debug)]
pub(super) enum NumberRow<'a, F> {
    Lent(&'a mut [F]),
    Own(Vec<F>),
}

impl<F> Deref for NumberRow<'_, F> {
    type Target = [F];

    fn deref(&self) -> &[F] {
        match self {
            NumberRow::Lent(row) => row,
            NumberRow::Own(row) => row,
        }
    }
}

impl<F> DerefMut for NumberRow<'_, F> {
    fn deref_mut(&mut self) -> &mut [F] {
        match self {
            NumberRow::Lent(row) => row,
            NumberRow::Own(row) => row,
        }
    }
}

/// States side by side in plain numbers, `[coordinates, batch]`. `accelerate` writes the accelerations of positions and
/// velocities at a time since the step began.
#[derive(Debug)]
pub(super) struct OnRows<'a, F, A> {
    pub accelerate: A,
    /// Rows to be written over.
    pub spare: &'a mut Vec<Vec<F>>,
}

impl<F: Float, A> OnRows<'_, F, A> {
    fn row(&mut self, length: usize) -> Vec<F> {
        let mut row = self.spare.pop().unwrap_or_default();
        row.resize(length, F::zero());
        row
    }
}

impl<'a, F: Float, A: FnMut(&[F], &[F], F, &mut [F])> Integrand for OnRows<'a, F, A> {
    type Values = NumberRow<'a, F>;
    type Scalar = F;

    fn acceleration(&mut self, pos: &NumberRow<'a, F>, vel: &NumberRow<'a, F>, since: F) -> NumberRow<'a, F> {
        let mut into = self.row(pos.len());
        (self.accelerate)(pos, vel, since, &mut into);
        NumberRow::Own(into)
    }

    fn along(&mut self, mut from: NumberRow<'a, F>, rate: &NumberRow<'a, F>, h: F) -> NumberRow<'a, F> {
        from.iter_mut().zip(rate.iter()).for_each(|(from, rate)| *from = *from + *rate * h);
        from
    }

    fn plus(&mut self, mut a: NumberRow<'a, F>, b: &NumberRow<'a, F>) -> NumberRow<'a, F> {
        a.iter_mut().zip(b.iter()).for_each(|(a, b)| *a = *a + *b);
        a
    }

    fn twice(&mut self, mut values: NumberRow<'a, F>) -> NumberRow<'a, F> {
        values.iter_mut().for_each(|value| *value = *value + *value);
        values
    }

    fn copy(&mut self, values: &NumberRow<'a, F>) -> NumberRow<'a, F> {
        let mut copy = self.row(values.len());
        copy.copy_from_slice(values);
        NumberRow::Own(copy)
    }

    fn release(&mut self, values: NumberRow<'a, F>) {
        if let NumberRow::Own(row) = values {
            self.spare.push(row);
        }
    }
}
