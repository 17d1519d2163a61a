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

/// The state at the last of `positions` (`[batch, L, 2 * objects]`), refined by `steps` Gauss-Newton steps.
///
/// The unknown is the state at the first input frame, so any cell will do. All but the last step are taken from several
/// starts without gradient, and the one that fits best is kept: where a motion has kinks (a ball that bounced during
/// the input) a single start is often on the wrong side of one. The last step is differentiable with respect to the
/// positions and the cell's parameters, the Jacobian held fixed; `estimate` itself gets no gradient.
pub fn refine(cell: &dyn Cell, dt: f64, positions: &Tensor, estimate: State, steps: usize) -> State {
    let frames = positions.size()[1] as usize - 1;
    if steps == 0 || frames == 0 {
        return estimate;
    }
    let observed = positions.flatten(1, 2);
    let start = best_start(cell, dt, positions, &estimate, steps - 1);
    let first = gauss_newton_step(cell, dt, &start, &observed, frames);
    cell.roll_out(&State::from_joined(&first), dt, frames).pop().expect("at least one frame")
}

/// The best of several starts after `steps` steps each, `[batch, 4 * objects]`, without gradient: the estimate rolled
/// back, and the difference of each pair of neighbouring frames rolled back.
fn best_start(cell: &dyn Cell, dt: f64, positions: &Tensor, estimate: &State, steps: usize) -> Tensor {
    let _guard = tch::no_grad_guard();
    let frames = positions.size()[1] as usize - 1;
    let rolled_back = |mut state: State, frames: usize| {
        for _ in 0..frames {
            state = cell.step(&state, -dt);
        }
        state.joined()
    };
    let mut starts = vec![rolled_back(estimate.detach(), frames)];
    for frame in 0..frames {
        let (now, next) = (positions.select(1, frame as i64), positions.select(1, frame as i64 + 1));
        starts.push(rolled_back(State { vel: (next - &now) / dt, pos: now }, frame));
    }
    let count = starts.len() as i64;
    let mut firsts = Tensor::cat(&starts, 0);
    let observed = positions.flatten(1, 2).repeat([count, 1]);
    for _ in 0..steps {
        firsts = gauss_newton_step(cell, dt, &firsts, &observed, frames);
    }
    let residual = trajectory(cell, dt, &firsts, frames) - observed;
    let misfit = residual.square().sum_dim_intlist([1i64].as_slice(), false, None).reshape([count, -1]);
    let (batch, unknowns) = (positions.size()[0], firsts.size()[1]);
    let best = misfit.argmin(0, true).unsqueeze(-1).expand([1, batch, unknowns], false);
    firsts.reshape([count, batch, unknowns]).gather(0, &best, false).squeeze_dim(0)
}

/// One damped Gauss-Newton step of states at the first frame towards the observed positions
/// `[batch, (frames + 1) * 2 * objects]`.
fn gauss_newton_step(cell: &dyn Cell, dt: f64, first: &Tensor, observed: &Tensor, frames: usize) -> Tensor {
    let inverse = pseudo_inverse(&jacobian(cell, dt, &first.detach(), frames));
    let residual = trajectory(cell, dt, first, frames) - observed;
    let step = inverse.bmm(&residual.unsqueeze(-1)).squeeze_dim(-1);
    first - step.clamp(-LARGEST_STEP, LARGEST_STEP)
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
