//! Starting values of a fit: what a run has learned, what the equation's file says, and what the accelerations of the tracks
//! say.
//!
//! Gradient matching (Varah 1982): short parts of the tracks are smoothed by cubic polynomials, and the parameters are fitted to
//! the accelerations these show, from many starting values. No roll-out is needed, so that a parameter may be wrong by orders of
//! magnitude.

use nalgebra::{DMatrix, DVector};
use rand::Rng;

use super::dynamics::Dynamics;
use super::fit::{Observations, Start};
use super::{obstacles, walls};
use paig::network::cells::text::TableNumber;
use paig::network::cells::{Bounds, Build};
use paig::support::least_squares;
use paig::support::random::{named_generator, normal};
use paig::support::statistics::{MEDIAN_TO_DEVIATION, upper_median};

/// Frames of a smoothed part: the longest that leaves hardly more of the positions than the shortest.
const WINDOWS: [usize; 7] = [5, 7, 9, 13, 19, 27, 39];
const HARDLY_MORE: f64 = 1.3;
/// Most parts that are smoothed of all tracks.
const MOST_SAMPLES: usize = 240;
/// Parts that leave more than so many times the median hold an impact or another object.
const ROUGH: f64 = 4.0;
/// Fewest parts in free motion that are matched alone.
const LEAST_FREE: usize = 8;
/// Starting values that are tried, the spread of their unconstrained parameters, and those of which a fit begins.
const TRIED: usize = 40;
const SPREAD: f64 = 3.0;
const KEPT: usize = 3;
/// Raw numbers of two starts that differ by less lead to the same.
const ALIKE: f64 = 0.2;
/// Iterations, and the relative fall of the cost at which they end.
const ITERATIONS: usize = 40;
const CONVERGED: f64 = 1e-6;
/// Half the span of the difference quotients of unconstrained parameters, and the largest step of one.
const PROBE: f64 = 1e-5;
const LARGEST_STEP: f64 = 2.0;
/// Share of `dt` over which an acceleration is taken.
const INSTANT: f64 = 1e-4;
/// Accelerations beyond so many usual residuals count linearly.
const HUBER: f64 = 2.0;
/// Residual, in units of the usual acceleration, beyond which all are equally bad.
const MOST_COUNTED: f64 = 1.0;

/// A parameter that is known from elsewhere.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownParameter {
    pub name: String,
    pub value: f64,
    pub learned: bool,
}

/// State of all objects at one time, with their accelerations.
struct StateSample {
    time: f64,
    state: Vec<f64>,
    acceleration: Vec<f64>,
}

/// Starting values for a fit of an equation to tracks, the likeliest first. `known` are the parameters of a run; `own` says
/// whether that learned with this very equation.
/// Walls are where `turning` turns; the tracks, where it is not given.
pub fn starts(
    dynamics: &Dynamics,
    tracks: &[Observations],
    piece: usize,
    (known, own): (&[KnownParameter], bool),
    turning: Option<&Observations>,
) -> Vec<Start> {
    let cell = &dynamics.system.cell;
    let of_run = |name: &str| known.iter().find(|known| known.name == name);
    let of_file = |kind: &paig::network::cells::PhysicalParameter| {
        kind.fixed.or(kind.start).map_or(0.0, |value| kind.bounds.unconstrained(value))
    };
    let file: Vec<f64> = cell.parameters.iter().map(of_file).collect();
    let learned: Vec<bool> = cell
        .parameters
        .iter()
        .map(|kind| match of_run(&kind.name) {
            Some(it) if own => it.learned,
            _ => kind.fixed.is_none(),
        })
        .collect();
    // What another equation gives as fixed stays as it is given there.
    let taken_over = cell.parameters.iter().zip(&file).map(|(kind, file)| {
        let known = of_run(&kind.name).filter(|_| kind.fixed.is_none() || own);
        known
            .map(|it| kind.bounds.unconstrained(it.value))
            .filter(|unconstrained| unconstrained.is_finite())
            .unwrap_or(*file)
    });
    let taken_over: Vec<f64> = taken_over.collect();
    // What is not learned is given in every start.
    let file: Vec<f64> = learned
        .iter()
        .zip(file.iter().zip(&taken_over))
        .map(|(learned, (file, run))| if *learned { *file } else { *run })
        .collect();
    let mut raws = Vec::new();
    if file != taken_over {
        raws.push(taken_over);
    }
    let turning = turning.map_or(tracks, std::slice::from_ref);
    let matched = Matching::new(dynamics, tracks, (&learned, &file), turning).map(|matching| matching.best(&file));
    if known.is_empty() {
        raws.extend(matched.unwrap_or_default());
        raws.push(file);
    } else {
        raws.push(file);
        raws.extend(matched.unwrap_or_default());
    }
    raws.into_iter().map(|unconstrained| Start { unconstrained, learned: learned.clone(), piece }).collect()
}

/// Parameters against the accelerations of tracks.
struct Matching<'a> {
    dynamics: &'a Dynamics,
    samples: Vec<StateSample>,
    /// Places of the parameters that are learned.
    learned: Vec<usize>,
    /// Raw numbers of parameters that are walls, where the tracks turn, the distance of a contact, where objects come closest, or of
    /// surfaces and strings, where the positions end.
    walls: Vec<(usize, f64)>,
    /// Walls that lie beyond all positions, since none of the frames shows an impact.
    beyond: Vec<(usize, f64)>,
    /// What an acceleration usually is.
    usual: f64,
}

impl<'a> Matching<'a> {
    /// None of tracks without smooth parts.
    fn new(
        dynamics: &'a Dynamics,
        tracks: &[Observations],
        (learned, file): (&[bool], &[f64]),
        turning: &[Observations],
    ) -> Option<Self> {
        let coordinates = dynamics.coordinates();
        let touched = obstacles::touched(dynamics, turning, learned, file);
        let samples = free(dynamics, samples(tracks, coordinates)?, tracks, (&touched, file));
        let sizes = samples.iter().flat_map(|sample| sample.acceleration.iter().map(|a| a.abs()));
        let usual = upper_median(sizes).filter(|usual| *usual > 0.0)?;
        let walls =
            walls::furthest(dynamics, turning).into_iter().chain(contact(dynamics, tracks)).chain(touched).collect();
        let beyond = walls::beyond(dynamics, turning);
        let learned = (0..learned.len()).filter(|place| learned[*place]).collect();
        Some(Matching { dynamics, samples, learned, walls, beyond, usual })
    }

    /// The best distinct unconstrained parameters, from `file` and from random starting values.
    fn best(&self, file: &[f64]) -> Vec<Vec<f64>> {
        let mut random = named_generator(0, "gradient matching");
        let mut found: Vec<(f64, Vec<f64>)> = Vec::new();
        for number in 0..TRIED {
            let mut unconstrained = file.to_vec();
            if number > 0 {
                self.learned
                    .iter()
                    .for_each(|place| unconstrained[*place] = self.drawn(*place, file[*place], &mut random));
            }
            self.walls.iter().for_each(|(place, wall)| unconstrained[*place] = *wall);
            let cost = self.minimise(&mut unconstrained);
            if cost.is_finite() {
                found.push((cost, unconstrained));
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut best: Vec<Vec<f64>> = Vec::new();
        for (_, unconstrained) in found {
            let alike = |other: &Vec<f64>| unconstrained.iter().zip(other).all(|(a, b)| (a - b).abs() < ALIKE);
            if best.len() < KEPT && !best.iter().any(alike) {
                best.push(unconstrained);
            }
        }
        if self.beyond.is_empty() {
            return best;
        }
        let with_walls_beyond = |unconstrained: Vec<f64>| {
            let mut other = unconstrained.clone();
            self.beyond.iter().for_each(|(place, wall)| other[*place] = *wall);
            [unconstrained, other]
        };
        best.into_iter().flat_map(with_walls_beyond).collect()
    }

    /// A positive parameter is drawn about the start, over orders of magnitude; a bounded one over its range.
    fn drawn(&self, place: usize, start: f64, random: &mut impl Rng) -> f64 {
        match self.dynamics.system.cell.parameters[place].bounds {
            Bounds::Above(_) => start + SPREAD * normal(random),
            bounds @ Bounds::Between(low, high) => {
                bounds.unconstrained(low + (high - low) * random.random_range(0.02..0.98))
            }
        }
    }

    /// Differences of the equation's accelerations and those of the tracks, in units of the usual one.
    fn residuals(&self, unconstrained: &[f64]) -> DVector<f64> {
        let states: Vec<&[f64]> = self.samples.iter().map(|sample| sample.state.as_slice()).collect();
        let times: Vec<f64> = self.samples.iter().map(|sample| sample.time).collect();
        let all = self.dynamics.accelerations(unconstrained, &states, &times, INSTANT * self.dynamics.dt);
        let pairs = all.iter().zip(&self.samples);
        let differences = pairs.flat_map(|(found, sample)| found.iter().zip(&sample.acceleration).map(|(a, b)| a - b));
        DVector::from_vec(differences.map(|difference| difference / self.usual).collect())
    }

    /// Minimises the Huber loss of the residuals; the cost that is left.
    fn minimise(&self, unconstrained: &mut Vec<f64>) -> f64 {
        let mut huber = f64::INFINITY;
        let mut cost = f64::INFINITY;
        for _ in 0..3 {
            let loss = |unconstrained: &Vec<f64>| {
                let loss = |x: &f64| if x.abs() <= huber { 0.5 * x * x } else { huber * (x.abs() - 0.5 * huber) };
                let sum = self.residuals(unconstrained).iter().map(loss).sum::<f64>();
                if sum.is_finite() { sum } else { f64::INFINITY }
            };
            let linearise = |unconstrained: &Vec<f64>| {
                let columns = self.learned.iter().map(|place| {
                    let [up, down] = [PROBE, -PROBE].map(|by| {
                        let mut probed = unconstrained.clone();
                        probed[*place] += by;
                        self.residuals(&probed)
                    });
                    (up - down) / (2.0 * PROBE)
                });
                (self.residuals(unconstrained), columns.collect::<Vec<_>>())
            };
            let step =
                |unconstrained: &Vec<f64>, (residuals, columns): &(DVector<f64>, Vec<DVector<f64>>), damping: f64| {
                    if columns.is_empty() {
                        return None;
                    }
                    let jacobian = DMatrix::from_columns(columns);
                    let weights = residuals.map(|x| if x.abs() <= huber { 1.0 } else { huber / x.abs() });
                    let mut weighted = jacobian.clone();
                    weighted.column_iter_mut().for_each(|mut column| column.component_mul_assign(&weights));
                    let mut normal = weighted.transpose() * &jacobian;
                    (0..normal.nrows()).for_each(|place| normal[(place, place)] *= 1.0 + damping);
                    (0..normal.nrows()).for_each(|place| normal[(place, place)] += 1e-9);
                    let mut change = -normal.cholesky()?.solve(&(weighted.transpose() * residuals));
                    let largest = change.amax();
                    if largest > LARGEST_STEP {
                        change *= LARGEST_STEP / largest;
                    }
                    let mut next = unconstrained.clone();
                    self.learned.iter().zip(change.iter()).for_each(|(place, change)| next[*place] += change);
                    Some(next)
                };
            least_squares::minimise(unconstrained, (ITERATIONS, CONVERGED), loss, linearise, step);
            let residuals = self.residuals(unconstrained);
            let usual = upper_median(residuals.iter().map(|x| x.abs())).unwrap_or(f64::INFINITY);
            // Costs of different starts are compared: a scale of each one's own would favour the worse.
            cost = residuals.iter().map(|x| x.abs().min(MOST_COUNTED).powi(2)).sum();
            huber = HUBER * usual * MEDIAN_TO_DEVIATION;
        }
        if cost.is_nan() { f64::INFINITY } else { cost }
    }
}

/// Smooth parts of all tracks; none where there are none.
fn samples(tracks: &[Observations], coordinates: usize) -> Option<Vec<StateSample>> {
    let of_window = |window: usize| -> Vec<(f64, StateSample)> {
        let of_track = |track: &Observations| {
            let frames = track.trained;
            let starts = if frames < window { 0 } else { frames - window + 1 };
            (0..starts).filter_map(|first| smooth(track, first..first + window, coordinates)).collect::<Vec<_>>()
        };
        tracks.iter().filter(|track| track.teaches).flat_map(of_track).collect()
    };
    let usual = |samples: &[(f64, StateSample)]| upper_median(samples.iter().map(|(left, _)| *left));
    let mut best = of_window(WINDOWS[0]);
    let least = usual(&best)?;
    for window in &WINDOWS[1..] {
        let longer = of_window(*window);
        match usual(&longer) {
            Some(left) if left <= HARDLY_MORE * least && longer.len() >= 5 => best = longer,
            _ => break,
        }
    }
    let rough = ROUGH * usual(&best)?;
    best.retain(|(left, _)| *left <= rough.max(f64::MIN_POSITIVE));
    let stride = best.len().div_ceil(MOST_SAMPLES).max(1);
    let samples: Vec<StateSample> = best.into_iter().step_by(stride).map(|(_, sample)| sample).collect();
    (!samples.is_empty()).then_some(samples)
}

/// Samples away from surfaces and strings, whose forces are not among the accelerations that are matched; all where too few are.
fn free(
    dynamics: &Dynamics,
    samples: Vec<StateSample>,
    tracks: &[Observations],
    (touched, file): (&[(usize, f64)], &[f64]),
) -> Vec<StateSample> {
    let mut start = file.to_vec();
    touched.iter().for_each(|(place, unconstrained)| start[*place] = *unconstrained);
    let (coordinates, extent) = (dynamics.coordinates(), obstacles::extent(dynamics, tracks));
    let (free, held): (Vec<_>, Vec<_>) = samples
        .into_iter()
        .partition(|sample| obstacles::is_free(dynamics, &start, &sample.state[..coordinates], extent));
    if free.len() < LEAST_FREE { free.into_iter().chain(held).collect() } else { free }
}

/// What a cubic polynomial through some frames leaves of the positions (root mean square, of so many free numbers), and the state
/// in its middle; none where an object is not seen in one of them.
fn smooth(track: &Observations, frames: std::ops::Range<usize>, coordinates: usize) -> Option<(f64, StateSample)> {
    let positions = &track.positions[coordinates * frames.start..coordinates * frames.end];
    if positions.iter().any(|x| x.is_nan()) {
        return None;
    }
    let times = &track.times[frames.clone()];
    let middle = (times[0] + times[times.len() - 1]) / 2.0;
    let half = (times[times.len() - 1] - times[0]) / 2.0;
    let matrix = DMatrix::from_fn(times.len(), 4, |row, power| ((times[row] - middle) / half).powi(power as i32));
    let seen = DMatrix::from_row_slice(times.len(), coordinates, positions);
    let solved = matrix.clone().svd(true, true).solve(&seen, 1e-12).ok()?;
    let left = (&matrix * &solved - seen).norm_squared() / ((times.len() - 4) * coordinates) as f64;
    let of_power = |power: usize, times: f64| solved.row(power).iter().map(|x| x * times).collect::<Vec<_>>();
    let state = [of_power(0, 1.0), of_power(1, half.recip())].concat();
    Some((left.sqrt(), StateSample { time: middle, state, acceleration: of_power(2, 2.0 / half.powi(2)) }))
}

/// The raw number of the parameter that is the distance of a contact: the least one between two objects.
fn contact(dynamics: &Dynamics, tracks: &[Observations]) -> Option<(usize, f64)> {
    let cell = &dynamics.system.cell;
    let Build::Text(equation) = &cell.build else { return None };
    let TableNumber::Parameter(name) = &equation.table().contacts.as_ref()?.distance else { return None };
    let place = cell.parameters.iter().position(|parameter| parameter.name == name.as_str())?;
    let objects = dynamics.system.objects;
    let of_frame = |frame: &[f64]| {
        let pairs = (0..objects).flat_map(|one| (one + 1..objects).map(move |two| (one, two)));
        let apart = |(one, two): (usize, usize)| {
            (frame[2 * two] - frame[2 * one]).hypot(frame[2 * two + 1] - frame[2 * one + 1])
        };
        pairs.map(apart).fold(f64::INFINITY, f64::min)
    };
    let teaching = tracks.iter().filter(|track| track.teaches);
    let frames = teaching.flat_map(|track| track.positions.chunks(dynamics.coordinates()));
    let unconstrained = cell.parameters[place].bounds.unconstrained(frames.map(of_frame).fold(f64::INFINITY, f64::min));
    unconstrained.is_finite().then_some((place, unconstrained))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::fit::fit;
    use paig::network::System;
    use paig::tasks::Task;

    fn dynamics(file: &str) -> (Task, Dynamics) {
        let task = Task::from_toml(file).unwrap();
        let dynamics = Dynamics::new(System { objects: 1, ..task.system.clone() }, 0.05).unwrap();
        (task, dynamics)
    }

    fn seen(dynamics: &Dynamics, unconstrained: &[f64], state: &[f64], frames: usize) -> Observations {
        let times = dynamics.even_times(frames);
        let mut random = named_generator(4, "noise");
        let positions = dynamics.positions(unconstrained, state, &times);
        Observations::new(positions.iter().map(|x| x + 0.02 * normal(&mut random)).collect(), times, frames)
    }

    /// A pendulum whose gravity is 10 times that of the file, hanging elsewhere: found within a tenth from its accelerations.
    #[test]
    fn a_pendulum_is_found_from_a_start_that_is_far_off() {
        let (_, dynamics) = dynamics(include_str!("../../../../configs/gallery/free_pendulum.toml"));
        let unconstrained: Vec<f64> = dynamics
            .system
            .cell
            .parameters
            .iter()
            .zip([500.0, 25.0, -10.0])
            .map(|(it, x)| it.bounds.unconstrained(x))
            .collect();
        let track = seen(&dynamics, &unconstrained, &[35.0, 40.0, 0.0, 0.0], 80);
        let starts = starts(&dynamics, &[track], 12, (&[], true), None);
        let values = dynamics.values(&starts[0].unconstrained);
        assert!((values[0] / 500.0 - 1.0).abs() < 0.1 && (values[1] - 25.0).abs() < 3.0, "{values:?}");
    }

    /// A ball that bounces: the floor is where the track turns, and g is that of the fall between.
    #[test]
    fn a_floor_is_where_the_track_turns() {
        let (task, dynamics) = dynamics(include_str!("../../../../configs/gallery/bounce_on_a_floor.toml"));
        let names = dynamics.system.cell.parameters.iter().map(|it| &*it.name);
        let truth: Vec<f64> = names.map(|name| task.truth_of(name).unwrap()).collect();
        let unconstrained: Vec<f64> =
            dynamics.system.cell.parameters.iter().zip(&truth).map(|(it, x)| it.bounds.unconstrained(*x)).collect();
        let track = seen(&dynamics, &unconstrained, &[3.0, 5.0, 1.0, 0.0], 200);
        let starts = starts(&dynamics, &[track], 12, (&[], true), None);
        for (kind, unconstrained) in dynamics.system.cell.parameters.iter().zip(&starts[0].unconstrained) {
            let expected = task.truth_of(&kind.name).unwrap();
            let found = kind.bounds.value(*unconstrained);
            if kind.name != "e" {
                assert!((found / expected - 1.0).abs() < 0.1, "{}: {found} instead of {expected}", kind.name);
            }
        }
    }

    /// A ball that bounces on an incline, and one on a slack string: the fit finds the parameters from where the positions end.
    #[test]
    fn surfaces_and_strings_are_where_the_positions_end() {
        let incline = include_str!("../../../../configs/gallery/bounce_on_an_incline.toml");
        let string = include_str!("../../../../configs/gallery/slack_pendulum.toml");
        for (file, state) in [(incline, [24.0, 15.0, -4.0, 0.0]), (string, [21.0, 10.0, 1.0, -1.0])] {
            let (task, dynamics) = dynamics(file);
            let parameters = &dynamics.system.cell.parameters;
            let truth: Vec<f64> = parameters.iter().map(|it| task.truth_of(&it.name).unwrap()).collect();
            let unconstrained: Vec<f64> =
                parameters.iter().zip(&truth).map(|(it, x)| it.bounds.unconstrained(*x)).collect();
            let track = seen(&dynamics, &unconstrained, &state, 120);
            let starts = starts(&dynamics, std::slice::from_ref(&track), 12, (&[], true), None);
            let fitted = fit(&dynamics, &[track], &starts[0]).unwrap();
            let found = dynamics.values(&fitted.unconstrained);
            for ((kind, truth), (start, found)) in
                parameters.iter().zip(&truth).zip(dynamics.values(&starts[0].unconstrained).iter().zip(&found))
            {
                assert!((found / truth - 1.0).abs() < 0.01, "{}: {found} from {start} instead of {truth}", kind.name);
            }
        }
    }
}
