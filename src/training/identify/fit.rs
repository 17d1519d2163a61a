//! The fit of the physical parameters to encoded trajectories.
//!
//! Unknown are the unconstrained parameters (of a positive one its logarithm), one offset of each object's template (the
//! encoder may put an object beside its centre, always by as much), and the initial state of each clip.
//!
//! The fit is Levenberg-Marquardt in float64 with a Huber loss. The normal equations have an arrow's shape (states of
//! one clip touch only the shared unknowns), so each clip's states are eliminated first. Derivatives are central
//! differences of batched roll-outs: any cell will do.

use anyhow::{Result, ensure};
use tch::{Device, Kind, Tensor};

use super::Identify;
use crate::network::System;
use crate::network::cells::{Actions, State, plain};
use crate::network::physics_models::PhysicsNet;
use crate::support::least_squares;
use crate::support::statistics::MEDIAN_TO_DEVIATION;
use paig_kernels::KernelsAlone;

/// Half the span of the difference quotients, in the unit of a coordinate or a velocity, or of an unconstrained parameter.
/// In float64 roll-outs of positions up to 64 px it leaves nine digits.
const PROBE: f64 = 1e-4;
/// Weight of a squared offset, clip by clip: holds those in place that the physics does not see (a common shift).
const OFFSET_RIDGE: f64 = 1e-3;
/// Largest change of an unconstrained parameter in one iteration.
const LARGEST_RAW_STEP: f64 = 0.5;
/// Added to the diagonal of normal equations, of their largest number.
const LEAST_HELD: f64 = 1e-12;
/// Relative fall of the cost at which a horizon is done.
const CONVERGED: f64 = 1e-5;

/// Where a fit begins, and what is free.
#[derive(Debug)]
pub struct FitStart {
    /// Raw numbers of the parameters in the cell's order.
    pub unconstrained: Vec<f64>,
    /// Whether each of them is learned.
    pub learned: Vec<bool>,
    /// Whether each object may be seen beside its place by an offset of its own.
    pub free_offsets: bool,
    /// Positions and velocities of each clip at its first frame, `[clips, 2 * coordinates]`, from an earlier fit: then only
    /// the longest horizon is fitted. None: what the first two positions say.
    pub states: Option<Tensor>,
}

/// Which residuals count, and how.
#[derive(Debug, Default)]
pub struct Trust {
    /// What the residuals of a frame are multiplied by, `[coordinates, coordinates]`; none for as they are.
    pub weights: Option<Tensor>,
    /// 1 for a residual that counts, 0 for one that does not, `[clips, frames * coordinates]`; none for all.
    pub mask: Option<Tensor>,
    /// Residuals beyond this count linearly, pixels or radians; none for the config's.
    pub huber: Option<f64>,
}

impl FitStart {
    /// The parameters of a model as they are.
    pub fn of(model: &PhysicsNet) -> Self {
        FitStart {
            unconstrained: model.parameters.iter().map(|parameter| parameter.unconstrained.double_value(&[])).collect(),
            learned: model.parameters.iter().map(|parameter| parameter.learned).collect(),
            free_offsets: true,
            states: None,
        }
    }
}

/// The result of a fit.
#[derive(Debug)]
pub struct Fit {
    /// Raw numbers of the parameters in the cell's order, those that are fixed included.
    pub unconstrained: Vec<f64>,
    /// Encoded minus true position of each object in the cell's coordinates; a common shift is taken as 0 where the physics
    /// does not depend on it.
    pub offsets: Vec<f64>,
    /// Positions (without the offsets) and velocities of each clip at its first frame, `[clips, 2 * coordinates]`.
    pub states: Tensor,
    /// Root mean square of the residuals at the longest horizon, pixels or radians.
    pub residual: f64,
    /// The same from the median size of the residuals: what a usual one is, whatever a few are.
    pub usual_residual: f64,
    /// Residuals of all frames of the longest horizon, `[clips, frames, coordinates]`.
    pub residuals: Tensor,
    /// Standard deviation of each unconstrained parameter, from the fit's curvature and the scatter over clips; 0 of one
    /// that is fixed, infinite of one that shows in no position.
    pub deviations: Vec<f64>,
    /// Second derivatives of the cost by the unconstrained parameters, everything else following: `[parameters,
    /// parameters]`, in the cell's order; 0 for one that is fixed.
    pub curvature: Tensor,
    pub iterations: usize,
}

/// The unknowns.
#[derive(Debug)]
struct FitUnknowns {
    /// `[parameters]`.
    unconstrained: Tensor,
    /// `[coordinates]` of all objects.
    offsets: Tensor,
    /// Positions and velocities at the first frame, `[clips, 2 * coordinates]`.
    states: Tensor,
}

struct FitProblem<'a> {
    system: &'a System,
    /// Whether each of the cell's parameters is learned.
    learned: &'a [bool],
    free_offsets: bool,
    /// `[coordinates, coordinates]`.
    weights: Option<&'a Tensor>,
    /// `[clips, frames * coordinates]`.
    mask: Option<&'a Tensor>,
    huber: f64,
    /// `[clips, frames, coordinates]`, float64.
    positions: &'a Tensor,
    actions: &'a Actions,
    horizon: usize,
}

/// Residuals and their derivatives at some unknowns.
struct Linearisation {
    /// `[clips, residuals]`.
    residual: Tensor,
    /// `[clips, residuals, 2 * coordinates]`.
    by_state: Tensor,
    /// `[clips, residuals, parameters + coordinates]`.
    by_shared: Tensor,
}

/// The normal equations of the shared unknowns.
struct Eliminated {
    /// `[shared, shared]`.
    normal: Tensor,
    /// Of each clip, `[clips, shared]`, and of the ridge, `[shared]`.
    gradients: Tensor,
    held: Tensor,
    /// What the states follow by: `[clips, state, shared]`, `[clips, state, 1]`.
    a_b: Tensor,
    a_g: Tensor,
}

/// Fits a system's equation to positions `[clips, frames, coordinates]`; `actions` begin at the first frame.
///
/// # Errors
/// Positions that are not finite.
pub fn fit(
    config: &Identify,
    system: &System,
    positions: &Tensor,
    actions: &Actions,
    start: &FitStart,
    trust: &Trust,
) -> Result<Fit> {
    let _guard = tch::no_grad_guard();
    let _alone = KernelsAlone::begin();
    let positions = positions.to_device(Device::Cpu).to_kind(Kind::Double);
    let actions = &actions.to(Device::Cpu, Kind::Double);
    ensure!(
        positions.isfinite().all().int64_value(&[]) == 1,
        "identify: encoded positions are not finite; the encoder has diverged"
    );
    let coordinates = positions.size()[2];
    let states = start.states.as_ref().map_or_else(|| first_states(&positions, system.dt), Tensor::shallow_clone);
    let mut unknowns = FitUnknowns {
        unconstrained: Tensor::from_slice(&start.unconstrained),
        offsets: Tensor::zeros([coordinates], (Kind::Double, positions.device())),
        states,
    };
    let problem = |horizon: usize| FitProblem {
        system,
        learned: &start.learned,
        free_offsets: start.free_offsets,
        weights: trust.weights.as_ref(),
        mask: trust.mask.as_ref(),
        huber: trust.huber.unwrap_or(config.huber),
        positions: &positions,
        actions,
        horizon,
    };
    let longest = config.horizons.last().copied().unwrap_or(positions.size()[1] as usize);
    let mut iterations = 0;
    for &horizon in config.horizons.iter().filter(|&&horizon| start.states.is_none() || horizon == longest) {
        iterations += problem(horizon).minimise(&mut unknowns, config.max_iterations);
    }
    let longest = problem(longest);
    let (deviations, curvature) = longest.certainty(&unknowns);
    let residuals = FitProblem { weights: None, ..longest }.residual(&unknowns);
    let counted = longest.masked(residuals.ones_like()).sum(Kind::Double).clamp_min(1.0);
    let residual = (longest.masked(residuals.square()).sum(Kind::Double) / counted).sqrt().double_value(&[]);
    let usual_residual = residuals.abs().median().double_value(&[]) * MEDIAN_TO_DEVIATION;
    let (unconstrained, offsets) = (values(&unknowns.unconstrained), values(&unknowns.offsets));
    let residuals = residuals.reshape([positions.size()[0], -1, coordinates]);
    Ok(Fit {
        unconstrained,
        offsets,
        states: unknowns.states,
        residual,
        usual_residual,
        residuals,
        deviations,
        curvature,
        iterations,
    })
}

/// The states at the first frame by the first two positions.
fn first_states(positions: &Tensor, dt: f64) -> Tensor {
    let first = positions.select(1, 0);
    let velocity = (positions.select(1, 1) - &first) / dt;
    Tensor::cat(&[first, velocity], 1)
}

fn values(x: &Tensor) -> Vec<f64> {
    Vec::try_from(x).expect("a float64 vector")
}

impl FitProblem<'_> {
    /// Positions of the roll-outs, `[clips * copies, horizon * coordinates]`.
    fn roll_out(&self, unconstrained: &Tensor, states: &Tensor, actions: &Actions) -> Tensor {
        let unconstrained: Vec<_> = (0..unconstrained.size()[0]).map(|i| unconstrained.get(i)).collect();
        let System { cell: ref kind, dt, .. } = *self.system;
        let cell = self.system.build_cell(&unconstrained);
        if let Some(mut cell) = cell.plain_double() {
            return plain::roll_out(cell.as_mut(), states, actions, kind.tells_time(), dt, self.horizon);
        }
        let first = State::from_joined(states);
        let rolled = cell.roll_out(&first, actions, dt, self.horizon - 1);
        let frames: Vec<_> = std::iter::once(&first.pos).chain(rolled.iter().map(|state| &state.pos)).collect();
        Tensor::cat(&frames, 1)
    }

    /// Roll-out and offsets minus encoded positions, `[clips, horizon * coordinates]`.
    fn residual(&self, unknowns: &FitUnknowns) -> Tensor {
        let seen = self.positions.narrow(1, 0, self.horizon as i64).flatten(1, 2);
        let rolled_out = self.roll_out(&unknowns.unconstrained, &unknowns.states, self.actions);
        self.weighted(&(rolled_out + unknowns.offsets.repeat([self.horizon as i64]) - seen), 1)
    }

    /// Of each residual, `[clips, horizon * coordinates]`, nothing where it does not count.
    fn masked(&self, x: Tensor) -> Tensor {
        match self.mask {
            Some(mask) => &x * mask.narrow(1, 0, x.size()[1]),
            None => x,
        }
    }

    /// An array with `horizon * coordinates` along an axis, those of each frame multiplied by the weights.
    fn weighted(&self, x: &Tensor, axis: i64) -> Tensor {
        let Some(weights) = self.weights else { return x.shallow_clone() };
        let last = x.transpose(axis, -1);
        let size = last.size();
        let frames = last.reshape([-1, weights.size()[0]]).matmul(&weights.transpose(0, 1));
        frames.reshape(size).transpose(axis, -1)
    }

    /// Huber loss of all residuals and the ridge on the offsets.
    fn cost(&self, unknowns: &FitUnknowns) -> f64 {
        let size = self.residual(unknowns).abs();
        let linear = (&size - 0.5 * self.huber) * self.huber;
        let huber = (size.square() * 0.5).where_self(&size.le(self.huber), &linear);
        let huber = self.masked(huber).sum(Kind::Double);
        let ridge = unknowns.offsets.square().sum(Kind::Double) * (0.5 * self.ridge());
        (huber + ridge).double_value(&[])
    }

    fn ridge(&self) -> f64 {
        OFFSET_RIDGE * self.positions.size()[0] as f64
    }

    fn linearise(&self, unknowns: &FitUnknowns) -> Linearisation {
        let FitUnknowns { unconstrained, offsets, states } = unknowns;
        let (clips, state_size) = states.size2().expect("states [clips, state]");
        let parameters = unconstrained.size()[0];
        let quotient = |up: Tensor, down: Tensor| (up - down) / (2.0 * PROBE);
        let probe = Tensor::eye(state_size, (Kind::Double, states.device())) * PROBE;
        let probes = Tensor::cat(&[&probe, &(-&probe)], 0);
        let copies = (states.unsqueeze(1) + probes).reshape([-1, state_size]);
        let actions = self.actions.each_repeated(2 * state_size);
        let ends =
            self.weighted(&self.roll_out(unconstrained, &copies, &actions), 1).reshape([clips, 2, state_size, -1]);
        let by_state = quotient(ends.select(1, 0), ends.select(1, 1)).transpose(1, 2);
        let steps = Tensor::eye(parameters, (Kind::Double, states.device())) * PROBE;
        let mut shared: Vec<Tensor> = (0..parameters)
            .map(|p| {
                let step = steps.get(p);
                let shifted =
                    |unconstrained: Tensor| self.weighted(&self.roll_out(&unconstrained, states, self.actions), 1);
                // Without a derivative a parameter stays where it is.
                let learned = f64::from(self.learned[p as usize]);
                (quotient(shifted(unconstrained + &step), shifted(unconstrained - &step)) * learned).unsqueeze(-1)
            })
            .collect();
        let coordinates = offsets.size()[0];
        let free = f64::from(self.free_offsets);
        let by_offset =
            Tensor::eye(coordinates, (Kind::Double, states.device())).repeat([self.horizon as i64, 1]) * free;
        let by_offset = self.weighted(&by_offset, 0);
        shared.push(by_offset.unsqueeze(0).expand([clips, -1, -1], false));
        Linearisation { residual: self.residual(unknowns), by_state, by_shared: Tensor::cat(&shared, 2) }
    }

    /// The normal equations of the shared unknowns with each clip's states eliminated.
    fn eliminate(&self, at: &Linearisation, unknowns: &FitUnknowns, damping: f64) -> Eliminated {
        let weight = self.masked(self.huber / at.residual.abs().clamp_min(self.huber)).unsqueeze(-1);
        let weighted = |j: &Tensor| (j * &weight).transpose(1, 2);
        let damped = |normal: Tensor| {
            let diagonal = normal.diagonal(0, -2, -1);
            // What shows in no position is held, however large the other numbers are.
            let held = diagonal.amax([-1i64].as_slice(), true) * LEAST_HELD + 1e-9;
            let added = diagonal * damping + held;
            normal + added.diag_embed(0, -2, -1)
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
        let ridge = Tensor::cat(&[unknowns.unconstrained.zeros_like(), unknowns.offsets.full_like(self.ridge())], 0);
        let normal = damped(over_clips(w_shared.bmm(&at.by_shared)) + ridge.diag_embed(0, -2, -1))
            - over_clips(state_shared.transpose(1, 2).bmm(&a_b));
        let gradients = (w_shared.bmm(&residual) - state_shared.transpose(1, 2).bmm(&a_g)).squeeze_dim(-1);
        let held = Tensor::cat(&[unknowns.unconstrained.zeros_like(), &unknowns.offsets * self.ridge()], 0);
        Eliminated { normal, gradients, held, a_b, a_g }
    }

    /// The damped Gauss-Newton step: changes of the shared unknowns and of the states.
    fn step(&self, at: &Linearisation, unknowns: &FitUnknowns, damping: f64) -> (Tensor, Tensor) {
        let Eliminated { normal, gradients, held, a_b, a_g } = self.eliminate(at, unknowns, damping);
        let gradient = gradients.sum_dim_intlist([0i64].as_slice(), false, None) + held;
        let mut shared = -Tensor::linalg_solve(&normal, &gradient, true);
        let parameters = unknowns.unconstrained.size()[0];
        let largest = if parameters > 0 { shared.narrow(0, 0, parameters).abs().max().double_value(&[]) } else { 0.0 };
        if largest > LARGEST_RAW_STEP {
            shared *= LARGEST_RAW_STEP / largest;
        }
        let states = -(a_g + a_b.matmul(&shared.unsqueeze(-1))).squeeze_dim(-1);
        (shared, states)
    }

    /// How well the unconstrained parameters are known.
    ///
    /// Standard deviations: the inverse of the normal equations around the scatter of the clips' gradients, which need not
    /// be of independent residuals; of no more clips than shared unknowns, as if the residuals were. Curvature: the normal
    /// equations with the offsets eliminated, too.
    fn certainty(&self, unknowns: &FitUnknowns) -> (Vec<f64>, Tensor) {
        let at = self.linearise(unknowns);
        let Eliminated { normal, gradients, .. } = self.eliminate(&at, unknowns, 0.0);
        let (parameters, offsets) = (unknowns.unconstrained.size()[0], unknowns.offsets.size()[0]);
        let clips = gradients.size()[0] as f64;
        let free = self.learned.iter().filter(|learned| **learned).count() as i64
            + if self.free_offsets { offsets } else { 0 };
        let spare = clips - free as f64;
        let scatter = if spare > 0.0 {
            // At their least cost the gradients add up to nothing: so many of them are not free.
            gradients.transpose(0, 1).matmul(&gradients) * (clips / spare)
        } else {
            &normal * self.variance(&at.residual)
        };
        let half = Tensor::linalg_solve(&normal, &scatter, true);
        let covariance = Tensor::linalg_solve(&normal, &half.transpose(0, 1), true);
        let deviations = covariance.diagonal(0, 0, 1).clamp_min(0.0).sqrt() * self.too_steep(&at.residual);
        // Nothing is known of one without a derivative: what stands for it there only holds it in place.
        let shows = at.by_shared.narrow(2, 0, parameters).abs().amax([0i64, 1].as_slice(), false).gt(0.0);
        let deviations = (0..parameters).map(|place| match self.learned[place as usize] {
            true if shows.int64_value(&[place]) == 0 => f64::INFINITY,
            true => deviations.double_value(&[place]),
            false => 0.0,
        });
        let rows = normal.narrow(0, 0, parameters);
        let (own, mixed) = (rows.narrow(1, 0, parameters), rows.narrow(1, parameters, offsets));
        let of_offsets = normal.narrow(0, parameters, offsets).narrow(1, parameters, offsets);
        let curvature = own - mixed.matmul(&Tensor::linalg_solve(&of_offsets, &mixed.transpose(0, 1), true));
        let curvature = curvature * shows.unsqueeze(0) * shows.unsqueeze(1);
        (deviations.collect(), curvature)
    }

    /// Mean square of the residuals that count, of those beyond the Huber loss's limit no more than that.
    fn variance(&self, residual: &Tensor) -> f64 {
        let counted = self.masked(residual.ones_like()).sum(Kind::Double).clamp_min(1.0);
        let square = residual.clamp(-self.huber, self.huber).square();
        (self.masked(square).sum(Kind::Double) / counted).double_value(&[])
    }

    /// How much steeper the normal equations are than the Huber loss, which has no second derivative beyond its limit: they
    /// take residuals there by less weight, the loss not at all (Huber 1964).
    fn too_steep(&self, residual: &Tensor) -> f64 {
        let size = residual.abs();
        let sum = |x: Tensor| self.masked(x).sum(Kind::Double).double_value(&[]);
        let taken = sum(self.huber / size.clamp_min(self.huber));
        taken / sum(size.le(self.huber).to_kind(Kind::Double)).max(1.0)
    }

    /// Iterates until the cost stands still; returns the iterations.
    fn minimise(&self, unknowns: &mut FitUnknowns, max_iterations: usize) -> usize {
        let parameters = unknowns.unconstrained.size()[0];
        let coordinates = unknowns.offsets.size()[0];
        let cost = |unknowns: &FitUnknowns| self.cost(unknowns);
        let linearise = |unknowns: &FitUnknowns| self.linearise(unknowns);
        let step = |unknowns: &FitUnknowns, at: &Linearisation, damping: f64| {
            let (shared, states) = self.step(at, unknowns, damping);
            Some(FitUnknowns {
                unconstrained: &unknowns.unconstrained + shared.narrow(0, 0, parameters),
                offsets: &unknowns.offsets + shared.narrow(0, parameters, coordinates),
                states: &unknowns.states + states,
            })
        };
        least_squares::minimise(unknowns, (max_iterations, CONVERGED), cost, linearise, step)
    }
}
