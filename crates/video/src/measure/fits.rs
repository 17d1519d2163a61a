//! The fits to what was seen: by which measure of the positions, with what is seen beside the state or without, to a colour
//! tracker's positions, and of other equations.

use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use super::Named;
use super::bootstrap;
use super::explain::{Explained, explain};
use super::fit::{Start, Track};
use super::results::Alternative;
use super::shown::{Shown, shown};
use super::sight::Sight;
use super::source::Passed;
use super::subject::Subject;
use paig::network::cells::{CellKind, Coordinates};
use paig::support::statistics::upper_median;

/// Difference of the Bayesian criterion from which on it is believed that something is seen beside the state.
const CLEARLY_BETTER: f64 = 10.0;

/// The encoder strays where it differs from the masks by so many times as much in the frames held out as in those learned
/// from, and by so many pixels of a frame.
const STRAYS: f64 = 3.0;
const LEAST_STRAY: f64 = 0.5;

impl Subject<'_> {
    /// Whether the encoder misreads frames that were held out: it has learned no places but those where the objects were. Masks
    /// follow them anywhere.
    fn encoder_strays(&self, sights: &[Sight]) -> bool {
        sights.iter().enumerate().any(|(video, Sight { encoded, centroids })| {
            let apart =
                encoded.pixels.iter().zip(&centroids.pixels).map(|(encoded, centroid)| (encoded - centroid).abs());
            let apart: Vec<f64> = apart.collect();
            let (learned, held_out) = apart.split_at(2 * self.model.system.objects * self.trained(video));
            let usual = |apart: &[f64]| upper_median(apart.iter().copied()).unwrap_or(0.0);
            usual(held_out) > LEAST_STRAY.max(STRAYS * usual(learned))
        })
    }

    /// The fit to that measure of the positions that the equation explains better; whether it is the encoder's.
    pub(super) fn best_of_sights(
        &self,
        cell: &Arc<CellKind>,
        sights: &[Sight],
    ) -> Result<(Vec<Track>, bool, Explained)> {
        let (dynamics, starts) = (self.dynamics(cell)?, self.starts(cell));
        let by_centroids = self.tracks(sights.iter().map(|sight| &sight.centroids));
        let explained = explain(&dynamics, &by_centroids, &starts)?;
        if self.encoder_strays(sights) {
            let explained = self.with_what_is_beside(&by_centroids, &explained)?.unwrap_or(explained);
            return Ok((by_centroids, false, explained));
        }
        // From where the other measure led to.
        let go_on = [Start { raw: explained.fitted.raw.clone(), ..starts[0].clone() }];
        let by_encoder = self.tracks(sights.iter().map(|sight| &sight.encoded));
        let encoded = explain(&dynamics, &by_encoder, &go_on)?;
        let (tracks, by_encoder, explained) = if encoded.fitted.usual_residual < explained.fitted.usual_residual {
            (by_encoder, true, encoded)
        } else {
            (by_centroids, false, explained)
        };
        let explained = self.with_what_is_beside(&tracks, &explained)?.unwrap_or(explained);
        Ok((tracks, by_encoder, explained))
    }

    /// The same with what is seen beside the state, where that explains clearly more: a camera that drifts, looked for in a task
    /// of one video and one object; or of several objects their middles.
    fn with_what_is_beside(&self, tracks: &[Track], explained: &Explained) -> Result<Option<Explained>> {
        if self.model.system.objects == 1 && tracks.len() != 1 {
            return Ok(None);
        }
        with_what_shows_beside(tracks, explained, self.piece())
    }

    /// The same equation, fitted to what a colour tracker sees.
    pub(super) fn tracker_fit(&self, explained: &Explained, passes: &[Passed]) -> Result<Explained> {
        let system = &self.model.system;
        ensure!(
            system.objects == 1 && system.cell.coordinates == Coordinates::Position,
            "it follows one object, by its position"
        );
        let track = |(video, passed): (usize, &Passed)| Track {
            positions: passed.tracked.iter().flatten().copied().collect(),
            ticks: self.clocks[video].ticks.clone(),
            trained: self.trained(video),
            teaches: self.teaches(video),
        };
        let tracks: Vec<Track> = passes.iter().enumerate().map(track).collect();
        for track in &tracks {
            let missing = track.positions.iter().filter(|x| x.is_nan()).count();
            ensure!(2 * missing < track.positions.len(), "it sees the object in less than half of the frames");
        }
        let start =
            Start { raw: explained.fitted.raw.clone(), learned: explained.learned.clone(), piece: self.piece() };
        explain(&explained.dynamics, &tracks, &[start])
    }

    /// The equation and those it is compared with, fitted to the same positions.
    pub(super) fn alternatives(
        &self,
        main: &Named,
        explained: &Explained,
        against: &[Named],
        tracks: &[Track],
    ) -> Result<Vec<Alternative>> {
        if against.is_empty() {
            return Ok(Vec::new());
        }
        let (times, _) = self.per_coordinate();
        let mut all = vec![(main.name.clone(), explained.clone())];
        for Named { name, cell } in against {
            let explained = explain(&self.dynamics(cell)?, tracks, &self.starts(cell));
            let explained = explained.with_context(|| format!("equation of {name}"))?;
            all.push((name.clone(), self.with_what_is_beside(tracks, &explained)?.unwrap_or(explained)));
        }
        let frames_in_one = frames_in_one_of_best(all.iter().map(|(_, explained)| explained));
        Ok(all
            .into_iter()
            .map(|(name, explained)| {
                let criteria = explained.criteria(frames_in_one);
                Alternative {
                    equation: name,
                    unknowns: criteria.unknowns,
                    residual: times * explained.errors.learned,
                    held_out_error: times * explained.errors.held_out,
                    aic: criteria.aic,
                    bic: criteria.bic,
                    parameters: explained.parameters(&self.scale),
                }
            })
            .collect())
    }
}

/// Frames that together hold as much as one independent one, by the residuals of the equation that leaves least: those of a wrong
/// one hang together for long.
fn frames_in_one_of_best<'a>(all: impl Iterator<Item = &'a Explained>) -> f64 {
    let residual = |explained: &Explained| explained.fitted.usual_residual;
    let best = all.min_by(|a, b| residual(a).total_cmp(&residual(b))).expect("at least the equation itself");
    bootstrap::frames_in_one(&best.fitted, best.dynamics.coordinates())
}

/// The same with as many of the numbers beside the state as show by themselves, if they explain clearly more. One that a parameter
/// or how the motion begins could stand for would be believed for what the others explain.
fn with_what_shows_beside(tracks: &[Track], explained: &Explained, piece: usize) -> Result<Option<Explained>> {
    let (dynamics, first) = (&explained.dynamics, explained.learned.len());
    let numbers = dynamics.numbers_beside();
    if numbers == 0 {
        return Ok(None);
    }
    let raw = [&explained.fitted.raw[..], &vec![0.0; numbers]].concat();
    let mut learned = [&explained.learned[..], &vec![true; numbers]].concat();
    let fitted =
        |learned: &[bool]| explain(dynamics, tracks, &[Start { raw: raw.clone(), learned: learned.to_vec(), piece }]);
    let mut beside = fitted(&learned)?;
    let Some(shown) = shown(dynamics, tracks, &learned, &beside.fitted) else { return Ok(None) };
    (first..learned.len()).for_each(|place| learned[place] = shown[place] == Shown::ByItself);
    if !learned[first..].contains(&true) {
        return Ok(None);
    }
    if learned != beside.learned {
        beside = fitted(&learned)?;
    }
    let frames_in_one = bootstrap::frames_in_one(&beside.fitted, beside.dynamics.coordinates());
    let gain = explained.criteria(frames_in_one).bic - beside.criteria(frames_in_one).bic;
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
        let raw = vec![c.ln(), g.ln()];
        let mut random = named_generator(1, "noise");
        let drifts = [&raw[..], &drift].concat();
        let positions = dynamics.positions(&raw, &[10.0, 6.0, 2.0, 0.0], 0, 72).into_iter().enumerate();
        let seen =
            positions.map(|(place, x)| x + dynamics.beside(&drifts, place / 2, place % 2) + 0.1 * normal(&mut random));
        let tracks = [Track::even(seen.collect(), 2, 72)];
        let start = Start { raw, learned: vec![true; 2], piece: 12 };
        let explained = explain(&dynamics, &tracks, &[start]).unwrap();
        let beside = with_what_shows_beside(&tracks, &explained, 12).unwrap().unwrap();
        assert_eq!(beside.learned, [true, true, true, false]);
        let values = dynamics.values(&beside.fitted.raw);
        // Their deviations are some 0.004 and 0.015. What falls by g and drifts by d looks as what falls by g + c * d.
        assert!(
            (beside.fitted.raw[2] - drift[0]).abs() < 0.05 && beside.fitted.raw[3] == 0.0,
            "{:?}",
            beside.fitted.raw
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
        let positions = drag.positions(&[c.ln(), g.ln()], &[10.0, 6.0, 2.0, 0.0], 0, 72).into_iter();
        let seen = positions.map(|x| x + 0.1 * normal(&mut random)).collect();
        let tracks = [Track::even(seen, 2, 72)];
        let explained = |dynamics: &Dynamics, raw: Vec<f64>| {
            let learned = vec![true; raw.len()];
            explain(dynamics, &tracks, &[Start { raw, learned, piece: 12 }]).unwrap()
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
