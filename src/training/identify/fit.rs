//! The fit of the physical parameters to encoded trajectories.
//!
//! Unknown are the log-parameters, one offset of each object's template (the encoder may put an object beside its centre,
//! always by as much), and the initial state of each clip.
//!
//! The fit is Levenberg-Marquardt in float64 with a Huber loss. The normal equations have an arrow's shape (states of
//! one clip touch only the shared unknowns), so each clip's states are eliminated first. Derivatives are central
//! differences of batched roll-outs: any cell will do.

use anyhow::{Result, ensure};
use tch::{Device, Kind, Tensor};

use super::Identify;
use crate::network::System;
use crate::network::cells::{Actions, State};
use crate::network::physics_models::Parameter;

/// Half the span of the difference quotients, in the unit of a coordinate, of a velocity, or natural logarithm. In float64 roll-outs
/// of positions up to 64 px it leaves nine digits.
const PROBE: f64 = 1e-4;
/// Weight of a squared offset, clip by clip: holds those in place that the physics does not see (a common shift).
const OFFSET_RIDGE: f64 = 1e-3;
/// Largest change of a log-parameter in one iteration.
const LARGEST_LOG_STEP: f64 = 0.5;
/// Damping at the start, its change after a failed or a good iteration, and where it gives up.
const DAMPING: f64 = 1e-2;
const DAMPING_UP: f64 = 8.0;
const DAMPING_DOWN: f64 = 0.3;
const DAMPING_LIMIT: f64 = 1e8;
/// Relative fall of the cost at which a horizon is done.
const CONVERGED: f64 = 1e-5;

/// The result of a fit.
#[derive(Debug)]
pub struct Fit {
    /// Log-parameters in the cell's order, those that are fixed included.
    pub logs: Vec<f64>,
    /// Encoded minus true position of each object in the cell's coordinates; a common shift is taken as 0 where the physics
    /// does not depend on it.
    pub offsets: Vec<f64>,
    /// Positions (without the offsets) and velocities of each clip at its first frame, `[clips, 2 * coordinates]`.
    pub states: Tensor,
    /// Root mean square of the residuals at the longest horizon, pixels or radians.
    pub residual: f64,
    pub iterations: usize,
}

/// The unknowns.
#[derive(Debug)]
struct Unknowns {
    /// `[parameters]`.
    logs: Tensor,
    /// `[coordinates]` of all objects.
    offsets: Tensor,
    /// Positions and velocities at the first frame, `[clips, 2 * coordinates]`.
    states: Tensor,
}

struct Problem<'a> {
    system: &'a System,
    /// Whether each of the cell's parameters is learned.
    learned: &'a [bool],
    huber: f64,
    /// `[clips, frames, coordinates]`, float64.
    positions: &'a Tensor,
    actions: &'a Actions,
    horizon: usize,
}

/// Residuals and their derivatives at some unknowns.
struct Linearised {
    /// `[clips, residuals]`.
    residual: Tensor,
    /// `[clips, residuals, 2 * coordinates]`.
    by_state: Tensor,
    /// `[clips, residuals, parameters + coordinates]`.
    by_shared: Tensor,
}

/// Fits a system's equation to encoded positions `[clips, frames, coordinates]`, beginning at the parameters' present
/// values; `actions` begin at the first frame.
///
/// # Errors
/// Positions that are not finite.
pub fn fit(
    config: &Identify,
    system: &System,
    positions: &Tensor,
    actions: &Actions,
    parameters: &[Parameter],
) -> Result<Fit> {
    let _guard = tch::no_grad_guard();
    let positions = positions.to_device(Device::Cpu).to_kind(Kind::Double);
    let actions = &actions.to(Device::Cpu, Kind::Double);
    ensure!(
        positions.isfinite().all().int64_value(&[]) == 1,
        "identify: encoded positions are not finite; the encoder has diverged"
    );
    let first = positions.select(1, 0);
    let velocity = (positions.select(1, 1) - &first) / system.dt;
    let coordinates = first.size()[1];
    let logs: Vec<f64> = parameters.iter().map(|parameter| parameter.log.double_value(&[])).collect();
    let learned: Vec<bool> = parameters.iter().map(|parameter| parameter.learned).collect();
    let mut unknowns = Unknowns {
        logs: Tensor::from_slice(&logs),
        offsets: Tensor::zeros([coordinates], (Kind::Double, positions.device())),
        states: Tensor::cat(&[first, velocity], 1),
    };
    let mut iterations = 0;
    let mut residual = f64::NAN;
    for &horizon in &config.horizons {
        let huber = config.huber;
        let problem = Problem { system, learned: &learned, huber, positions: &positions, actions, horizon };
        iterations += problem.minimise(&mut unknowns, config.max_iterations);
        residual = problem.residual(&unknowns).square().mean(Kind::Double).sqrt().double_value(&[]);
    }
    let (logs, offsets) = (values(&unknowns.logs), values(&unknowns.offsets));
    Ok(Fit { logs, offsets, states: unknowns.states, residual, iterations })
}

fn values(x: &Tensor) -> Vec<f64> {
    Vec::try_from(x).expect("a float64 vector")
}

impl Problem<'_> {
    /// Positions of the roll-outs, `[clips * copies, horizon * coordinates]`.
    fn roll_out(&self, logs: &Tensor, states: &Tensor, actions: &Actions) -> Tensor {
        let logs: Vec<_> = (0..logs.size()[0]).map(|i| logs.get(i)).collect();
        let first = State::from_joined(states);
        let rolled = self.system.build_cell(&logs).roll_out(&first, actions, self.system.dt, self.horizon - 1);
        let frames: Vec<_> = std::iter::once(&first.pos).chain(rolled.iter().map(|state| &state.pos)).collect();
        Tensor::cat(&frames, 1)
    }

    /// Roll-out and offsets minus encoded positions, `[clips, horizon * coordinates]`.
    fn residual(&self, unknowns: &Unknowns) -> Tensor {
        let seen = self.positions.narrow(1, 0, self.horizon as i64).flatten(1, 2);
        self.roll_out(&unknowns.logs, &unknowns.states, self.actions) + unknowns.offsets.repeat([self.horizon as i64])
            - seen
    }

    /// Huber loss of all residuals and the ridge on the offsets.
    fn cost(&self, unknowns: &Unknowns) -> f64 {
        let size = self.residual(unknowns).abs();
        let linear = (&size - 0.5 * self.huber) * self.huber;
        let huber = (size.square() * 0.5).where_self(&size.le(self.huber), &linear).sum(Kind::Double);
        let ridge = unknowns.offsets.square().sum(Kind::Double) * (0.5 * self.ridge());
        (huber + ridge).double_value(&[])
    }

    fn ridge(&self) -> f64 {
        OFFSET_RIDGE * self.positions.size()[0] as f64
    }

    fn linearise(&self, unknowns: &Unknowns) -> Linearised {
        let Unknowns { logs, offsets, states } = unknowns;
        let (clips, state_size) = states.size2().expect("states [clips, state]");
        let parameters = logs.size()[0];
        let quotient = |up: Tensor, down: Tensor| (up - down) / (2.0 * PROBE);
        let probe = Tensor::eye(state_size, (Kind::Double, states.device())) * PROBE;
        let probes = Tensor::cat(&[&probe, &(-&probe)], 0);
        let copies = (states.unsqueeze(1) + probes).reshape([-1, state_size]);
        let actions = self.actions.each_repeated(2 * state_size);
        let ends = self.roll_out(logs, &copies, &actions).reshape([clips, 2, state_size, -1]);
        let by_state = quotient(ends.select(1, 0), ends.select(1, 1)).transpose(1, 2);
        let steps = Tensor::eye(parameters, (Kind::Double, states.device())) * PROBE;
        let mut shared: Vec<Tensor> = (0..parameters)
            .map(|p| {
                let step = steps.get(p);
                let shifted = |logs: Tensor| self.roll_out(&logs, states, self.actions);
                // Without a derivative a parameter stays where it is.
                let learned = f64::from(self.learned[p as usize]);
                (quotient(shifted(logs + &step), shifted(logs - &step)) * learned).unsqueeze(-1)
            })
            .collect();
        let coordinates = offsets.size()[0];
        let by_offset = Tensor::eye(coordinates, (Kind::Double, states.device())).repeat([self.horizon as i64, 1]);
        shared.push(by_offset.unsqueeze(0).expand([clips, -1, -1], false));
        Linearised { residual: self.residual(unknowns), by_state, by_shared: Tensor::cat(&shared, 2) }
    }

    /// The damped Gauss-Newton step: changes of the shared unknowns and of the states.
    fn step(&self, at: &Linearised, unknowns: &Unknowns, damping: f64) -> (Tensor, Tensor) {
        let weight = (self.huber / at.residual.abs().clamp_min(self.huber)).unsqueeze(-1);
        let weighted = |j: &Tensor| (j * &weight).transpose(1, 2);
        let damped = |normal: Tensor| {
            let diagonal = normal.diagonal(0, -2, -1) * damping + 1e-9;
            normal + diagonal.diag_embed(0, -2, -1)
        };
        let residual = at.residual.unsqueeze(-1);
        let (w_state, w_shared) = (weighted(&at.by_state), weighted(&at.by_shared));
        let state_state = damped(w_state.bmm(&at.by_state));
        let state_shared = w_state.bmm(&at.by_shared);
        let g_state = w_state.bmm(&residual);
        // Solve for [A^-1 B, A^-1 g] of each clip at once.
        let eliminated = Tensor::linalg_solve(&state_state, &Tensor::cat(&[&state_shared, &g_state], 2), true);
        let shared_count = state_shared.size()[2];
        let (a_b, a_g) = (eliminated.narrow(2, 0, shared_count), eliminated.narrow(2, shared_count, 1));
        let over_clips = |x: Tensor| x.sum_dim_intlist([0i64].as_slice(), false, None);
        let parameters = unknowns.logs.size()[0];
        let ridge = Tensor::cat(&[unknowns.logs.zeros_like(), unknowns.offsets.full_like(self.ridge())], 0);
        let shared_shared = damped(over_clips(w_shared.bmm(&at.by_shared)) + ridge.diag_embed(0, -2, -1))
            - over_clips(state_shared.transpose(1, 2).bmm(&a_b));
        let held = Tensor::cat(&[unknowns.logs.zeros_like(), &unknowns.offsets * self.ridge()], 0);
        let g_shared = over_clips(w_shared.bmm(&residual)).squeeze_dim(-1) + held
            - over_clips(state_shared.transpose(1, 2).bmm(&a_g)).squeeze_dim(-1);
        let mut shared = -Tensor::linalg_solve(&shared_shared, &g_shared, true);
        let largest = if parameters > 0 { shared.narrow(0, 0, parameters).abs().max().double_value(&[]) } else { 0.0 };
        if largest > LARGEST_LOG_STEP {
            shared *= LARGEST_LOG_STEP / largest;
        }
        let states = -(a_g + a_b.matmul(&shared.unsqueeze(-1))).squeeze_dim(-1);
        (shared, states)
    }

    /// Iterates until the cost stands still; returns the iterations.
    fn minimise(&self, unknowns: &mut Unknowns, max_iterations: usize) -> usize {
        let parameters = unknowns.logs.size()[0];
        let coordinates = unknowns.offsets.size()[0];
        let mut damping = DAMPING;
        let mut cost = self.cost(unknowns);
        for iteration in 0..max_iterations {
            let at = self.linearise(unknowns);
            loop {
                let (shared, states) = self.step(&at, unknowns, damping);
                let next = Unknowns {
                    logs: &unknowns.logs + shared.narrow(0, 0, parameters),
                    offsets: &unknowns.offsets + shared.narrow(0, parameters, coordinates),
                    states: &unknowns.states + states,
                };
                let next_cost = self.cost(&next);
                // A cost that is not a number is no better either.
                if next_cost < cost {
                    let fall = (cost - next_cost) / cost;
                    (*unknowns, cost) = (next, next_cost);
                    damping *= DAMPING_DOWN;
                    if fall < CONVERGED {
                        return iteration + 1;
                    }
                    break;
                }
                damping *= DAMPING_UP;
                if damping > DAMPING_LIMIT {
                    return iteration + 1;
                }
            }
        }
        max_iterations
    }
}
