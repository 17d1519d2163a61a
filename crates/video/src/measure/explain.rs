//! One equation and what is seen of some videos: the fit, the prediction of what was held out, and how good both are.

use anyhow::{Context, Result, bail};

use super::dynamics::Dynamics;
use super::fit::{Fitted, Observations, Start, fit, refit};

/// A fit and what it predicts.
#[derive(Debug, Clone)]
pub struct Explained {
    pub dynamics: Dynamics,
    pub learned: Vec<bool>,
    pub fitted: Fitted,
    /// Of each video: rolled out from its first frame to its last, positions and then velocities, frame by frame.
    pub states: Vec<Vec<f64>>,
    pub errors: RollOutErrors,
}

/// Root mean squares over frames and objects of the distance between seen and rolled-out positions, in the unit of a
/// coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RollOutErrors {
    /// Of the frames that taught.
    pub learned: f64,
    /// Of those that were held out.
    pub held_out: f64,
}

/// Over a whole video a good fit leaves at most so many times what it leaves over short pieces.
const GOOD: f64 = 1.5;

/// Fits from one start after the other until a fit is good, and keeps what leaves least. What videos too short for pieces leave
/// is compared with nothing: of those all starts are tried.
///
/// # Errors
/// No start that leads anywhere.
pub fn explain(dynamics: &Dynamics, tracks: &[Observations], starts: &[Start]) -> Result<Explained> {
    let good = |fitted: &Fitted| fitted.piecewise_residual.is_some_and(|least| fitted.usual_residual <= GOOD * least);
    let mut best: Option<(Fitted, &Start)> = None;
    let mut failure = None;
    for start in starts {
        if best.as_ref().is_some_and(|(best, _)| good(best)) {
            break;
        }
        match fit(dynamics, tracks, start) {
            Ok(fitted) if best.as_ref().is_none_or(|(best, _)| fitted.usual_residual < best.usual_residual) => {
                best = Some((fitted, start));
            }
            Ok(_) => {}
            Err(error) => failure = Some(error),
        }
    }
    let Some((fitted, start)) = best else {
        match failure {
            Some(error) => return Err(error),
            None => bail!("a fit needs a start"),
        }
    };
    rolled_out(dynamics, tracks, fitted, (&start.learned, start.piece))
}

/// The same equation fitted to slightly other positions, from where a fit led to. `piece` is that of a [`Start`].
///
/// # Errors
/// An equation that leads to infinity.
pub fn explain_again(before: &Explained, tracks: &[Observations], piece: usize) -> Result<Explained> {
    let fitted = refit(&before.dynamics, tracks, &before.learned, &before.fitted)?;
    rolled_out(&before.dynamics, tracks, fitted, (&before.learned, piece))
}

/// A fit with its roll-outs and errors.
fn rolled_out(
    dynamics: &Dynamics,
    tracks: &[Observations],
    fitted: Fitted,
    (learned, piece): (&[bool], usize),
) -> Result<Explained> {
    let coordinates = dynamics.coordinates();
    let mut found = fitted.states.iter();
    let rolled_out = |track: &Observations| -> Result<Vec<f64>> {
        let state = match track.teaches {
            true => found.next().expect("a state of each video that teaches").clone(),
            false => begin(dynamics, track, &fitted.unconstrained, piece)?,
        };
        Ok(dynamics.roll_out(&fitted.unconstrained, &state, &track.times))
    };
    let states = tracks.iter().map(rolled_out).collect::<Result<Vec<_>>>()?;
    let at_frames = |(track, states): (&Observations, &Vec<f64>)| {
        let mut positions = positions_of(states, coordinates);
        for (frame, time) in track.times.iter().enumerate() {
            for coordinate in 0..coordinates {
                positions[frame * coordinates + coordinate] +=
                    dynamics.beside(&fitted.unconstrained, *time, coordinate);
            }
        }
        positions
    };
    let positions: Vec<_> = tracks.iter().zip(&states).map(at_frames).collect();
    let errors = RollOutErrors::of(tracks, &positions, dynamics);
    Ok(Explained { dynamics: dynamics.clone(), learned: learned.to_vec(), fitted, states, errors })
}

/// The state in which a video that teaches nothing begins, the unconstrained parameters as they are.
fn begin(dynamics: &Dynamics, track: &Observations, unconstrained: &[f64], piece: usize) -> Result<Vec<f64>> {
    let alone = [Observations { teaches: true, ..track.clone() }];
    let start = Start { unconstrained: unconstrained.to_vec(), learned: vec![false; unconstrained.len()], piece };
    let fitted = fit(dynamics, &alone, &start).context("how a video that was held out whole begins")?;
    Ok(fitted.states.concat())
}

/// The positions of states.
pub fn positions_of(states: &[f64], coordinates: usize) -> Vec<f64> {
    states.chunks(2 * coordinates).flat_map(|state| &state[..coordinates]).copied().collect()
}

impl RollOutErrors {
    /// Of predictions, positions frame by frame of each video.
    pub fn of(tracks: &[Observations], predicted: &[Vec<f64>], dynamics: &Dynamics) -> Self {
        let per_object = dynamics.system.cell.coordinates.per_object();
        let coordinates = dynamics.coordinates();
        let mean = |held_out: bool| {
            let (mut sum, mut count) = (0.0, 0);
            for (track, predicted) in tracks.iter().zip(predicted).filter(|(track, _)| held_out || track.teaches) {
                let first = track.trained * coordinates;
                let range = if held_out { first..track.positions.len() } else { 0..first };
                let pairs = track.positions[range.clone()].chunks(per_object).zip(predicted[range].chunks(per_object));
                for (seen, predicted) in pairs.filter(|(seen, _)| seen.iter().all(|x| !x.is_nan())) {
                    sum += seen.iter().zip(predicted).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
                    count += 1;
                }
            }
            (sum / f64::from(count.max(1))).sqrt()
        };
        RollOutErrors { learned: mean(false), held_out: mean(true) }
    }
}

/// Frames through which the straight line of constant velocity goes.
const LINE: usize = 5;

/// What constant velocity predicts: the straight line through the last frames that may be learned from. Positions of all
/// frames of each video; those that were learned from as they were seen.
pub fn constant_velocity(tracks: &[Observations], coordinates: usize) -> Vec<Vec<f64>> {
    let of_track = |track: &Observations| {
        let mut positions = track.positions.clone();
        let first = track.trained.saturating_sub(LINE);
        for coordinate in 0..coordinates {
            let points = (first..track.trained)
                .map(|frame| (track.times[frame], track.positions[frame * coordinates + coordinate]));
            let points: Vec<_> = points.filter(|(_, x)| !x.is_nan()).collect();
            let (level, slope, middle) = line(&points);
            for frame in track.trained..positions.len() / coordinates {
                positions[frame * coordinates + coordinate] = level + slope * (track.times[frame] - middle);
            }
        }
        positions
    };
    tracks.iter().map(of_track).collect()
}

/// Mean value, slope and mean place of points.
fn line(points: &[(f64, f64)]) -> (f64, f64, f64) {
    let count = points.len().max(1) as f64;
    let (middle, level) = points.iter().fold((0.0, 0.0), |(m, l), (t, x)| (m + t / count, l + x / count));
    let spread: f64 = points.iter().map(|(t, _)| (t - middle).powi(2)).sum();
    let rise: f64 = points.iter().map(|(t, x)| (t - middle) * (x - level)).sum();
    (level, if spread > 0.0 { rise / spread } else { 0.0 }, middle)
}

/// How well equations explain the same positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Criteria {
    /// Unknowns: parameters that are learned, and the state at the beginning of each video.
    pub unknowns: usize,
    /// Akaike's and the Bayesian information criterion.
    pub aic: f64,
    pub bic: f64,
}

impl Explained {
    /// Independent residuals, of which `frames_in_one` frames hold as much as one.
    pub fn independent(&self, frames_in_one: f64) -> f64 {
        self.fitted.residuals.iter().flatten().count() as f64 / frames_in_one.max(1.0)
    }

    /// Information criteria with as many independent positions as there are for `frames_in_one` frames that hold as much
    /// as one. Equations are compared with the same number. A root mean square below `least` counts as that.
    pub fn criteria(&self, frames_in_one: f64, least: f64) -> Criteria {
        let residuals = || self.fitted.residuals.iter().flatten();
        let independent = self.independent(frames_in_one);
        // As in the fit, what is far off counts linearly.
        let huber = self.fitted.huber;
        let loss = |x: f64| if x.abs() <= huber { x * x } else { huber * (2.0 * x.abs() - huber) };
        let mean = residuals().map(|x| loss(*x)).sum::<f64>() / residuals().count() as f64;
        let states: usize = self.fitted.states.iter().map(Vec::len).sum();
        let unknowns = self.learned.iter().filter(|learned| **learned).count() + states;
        let fits = independent * mean.max(least * least).max(f64::MIN_POSITIVE).ln();
        Criteria { unknowns, aic: fits + 2.0 * unknowns as f64, bic: fits + independent.ln() * unknowns as f64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_way_goes_on_straight() {
        let falling = paig::tasks::find("falling").unwrap().system;
        let dynamics = Dynamics::new(falling, 0.3).unwrap();
        // Every third frame is missing.
        let times: Vec<f64> = (0..30).filter(|tick| tick % 3 != 2).map(f64::from).collect();
        let positions = times.iter().flat_map(|time| [3.0 + 0.5 * time, 40.0 - 1.25 * time]).collect();
        let tracks = [Observations::new(positions, times, 12)];
        let errors = RollOutErrors::of(&tracks, &constant_velocity(&tracks, 2), &dynamics);
        // Rounding of float64.
        assert!(errors.learned == 0.0 && errors.held_out < 1e-9, "{errors:?}");
    }

    /// A throw without errors, of 20 frames: the first 14 teach, or only say how it begins.
    fn throw(dynamics: &Dynamics, g: f64, speed: f64, teaches: bool) -> Observations {
        let times = dynamics.even_times(20);
        let positions = dynamics.positions(&[g.ln()], &[3.0, 20.0, speed, -8.0], &times);
        Observations { teaches, ..Observations::new(positions, times, 14) }
    }

    fn one_ball() -> Dynamics {
        let system = paig::tasks::builtin("falling").unwrap().system;
        Dynamics::new(paig::network::System { objects: 1, ..system }, 0.1).unwrap()
    }

    #[test]
    fn throws_are_too_short_for_pieces_so_all_starts_are_tried() {
        let dynamics = one_ball();
        let tracks = [1.0, 2.0].map(|speed| throw(&dynamics, 7.0, speed, true));
        // The first start holds g where it is not.
        let starts =
            [false, true].map(|learned| Start { unconstrained: vec![6.0_f64.ln()], learned: vec![learned], piece: 12 });
        let explained = explain(&dynamics, &tracks, &starts).unwrap();
        assert_eq!(explained.fitted.piecewise_residual, None);
        // The positions have no errors.
        assert!(
            (explained.fitted.unconstrained[0].exp() - 7.0).abs() < 1e-4,
            "{}",
            explained.fitted.unconstrained[0].exp()
        );
        let long = Observations { trained: 20, ..tracks[0].clone() };
        assert!(explain(&dynamics, &[long], &starts).unwrap().fitted.piecewise_residual.is_some());
    }

    /// A fit without residuals counts as one with the systematic error: n ln(error^2) + unknowns ln(n).
    #[test]
    fn residuals_below_the_systematic_error_are_alike() {
        let dynamics = one_ball();
        let tracks = [throw(&dynamics, 7.0, 1.0, true)];
        let start = Start { unconstrained: vec![7.0_f64.ln()], learned: vec![true], piece: 12 };
        let explained = explain(&dynamics, &tracks, &[start]).unwrap();
        let (independent, error) = (explained.independent(2.0), 0.1_f64);
        let Criteria { unknowns, bic, .. } = explained.criteria(2.0, error);
        assert_eq!(unknowns, 5);
        let expected = 2.0 * independent * error.ln() + 5.0 * independent.ln();
        assert!((bic - expected).abs() < 1e-9 * expected.abs(), "{bic}, expected {expected}");
        assert!(explained.criteria(2.0, 0.0).bic < bic - 100.0);
    }

    /// On the way of a throw that was held out another g holds: it changes nothing of what is found, and is predicted with
    /// what was found, from how it begins.
    #[test]
    fn a_video_that_was_held_out_teaches_nothing() {
        let dynamics = one_ball();
        let all = [(7.0, 1.0, true), (7.0, 2.0, true), (9.0, 3.0, false)];
        let tracks = all.map(|(g, speed, teaches)| throw(&dynamics, g, speed, teaches));
        let start = Start { unconstrained: vec![6.0_f64.ln()], learned: vec![true], piece: 12 };
        let explained = explain(&dynamics, &tracks, &[start]).unwrap();
        // The positions have no errors.
        assert!(
            (explained.fitted.unconstrained[0].exp() - 7.0).abs() < 1e-4,
            "{}",
            explained.fitted.unconstrained[0].exp()
        );
        assert_eq!((explained.fitted.states.len(), explained.states.len()), (2, 3));
        assert!(explained.errors.learned < 1e-3, "{:?}", explained.errors);
        // A speed of 3 along x is found, whatever g is; a wrong g shows in the prediction of the third throw.
        assert!(
            (explained.states[2][2] - 3.0).abs() < 1e-6 && explained.errors.held_out > 0.1,
            "{:?}",
            explained.errors
        );
    }
}
