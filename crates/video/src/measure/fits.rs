//! The fits to what was observed: by which means, judged by what was held out, then to everything; and of other equations.

use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use super::ComparedEquation;
use super::bootstrap;
use super::dynamics::Dynamics;
use super::explain::{Explained, explain};
use super::fit::{Observations, Start};
use super::identifiability::{Identifiability, shown};
use super::motion::TrackMotion;
use super::recording::{Observation, RecordedSystem, whole};
use super::results::Alternative;
use super::starts::{KnownParameter, starts};
use paig::network::System;
use paig::network::cells::CellKind;

/// Difference of the Bayesian criterion from which on it is believed that something is seen beside the state.
const CLEARLY_BETTER: f64 = 10.0;

/// A recording is explained where a fit leaves at most so many times the noise, or this share of the amplitude, of its
/// positions, and predicts what was held out with an error of at most so many times that.
const EXPLAINED: f64 = 3.0;
const SMALL: f64 = 0.02;
const PREDICTED: f64 = 4.0;

/// An equation fitted to one observation.
#[derive(Debug)]
pub(super) struct Fits {
    /// Place of the observation among those that there were.
    pub observation: usize,
    /// Without what is held out, which judges the fit.
    pub tracks: Vec<Observations>,
    pub judged: Explained,
    /// To everything: what is to be quoted.
    pub whole_tracks: Vec<Observations>,
    pub whole: Explained,
}

impl Fits {
    /// Whether the equation explains the whole recording, the held-out part with it.
    pub fn explain(&self) -> bool {
        explains(&self.judged, &self.whole, &self.whole_tracks[0])
    }
}

/// Whether a fit to the whole of a track leaves little, and one that is judged predicts what was held out of it.
pub(super) fn explains(judged: &Explained, whole: &Explained, track: &Observations) -> bool {
    let TrackMotion { noise, amplitude, .. } = TrackMotion::of(track, whole.dynamics.coordinates());
    let enough = (EXPLAINED * noise).max(SMALL * amplitude);
    whole.fitted.usual_residual <= enough && judged.errors.held_out <= PREDICTED * enough
}

impl RecordedSystem {
    pub(super) fn dynamics(&self, cell: &Arc<CellKind>) -> Result<Dynamics> {
        let system = System { cell: cell.clone(), ..self.system.clone() };
        system.check()?;
        ensure!(
            cell.coordinates == self.system.cell.coordinates,
            "an equation for {:?} cannot be held against one for {:?}",
            cell.coordinates,
            self.system.cell.coordinates
        );
        Dynamics::new(system, self.dt)
    }

    /// The fit of an equation to one of `observations`: to that which it explains best. `known` are the parameters of a run.
    pub(super) fn fits(
        &self,
        cell: &Arc<CellKind>,
        observations: &[Observation],
        known: &[KnownParameter],
    ) -> Result<Fits> {
        let dynamics = self.dynamics(cell)?;
        let own = self.system.cell == *cell;
        let mut best: Option<(usize, Vec<Observations>, Explained)> = None;
        for (place, observation) in observations.iter().enumerate() {
            let tracks = self.tracks(observation);
            let starts = match &best {
                // From where the other measure led to.
                Some((_, _, before)) => {
                    let learned = before.learned.clone();
                    vec![Start { unconstrained: before.fitted.unconstrained.clone(), learned, piece: self.piece }]
                }
                None => starts(&dynamics, &tracks, self.piece, (known, own), None),
            };
            let explained = explain(&dynamics, &tracks, &starts)?;
            let better = |before: &Explained| explained.fitted.usual_residual < before.fitted.usual_residual;
            if best.as_ref().is_none_or(|(_, _, before)| better(before)) {
                best = Some((place, tracks, explained));
            }
        }
        let (observation, tracks, judged) = best.context("nothing was observed")?;
        let judged = self.with_what_is_beside(&tracks, &judged)?.unwrap_or(judged);
        let whole_tracks = whole(&tracks);
        let whole = self.go_on(&judged, &whole_tracks)?;
        Ok(Fits { observation, tracks, judged, whole_tracks, whole })
    }

    /// The same equation fitted to other tracks of the same motion, from where a fit led to.
    pub(super) fn go_on(&self, explained: &Explained, tracks: &[Observations]) -> Result<Explained> {
        let start = Start {
            unconstrained: explained.fitted.unconstrained.clone(),
            learned: explained.learned.clone(),
            piece: self.piece,
        };
        explain(&explained.dynamics, tracks, &[start])
    }

    /// The same with what is seen beside the state, where that explains clearly more: a camera that drifts, looked for in a task
    /// of one video and one object; or of several objects their middles.
    fn with_what_is_beside(&self, tracks: &[Observations], explained: &Explained) -> Result<Option<Explained>> {
        if self.system.objects == 1 && (tracks.len() != 1 || !self.may_drift) {
            return Ok(None);
        }
        with_what_shows_beside(tracks, explained, self.piece)
    }

    /// Other equations, fitted to the same positions.
    pub(super) fn others(
        &self,
        against: &[ComparedEquation],
        tracks: &[Observations],
        known: &[KnownParameter],
    ) -> Result<Vec<(String, Explained)>> {
        let fitted = |ComparedEquation { name, cell }: &ComparedEquation| {
            let dynamics = self.dynamics(cell)?;
            let starts = starts(&dynamics, tracks, self.piece, (known, self.system.cell == *cell), None);
            let explained = explain(&dynamics, tracks, &starts);
            let explained = explained.with_context(|| format!("equation of {name}"))?;
            Ok((name.clone(), self.with_what_is_beside(tracks, &explained)?.unwrap_or(explained)))
        };
        against.iter().map(fitted).collect()
    }

    /// The equation and those it is compared with, side by side; none where it is compared with none.
    pub(super) fn alternatives(&self, main: (String, Explained), others: Vec<(String, Explained)>) -> Vec<Alternative> {
        if others.is_empty() {
            return Vec::new();
        }
        let (times, _) = self.per_coordinate();
        let all: Vec<_> = std::iter::once(main).chain(others).collect();
        let frames_in_one = frames_in_one_of_best(all.iter().map(|(_, explained)| explained));
        let alternative = |(name, explained): (String, Explained)| {
            let criteria = explained.criteria(frames_in_one, self.systematic_error());
            Alternative {
                equation: name,
                unknowns: criteria.unknowns,
                residual: times * explained.errors.learned,
                held_out_error: times * explained.errors.held_out,
                aic: criteria.aic,
                bic: criteria.bic,
                parameters: explained.parameters(&self.scale),
            }
        };
        all.into_iter().map(alternative).collect()
    }
}

/// Frames that together hold as much as one independent one, by the residuals of the equation that leaves least: those of a wrong
/// one hang together for long.
pub(super) fn frames_in_one_of_best<'a>(all: impl Iterator<Item = &'a Explained>) -> f64 {
    let residual = |explained: &Explained| explained.fitted.usual_residual;
    let best = all.min_by(|a, b| residual(a).total_cmp(&residual(b))).expect("at least the equation itself");
    bootstrap::frames_in_one(&best.fitted)
}

/// The same with as many of the numbers beside the state as show by themselves, if they explain clearly more. One that a parameter
/// or how the motion begins could stand for would be believed for what the others explain.
fn with_what_shows_beside(tracks: &[Observations], explained: &Explained, piece: usize) -> Result<Option<Explained>> {
    let (dynamics, first) = (&explained.dynamics, explained.learned.len());
    let numbers = dynamics.numbers_beside();
    if numbers == 0 {
        return Ok(None);
    }
    let unconstrained = [&explained.fitted.unconstrained[..], &vec![0.0; numbers]].concat();
    let mut learned = [&explained.learned[..], &vec![true; numbers]].concat();
    let fitted = |learned: &[bool]| {
        explain(dynamics, tracks, &[Start { unconstrained: unconstrained.clone(), learned: learned.to_vec(), piece }])
    };
    let mut beside = fitted(&learned)?;
    let Some(shown) = shown(dynamics, tracks, &learned, &beside.fitted) else { return Ok(None) };
    (first..learned.len()).for_each(|place| learned[place] = shown[place] == Identifiability::ByItself);
    if !learned[first..].contains(&true) {
        return Ok(None);
    }
    if learned != beside.learned {
        beside = fitted(&learned)?;
    }
    let frames_in_one = bootstrap::frames_in_one(&beside.fitted);
    let gain = explained.criteria(frames_in_one, 0.0).bic - beside.criteria(frames_in_one, 0.0).bic;
    Ok((gain > CLEARLY_BETTER).then_some(beside))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::dynamics::Dynamics;
    use paig::support::random::{named_generator, normal};
    use paig::tasks::Task;

    /// A fall through what resists, before a camera that drifts. Along x the drift shows; along y g does the same, with the speed
    /// at the beginning, so that drift is not believed.
    #[test]
    fn a_drift_that_is_one_with_a_parameter_is_not_believed() {
        let system = Task::from_toml(include_str!("../../../../configs/gallery/fall_linear_drag.toml")).unwrap().system;
        let dynamics = Dynamics::new(system, 0.3).unwrap();
        let (c, g, drift) = (0.3_f64, 1.5_f64, [0.5, -0.5]);
        let unconstrained = vec![c.ln(), g.ln()];
        let mut random = named_generator(1, "noise");
        let drifts = [&unconstrained[..], &drift].concat();
        let times = dynamics.even_times(72);
        let positions = dynamics.positions(&unconstrained, &[10.0, 6.0, 2.0, 0.0], &times).into_iter().enumerate();
        let seen = positions
            .map(|(place, x)| x + dynamics.beside(&drifts, times[place / 2], place % 2) + 0.1 * normal(&mut random));
        let tracks = [Observations::new(seen.collect(), times.clone(), 72)];
        let start = Start { unconstrained, learned: vec![true; 2], piece: 12 };
        let explained = explain(&dynamics, &tracks, &[start]).unwrap();
        let beside = with_what_shows_beside(&tracks, &explained, 12).unwrap().unwrap();
        assert_eq!(beside.learned, [true, true, true, false]);
        let values = dynamics.values(&beside.fitted.unconstrained);
        // Their deviations are some 0.004 and 0.015. What falls by g and drifts by d looks as what falls by g + c * d.
        assert!(
            (beside.fitted.unconstrained[2] - drift[0]).abs() < 0.05 && beside.fitted.unconstrained[3] == 0.0,
            "{:?}",
            beside.fitted.unconstrained
        );
        assert!((values[1] - (g + c * drift[1])).abs() < 0.1, "{values:?}");
    }

    /// A fall through what resists, fitted without the resistance and with it.
    #[test]
    fn criteria_take_the_residuals_of_the_equation_that_leaves_least() {
        let drag = Task::from_toml(include_str!("../../../../configs/gallery/fall_linear_drag.toml")).unwrap().system;
        let free = Task::from_toml(include_str!("../../../../configs/tasks/falling.toml")).unwrap().system;
        let [drag, free] = [drag, free].map(|system| Dynamics::new(system, 0.3).unwrap());
        let (c, g) = (0.3_f64, 1.5_f64);
        let mut random = named_generator(1, "noise");
        let times = drag.even_times(72);
        let positions = drag.positions(&[c.ln(), g.ln()], &[10.0, 6.0, 2.0, 0.0], &times).into_iter();
        let seen = positions.map(|x| x + 0.1 * normal(&mut random)).collect();
        let tracks = [Observations::new(seen, times, 72)];
        let explained = |dynamics: &Dynamics, unconstrained: Vec<f64>| {
            let learned = vec![true; unconstrained.len()];
            explain(dynamics, &tracks, &[Start { unconstrained, learned, piece: 12 }]).unwrap()
        };
        let (right, wrong) = (explained(&drag, vec![c.ln(), g.ln()]), explained(&free, vec![g.ln()]));
        let alone = |of: &Explained| frames_in_one_of_best([of].into_iter());
        // The noise is drawn for each frame; the resistance that is missing lasts.
        assert!(alone(&right) < 2.0 && alone(&wrong) > 4.0, "{} {}", alone(&right), alone(&wrong));
        for all in [[&right, &wrong], [&wrong, &right]] {
            assert_eq!(frames_in_one_of_best(all.into_iter()), alone(&right));
        }
    }
}
