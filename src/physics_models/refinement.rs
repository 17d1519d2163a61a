//! State refinement: an estimated state is improved under the physics by Gauss-Newton steps on all input positions.
//!
//! The velocity estimator sees one object at a time, so it cannot know the force the others exert; its velocities come
//! out shrunk and the learned forces too large. Not in the original.

use tch::{Kind, Tensor};

use crate::cells::{Cell, State};

/// Damping of the normal equations, in squared pixels for a unit step.
const DAMPING: f64 = 1e-2;
/// Largest change of a coordinate in one step, pixels or pixels per time unit.
const LARGEST_STEP: f64 = 5.0;
/// Half the difference quotient's span, pixels or pixels per time unit: large against float32 rounding of positions up
/// to 64 px over a few frames, small against the length on which forces vary.
const PROBE: f64 = 0.05;

/// The state at the last of `positions` (`[batch, L, 2 * objects]`), refined from `estimate` at the same frame.
///
/// The unknown is the state at the first input frame, so any cell will do: it is rolled forward only. Differentiable
/// with respect to the positions and the cell's parameters, the Jacobian held fixed.
pub fn refine(cell: &dyn Cell, dt: f64, positions: &Tensor, estimate: State, steps: usize) -> State {
    let frames = positions.size()[1] as usize - 1;
    if steps == 0 || frames == 0 {
        return estimate;
    }
    let mut first = estimate;
    for _ in 0..frames {
        first = cell.step(&first, -dt);
    }
    let mut first = first.joined();
    for _ in 0..steps {
        let inverse = pseudo_inverse(&jacobian(cell, dt, &first.detach(), frames));
        let residual = trajectory(cell, dt, &first, frames) - positions.flatten(1, 2);
        let step = inverse.bmm(&residual.unsqueeze(-1)).squeeze_dim(-1);
        first -= step.clamp(-LARGEST_STEP, LARGEST_STEP);
    }
    cell.roll_out(&State::from_joined(&first), dt, frames).pop().expect("at least one frame")
}

/// Positions of `frames + 1` frames from states `[batch, 4 * objects]`, as `[batch, (frames + 1) * 2 * objects]`.
fn trajectory(cell: &dyn Cell, dt: f64, first: &Tensor, frames: usize) -> Tensor {
    let first = State::from_joined(first);
    let rolled = cell.roll_out(&first, dt, frames);
    let positions: Vec<&Tensor> = std::iter::once(&first.pos).chain(rolled.iter().map(|state| &state.pos)).collect();
    Tensor::cat(&positions, 1)
}

/// Derivative of the trajectory by the first state, `[batch, (frames + 1) * 2 * objects, 4 * objects]`, by central
/// differences: all perturbed copies roll out as one batch.
fn jacobian(cell: &dyn Cell, dt: f64, first: &Tensor, frames: usize) -> Tensor {
    let _guard = tch::no_grad_guard();
    let (batch, unknowns) = first.size2().expect("states [batch, 4 * objects]");
    let probe = Tensor::eye(unknowns, (first.kind(), first.device())) * PROBE;
    let probes = Tensor::cat(&[&probe, &(-&probe)], 0);
    let copies = (first.unsqueeze(1) + probes).reshape([batch * 2 * unknowns, unknowns]);
    let ends = trajectory(cell, dt, &copies, frames).reshape([batch, 2, unknowns, -1]);
    ((ends.select(1, 0) - ends.select(1, 1)) / (2.0 * PROBE)).transpose(1, 2)
}

/// `(J^T J + damping)^-1 J^T`, without gradient.
fn pseudo_inverse(jacobian: &Tensor) -> Tensor {
    let _guard = tch::no_grad_guard();
    let transposed = jacobian.transpose(1, 2).to_kind(Kind::Double);
    let normal = transposed.bmm(&transposed.transpose(1, 2));
    let identity = Tensor::eye(normal.size()[1], (Kind::Double, normal.device()));
    Tensor::linalg_solve(&(normal + identity * DAMPING), &transposed, true).to_kind(jacobian.kind())
}
