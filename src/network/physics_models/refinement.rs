//! State refinement: an estimated state is improved under the physics by Gauss-Newton steps on all input positions.
//!
//! The velocity estimator sees one object at a time and learns through the pictures: from scratch its velocities come out
//! shrunk and the learned forces too large. Not in the original.

use tch::{Kind, Tensor};

use crate::network::cells::{Actions, Cell, State};

// Coordinates count in their unit (pixels or radians), velocities in that unit per frame, whatever the unit of time is.

/// Damping of the normal equations.
const DAMPING: f64 = 1e-2;
/// Largest change in one step.
const LARGEST_STEP: f64 = 5.0;
/// Half the difference quotient's span: large against float32 rounding of positions up to 64 px over a few frames, small
/// against the length on which forces vary.
const PROBE: f64 = 0.05;

/// A residual of this size, in a coordinate's unit, counts half, larger ones ever less (Cauchy's weights): what the encoder
/// misread in one frame says nothing against what it saw in the others.
const HALF: f64 = 0.5;

/// What the roll-outs of the input have in common.
struct RollOutInput<'a> {
    cell: &'a dyn Cell,
    dt: f64,
    /// Steps from the first input frame to the last.
    frames: usize,
    /// What counts as 1 in each number of a state, `[state]`: a coordinate's unit, or that per frame.
    units: Tensor,
}

/// The state at the last of `positions` (`[batch, L, coordinates * objects]`), refined by `steps` Gauss-Newton steps;
/// `actions` begin at the first of them.
///
/// The unknown is the state at the first input frame, so any cell will do. All but the last step are taken from several
/// starts without gradient, and the one that fits best is kept: where a motion has kinks (a ball that bounced during
/// the input) a single start is often on the wrong side of one. The last step is differentiable with respect to the
/// positions and the cell's parameters, the Jacobian held fixed; `estimate` itself gets no gradient.
pub fn refine(cell: &dyn Cell, dt: f64, positions: &Tensor, actions: &Actions, estimate: State, steps: usize) -> State {
    let frames = positions.size()[1] as usize - 1;
    if steps == 0 || frames == 0 {
        return estimate;
    }
    let ones = Tensor::ones(&estimate.pos.size()[1..], (estimate.pos.kind(), estimate.pos.device()));
    let input = RollOutInput { cell, dt, frames, units: Tensor::cat(&[&ones, &(&ones / dt)], 0) };
    let start = input.best_start(positions, actions, &estimate, steps - 1);
    let first = input.gauss_newton_step(&start, actions, &positions.flatten(1, 2));
    cell.roll_out(&State::from_joined(&first), actions, dt, frames).pop().expect("at least one frame")
}

impl RollOutInput<'_> {
    /// The best of several starts after `steps` steps each, `[batch, state]`, without gradient: the estimate rolled back,
    /// and the difference of each pair of neighbouring frames rolled back.
    fn best_start(&self, positions: &Tensor, actions: &Actions, estimate: &State, steps: usize) -> Tensor {
        let _guard = tch::no_grad_guard();
        let rolled_back = |mut state: State, frames: usize| {
            for frame in (0..frames).rev() {
                state = self.cell.step(&state, actions.at(frame).as_ref(), -self.dt);
            }
            state.joined()
        };
        let mut starts = vec![rolled_back(estimate.detach(), self.frames)];
        for frame in 0..self.frames {
            let (now, next) = (positions.select(1, frame as i64), positions.select(1, frame as i64 + 1));
            starts.push(rolled_back(State { vel: (next - &now) / self.dt, pos: now }, frame));
        }
        let count = starts.len() as i64;
        let mut firsts = Tensor::cat(&starts, 0);
        let observed = positions.flatten(1, 2).repeat([count, 1]);
        let actions = actions.all_repeated(count);
        for _ in 0..steps {
            firsts = self.gauss_newton_step(&firsts, &actions, &observed);
        }
        let residual = self.trajectory(&firsts, &actions) - observed;
        let misfit = (residual / HALF).square().log1p();
        let misfit = misfit.sum_dim_intlist([1i64].as_slice(), false, None).reshape([count, -1]);
        // One that left the numbers fits worst.
        let misfit = misfit.nan_to_num(f64::INFINITY, None, None);
        let (batch, unknowns) = (positions.size()[0], firsts.size()[1]);
        let best = misfit.argmin(0, true).unsqueeze(-1).expand([1, batch, unknowns], false);
        firsts.reshape([count, batch, unknowns]).gather(0, &best, false).squeeze_dim(0)
    }

    /// One damped Gauss-Newton step of states at the first frame towards the observed positions
    /// `[batch, (frames + 1) * coordinates * objects]`.
    fn gauss_newton_step(&self, first: &Tensor, actions: &Actions, observed: &Tensor) -> Tensor {
        let residual = self.trajectory(first, actions) - observed;
        let inverse = self.pseudo_inverse(&self.jacobian(&first.detach(), actions), &residual.detach());
        let step = inverse.bmm(&residual.unsqueeze(-1)).squeeze_dim(-1);
        let largest = &self.units * LARGEST_STEP;
        first - step.clamp_tensor(Some(-&largest), Some(largest))
    }

    /// Positions of all input frames from states `[batch, state]` at the first,
    /// `[batch, (frames + 1) * coordinates * objects]`.
    fn trajectory(&self, first: &Tensor, actions: &Actions) -> Tensor {
        let first = State::from_joined(first);
        let rolled = self.cell.roll_out(&first, actions, self.dt, self.frames);
        let positions: Vec<&Tensor> =
            std::iter::once(&first.pos).chain(rolled.iter().map(|state| &state.pos)).collect();
        Tensor::cat(&positions, 1)
    }

    /// Derivative of the trajectory by the first state, `[batch, (frames + 1) * coordinates * objects, state]`, by central
    /// differences: all perturbed copies roll out as one batch.
    fn jacobian(&self, first: &Tensor, actions: &Actions) -> Tensor {
        let _guard = tch::no_grad_guard();
        let (batch, unknowns) = first.size2().expect("states [batch, state]");
        let span = &self.units * PROBE;
        let probe = span.diag(0);
        let probes = Tensor::cat(&[&probe, &(-&probe)], 0);
        let copies = (first.unsqueeze(1) + probes).reshape([batch * 2 * unknowns, unknowns]);
        let actions = actions.each_repeated(2 * unknowns);
        let ends = self.trajectory(&copies, &actions).reshape([batch, 2, unknowns, -1]);
        ((ends.select(1, 0) - ends.select(1, 1)) / (span * 2.0).unsqueeze(1)).transpose(1, 2)
    }

    /// `(J^T W J + damping)^-1 J^T W` with the weights of these residuals, without gradient.
    fn pseudo_inverse(&self, jacobian: &Tensor, residual: &Tensor) -> Tensor {
        let _guard = tch::no_grad_guard();
        let weight = ((residual.to_kind(Kind::Double) / HALF).square() + 1.0).reciprocal().unsqueeze(1);
        let exact = jacobian.to_kind(Kind::Double);
        let transposed = exact.transpose(1, 2) * weight;
        let normal = transposed.bmm(&exact);
        let damping = self.units.to_kind(Kind::Double).square().reciprocal() * DAMPING;
        Tensor::linalg_solve_ex(&(normal + damping.diag(0)), &transposed, true, false).0.to_kind(jacobian.kind())
    }
}
