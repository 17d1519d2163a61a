//! How well a fit knows what it found: a block bootstrap over time of its residuals.
//!
//! Residuals of neighbouring frames go together, so that a curvature alone promises far too much. Blocks of residuals, as
//! long as they go together, are drawn anew and put onto the fitted motion; what the fit would have found then, to first
//! order, is one draw. The draws are widened for what the fit itself has used up of the residuals, by Student's t over as
//! many residuals as there are independent ones.
//!
//! That takes residuals to be alike over the whole motion. Where the equation lacks something they are not: then a part of the
//! recording says something else than the rest, and the delete-a-part jackknife gives the wider interval, which counts.
//!
//! Künsch 1989 (moving blocks, jackknife of dependent observations), Politis and Romano 1992 (circular blocks).

use anyhow::{Context, Result};
use nalgebra::{DMatrix, DVector};
use rand::Rng;
use statrs::distribution::{ContinuousCDF, StudentsT};
use tch::Tensor;

use super::dynamics::Dynamics;
use super::errors::Errors;
use super::fit::{Fitted, Observations, Problem};
use super::identifiability::{Identifiability, jacobian, of_unknowns};
use super::normal_equations::NormalEquations;
use paig::network::cells::Bounds;
use paig::support::random::{named_generator, normal};

/// Draws of what might have been found.
pub const DRAWS: usize = 600;
/// Part of a video that a block takes at most.
const LONGEST_BLOCK: usize = 4;
/// A correlation smaller than so many of its own standard deviations is chance.
const CHANCE: f64 = 2.0;
/// Lags of the autocorrelation that are kept.
const KEPT_LAGS: usize = 60;
/// How near a draw comes to a bound, as a share of the value's own distance from it.
const NEAR_BOUND: f64 = 1e-3;
/// Parts of the jackknife, and the ratio of its variance to the bootstrap's beyond which that is no chance: the 95 % quantile of
/// chi-squared over its degrees of freedom.
const PARTS: usize = 6;
const NO_CHANCE: f64 = 2.21;
/// A smallest number of independent residuals beyond the unknowns, so that there is a width at all.
const LEAST_FREE: f64 = 4.0;
/// 97.5 % quantile of normal numbers.
const NORMAL_QUANTILE: f64 = 1.959964;

/// What the residuals say.
#[derive(Debug)]
pub struct Uncertainty {
    /// Correlation of residuals so many frames apart, from 1 frame on.
    pub autocorrelation: Vec<f64>,
    /// Frames that together hold as much as one independent one.
    pub frames_in_one: f64,
    /// Frames of a block.
    pub block: usize,
    /// Of each unconstrained parameter. The draws of what does not show by itself say nothing.
    pub shown: Vec<Identifiability>,
    /// Second derivatives of the cost by the unconstrained parameters that are learned, all states following.
    pub curvature: Tensor,
    /// What might have been found.
    pub draws: Vec<BootstrapSample>,
}

/// One of the things that might have been found.
#[derive(Debug, Clone, PartialEq)]
pub struct BootstrapSample {
    /// Raw numbers of all parameters.
    pub unconstrained: Vec<f64>,
    /// Of each video that teaches, at its first frame.
    pub states: Vec<Vec<f64>>,
    /// Normal numbers that stand for the errors of scale and time.
    pub scale: f64,
    pub time: f64,
}

/// Draws of a fit.
///
/// # Errors
/// A motion that says nothing of some unknown.
pub fn bootstrap(
    dynamics: &Dynamics,
    tracks: &[Observations],
    learned: &[bool],
    fitted: &Fitted,
    seed: u64,
) -> Result<Uncertainty> {
    let problem = Problem::new(dynamics, tracks, learned);
    let coordinates = dynamics.coordinates();
    let bounded = bounded(fitted);
    let jacobian = jacobian(&problem, fitted);
    let counted = fitted.residuals.iter().flatten().filter(|x| x.abs() <= fitted.huber).count() as f64;
    let all: usize = fitted.residuals.iter().map(Vec::len).sum();
    let share = counted / all as f64;
    let normal_matrix = jacobian.transpose() * &jacobian * share;
    let equations = NormalEquations::new(&normal_matrix).context("the motion does not tell all unknowns apart")?;
    let inverse = equations.inverse();
    let longest = problem.tracks.iter().map(|track| track.trained).max().unwrap_or(1);
    let (autocorrelation, frames_in_one, reach) = autocorrelation(&bounded);
    let least = (longest as f64).cbrt().ceil() as usize;
    let block = (2 * reach).max(least).min((longest / LONGEST_BLOCK).max(1));
    let seen = |it: &&Observations| it.positions[..it.trained * coordinates].iter().filter(|x| !x.is_nan()).count();
    let seen: usize = problem.tracks.iter().map(seen).sum();
    let errors = Errors::likely(&jacobian, &bounded);
    let independent: f64 = errors.frames_in_one().map(|frames| seen as f64 / coordinates as f64 / frames).sum();
    let free = (independent - jacobian.ncols() as f64).max(LEAST_FREE);
    let quantile = StudentsT::new(0.0, 1.0, free)?.inverse_cdf(0.975) / NORMAL_QUANTILE;
    let expected = errors.variances(&jacobian, &inverse);
    let mut random = named_generator(seed, "block bootstrap");
    let to_unknowns = &inverse * jacobian.transpose();
    let changes: Vec<_> = (0..DRAWS).map(|_| &to_unknowns * resampled(&bounded, block, &mut random)).collect();
    let count = problem.learned.len();
    let drawn = |unknown: usize| changes.iter().map(|change| change[unknown].powi(2)).sum::<f64>() / DRAWS as f64;
    let shown = of_unknowns(&problem, fitted, &jacobian, &equations);
    let by_itself = (0..count).filter(|unknown| shown[problem.learned[*unknown]] == Identifiability::ByItself);
    let narrow = by_itself.map(|unknown| expected[unknown] / drawn(unknown)).filter(|ratio| ratio.is_finite());
    let widened = quantile * narrow.fold(1.0, f64::max).sqrt();
    let by_parts = jackknife(&jacobian, &stacked(&bounded), share);
    let of_parts = StudentsT::new(0.0, 1.0, (PARTS - 1) as f64)?.inverse_cdf(0.975) / NORMAL_QUANTILE;
    let widened = DVector::from_fn(jacobian.ncols(), |unknown, _| {
        let ratio = by_parts.as_ref().map_or(0.0, |variances| variances[unknown] / drawn(unknown));
        if ratio > NO_CHANCE { widened.max(of_parts * ratio.sqrt()) } else { widened }
    });
    let draws = changes.into_iter().map(|change| {
        draw(&problem, fitted, &change.component_mul(&widened), [normal(&mut random), normal(&mut random)])
    });
    let draws = draws.collect();
    let curvature = curvature(&normal_matrix, count);
    Ok(Uncertainty { autocorrelation, frames_in_one, block, shown, curvature, draws })
}

/// Frames that together hold as much as one independent one.
pub fn frames_in_one(fitted: &Fitted) -> f64 {
    autocorrelation(&bounded(fitted)).1
}

/// Residuals of each video, `[coordinates, frames]`. What counted linearly in the fit does so here.
fn bounded(fitted: &Fitted) -> Vec<DMatrix<f64>> {
    let coordinates = fitted.coordinate_weights.len();
    let of_video = |residuals: &Vec<f64>| {
        let bounded = residuals.iter().map(|x| x.clamp(-fitted.huber, fitted.huber));
        DMatrix::from_iterator(coordinates, residuals.len() / coordinates, bounded)
    };
    fitted.residuals.iter().map(of_video).collect()
}

/// Residuals of all videos in a row.
fn stacked(residuals: &[DMatrix<f64>]) -> DVector<f64> {
    DVector::from_iterator(residuals.iter().map(DMatrix::len).sum(), residuals.iter().flat_map(|of| of.iter().copied()))
}

/// Variances of the unknowns by their changes, to first order, when one part of the residuals after the other is left out; none
/// where a part alone says what an unknown is. `share` of the residuals count by their squares.
fn jackknife(jacobian: &DMatrix<f64>, residuals: &DVector<f64>, share: f64) -> Option<DVector<f64>> {
    let rows = jacobian.nrows();
    let normal = jacobian.transpose() * jacobian;
    let change = |part: usize| {
        let (from, to) = (part * rows / PARTS, (part + 1) * rows / PARTS);
        let (own, left) = (jacobian.rows(from, to - from), residuals.rows(from, to - from));
        let equations = NormalEquations::new(&((&normal - own.transpose() * own) * share))?;
        Some(equations.inverse() * own.transpose() * left)
    };
    let changes: Vec<DVector<f64>> = (0..PARTS).map(change).collect::<Option<_>>()?;
    let mean = changes.iter().sum::<DVector<f64>>() / PARTS as f64;
    let squares = changes.iter().map(|change| (change - &mean).map(|it| it * it)).sum::<DVector<f64>>();
    Some(squares * ((PARTS - 1) as f64 / PARTS as f64))
}

fn draw(problem: &Problem, fitted: &Fitted, change: &DVector<f64>, [scale, time]: [f64; 2]) -> BootstrapSample {
    let (mut unconstrained, mut states) = (fitted.unconstrained.clone(), fitted.states.clone());
    let mut change = change.iter();
    problem.learned.iter().zip(&mut change).for_each(|(place, change)| {
        unconstrained[*place] = match problem.dynamics.system.cell.parameters.get(*place) {
            Some(kind) => changed(kind.bounds, unconstrained[*place], *change),
            None => unconstrained[*place] + change,
        };
    });
    states.iter_mut().flatten().zip(change).for_each(|(state, change)| *state += change);
    BootstrapSample { unconstrained, states, scale, time }
}

/// An unconstrained parameter after a change that is linear in the parameter's value, as far as its bounds allow: a friction
/// that is nearly nothing is known by its size, not by its logarithm.
fn changed(bounds: Bounds, unconstrained: f64, change: f64) -> f64 {
    let value = bounds.value(unconstrained);
    let linear = value + bounds.slope(unconstrained) * change;
    let (low, high) = match bounds {
        Bounds::Above(low) => (low, f64::INFINITY),
        Bounds::Between(low, high) => (low, high),
    };
    bounds
        .unconstrained(linear.clamp(low + NEAR_BOUND * (value - low), high - NEAR_BOUND * (high - value).min(f64::MAX)))
}

/// The normal equations of the first unknowns, the others eliminated.
fn curvature(normal: &DMatrix<f64>, count: usize) -> Tensor {
    let others = normal.nrows() - count;
    let own = normal.view((0, 0), (count, count)).into_owned();
    let mixed = normal.view((count, 0), (others, count)).into_owned();
    let rest = normal.view((count, count), (others, others)).into_owned();
    let left = match rest.cholesky() {
        Some(factor) => own - mixed.transpose() * factor.solve(&mixed),
        None => own,
    };
    Tensor::from_slice(left.as_slice()).reshape([count as i64, count as i64])
}

/// Correlations of residuals `[coordinates, frames]` of each video from 1 frame apart on, how many frames hold as much as
/// one independent one, and the lag up to which correlations are more than chance.
fn autocorrelation(residuals: &[DMatrix<f64>]) -> (Vec<f64>, f64, usize) {
    let longest = residuals.iter().map(DMatrix::ncols).max().unwrap_or(0);
    let frames: usize = residuals.iter().map(DMatrix::ncols).sum();
    let mean = |lag: usize| {
        let products = residuals.iter().flat_map(|of| {
            let pairs = of.ncols().saturating_sub(lag);
            (0..pairs).map(move |frame| of.column(frame).dot(&of.column(frame + lag)))
        });
        products.sum::<f64>() / frames as f64
    };
    let variance = mean(0);
    if variance <= 0.0 {
        return (Vec::new(), 1.0, 1);
    }
    let chance = CHANCE / (frames as f64).sqrt();
    let correlations: Vec<f64> = (1..=longest / LONGEST_BLOCK).map(|lag| mean(lag) / variance).collect();
    let reach = correlations.iter().position(|correlation| *correlation < chance).unwrap_or(correlations.len());
    let frames_in_one = 1.0 + 2.0 * correlations[..reach].iter().sum::<f64>();
    (correlations.into_iter().take(KEPT_LAGS).collect(), frames_in_one, reach + 1)
}

/// Residuals of all videos in a row, made of blocks that are drawn from each video as if it went round.
fn resampled(residuals: &[DMatrix<f64>], block: usize, random: &mut impl Rng) -> DVector<f64> {
    let mut drawn = Vec::with_capacity(residuals.iter().map(DMatrix::len).sum());
    for of in residuals {
        let frames = of.ncols();
        for start in (0..frames).step_by(block.max(1)) {
            let from = random.random_range(0..frames);
            for frame in 0..block.min(frames - start) {
                drawn.extend(of.column((from + frame) % frames).iter());
            }
        }
    }
    DVector::from_vec(drawn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::fit::{Start, fit};
    use paig::tasks::Task;

    #[test]
    fn independent_residuals_are_told_from_a_running_mean() {
        let mut random = named_generator(3, "residuals");
        let noise: Vec<f64> = (0..4000).map(|_| normal(&mut random)).collect();
        let white = DMatrix::from_vec(1, 4000, noise.clone());
        let (correlations, frames, _) = autocorrelation(&[white]);
        assert!(correlations[0].abs() < 0.05 && (frames - 1.0).abs() < 0.2, "{correlations:?} {frames}");
        // Each the mean of 5: correlations of 0.8, 0.6, 0.4, 0.2, so 1 + 2 * 2 frames hold as much as one.
        let means: Vec<f64> = noise.windows(5).map(|window| window.iter().sum::<f64>() / 5.0).collect();
        let (correlations, frames, reach) = autocorrelation(&[DMatrix::from_vec(1, means.len(), means)]);
        assert!((correlations[0] - 0.8).abs() < 0.05 && (frames - 5.0).abs() < 0.6, "{correlations:?} {frames}");
        assert!((5..=7).contains(&reach), "{reach}");
    }

    /// A ball that falls, and a floor that it does not reach: of what the floor is like nothing shows, of g it does.
    #[test]
    fn what_does_not_show_is_told() {
        let task = Task::from_toml(include_str!("../../../../configs/gallery/bounce_on_a_floor.toml")).unwrap();
        let dynamics = Dynamics::new(task.system.clone(), 0.1).unwrap();
        let parameters = &task.system.cell.parameters;
        let unconstrained: Vec<f64> =
            parameters.iter().map(|it| it.bounds.unconstrained(task.truth_of(&it.name).unwrap())).collect();
        let times = dynamics.even_times(24);
        let positions = dynamics.positions(&unconstrained, &[16.0, 5.0, 1.0, 0.0], &times);
        let mut random = named_generator(1, "noise");
        let seen = positions.iter().map(|x| x + 0.05 * normal(&mut random)).collect();
        let (tracks, learned) = ([Observations::new(seen, times, 24)], vec![true; unconstrained.len()]);
        let start = Start { unconstrained, learned: learned.clone(), piece: 12 };
        let fitted = fit(&dynamics, &tracks, &start).unwrap();
        let uncertainty = bootstrap(&dynamics, &tracks, &learned, &fitted, 0).unwrap();
        for (parameter, shown) in parameters.iter().zip(uncertainty.shown) {
            let expected = if parameter.name == "g" { Identifiability::ByItself } else { Identifiability::Not };
            assert_eq!(shown, expected, "{}", parameter.name);
        }
    }

    /// Of the mean of n numbers, that without a part has the difference of means, to all orders.
    #[test]
    fn a_mean_changes_as_its_parts_say() {
        let values: Vec<f64> = (0..60).map(|k| (k as f64 * 0.7).sin() + f64::from(k >= 50)).collect();
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let all = mean(&values);
        let without = |part: usize| {
            let kept: Vec<f64> = (0..60).filter(|k| k / 10 != part).map(|k| values[k]).collect();
            mean(&kept)
        };
        let means: Vec<f64> = (0..PARTS).map(without).collect();
        let middle = mean(&means);
        let expected = means.iter().map(|it| (it - middle).powi(2)).sum::<f64>() * 5.0 / 6.0;
        let residuals = DVector::from_iterator(60, values.iter().map(|value| value - all));
        let variance = jackknife(&DMatrix::from_element(60, 1, 1.0), &residuals, 1.0).unwrap()[0];
        // The ridge of the normal equations is 1e-11 of them.
        assert!((variance / expected - 1.0).abs() < 1e-9, "{variance} {expected}");
    }
}
