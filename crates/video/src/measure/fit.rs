//! The fit of an equation to whole videos: each one long trajectory, with the parameters in common.
//!
//! A long trajectory has no slope that leads to it from far: a pendulum that is a little too fast is half a swing off at
//! the end. So the video is first cut into pieces with a state of their own, which grow until one is left. At each length
//! the fit is Levenberg-Marquardt in float64 with a Huber loss; the states of the pieces are eliminated (the normal
//! equations have an arrow's shape, as in [`identify`](paig::training::identify::fit)).

use anyhow::{Result, ensure};
use nalgebra::{DMatrix, DVector};

use super::dynamics::Dynamics;
use paig::support::least_squares;
use paig::support::statistics::{MEDIAN_TO_DEVIATION, upper_median};

/// Half the span of the difference quotients, in the unit of a coordinate, of a velocity, or of an unconstrained parameter.
const PROBE: f64 = 1e-5;
/// Iterations for each length of the pieces, and the relative fall of the cost at which they end; for the last length and
/// for those that only lead to it.
const ITERATIONS: usize = 60;
const CONVERGED: f64 = 1e-8;
const NEAR_ENOUGH: f64 = 1e-4;
/// While pieces are short they may say next to nothing of a parameter, which must not run away meanwhile: it is held at its
/// start as by one residual for every so much of its unconstrained parameter.
const HELD: f64 = 1.0;
/// Largest change of an unconstrained parameter in one iteration.
const LARGEST_STEP: f64 = 0.5;
/// Residuals beyond so many usual ones count linearly.
const HUBER: f64 = 3.0;
/// Least usual residual, in the unit of a coordinate: made data may have none.
const LEAST_DEVIATION: f64 = 1e-9;
/// Fewest frames of a piece, and most frames of a track while pieces grow: of longer ones every n-th leads to the same.
const LEAST_PIECE: usize = 3;
const MOST_FRAMES: usize = 300;
/// Frames in which an object is seen from which the first state of a piece is guessed.
const GUESSED_FROM: usize = 9;
/// Largest ratio of a coordinate's weight to the geometric mean of all.
const MOST_WEIGHT: f64 = 10.0;

/// What is seen of one video.
#[derive(Debug, Clone, PartialEq)]
pub struct Observations {
    /// In the equation's coordinates, frame by frame; not a number where an object is not seen.
    pub positions: Vec<f64>,
    /// When each frame was filmed, in the unit of `dt`, from 0 on.
    pub times: Vec<f64>,
    /// Precision of each position relative to the others': their residuals are multiplied by it. As many as positions.
    pub weights: Vec<f64>,
    /// Frames that may be learned from. Those after them are held out.
    pub trained: usize,
    /// Whether those frames teach the parameters. Of a video that was held out whole they only say how its motion begins.
    pub teaches: bool,
}

impl Observations {
    /// Frames at these times and of one precision.
    pub fn new(positions: Vec<f64>, times: Vec<f64>, trained: usize) -> Self {
        let weights = vec![1.0; positions.len()];
        Observations { positions, times, weights, trained, teaches: true }
    }

    /// Whether all objects are seen, frame by frame.
    pub fn seen(&self, coordinates: usize) -> impl Iterator<Item = bool> + '_ {
        self.positions.chunks(coordinates).map(|frame| frame.iter().all(|x| x.is_finite()))
    }

    /// From the first frame to the last, in the unit of `dt`.
    pub fn duration(&self) -> f64 {
        self.times.last().copied().unwrap_or(0.0)
    }
}

/// Where a fit begins.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Raw numbers of all parameters; more where what is seen may lie beside the state (see [`Dynamics::beside`]).
    pub unconstrained: Vec<f64>,
    pub learned: Vec<bool>,
    /// Frames of the first pieces.
    pub piece: usize,
}

/// The result of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    /// Raw numbers of all parameters.
    pub unconstrained: Vec<f64>,
    /// Of each video that teaches, at its first frame: positions, velocities.
    pub states: Vec<Vec<f64>>,
    /// Of each video that teaches, of the frames that were learned from: seen minus rolled-out, times their weights, frame by
    /// frame.
    pub residuals: Vec<Vec<f64>>,
    /// What a residual usually is: from the median of their sizes.
    pub usual_residual: f64,
    /// The same while each of the first pieces had a state of its own; none of videos too short for two pieces, of which the
    /// pieces say no more than the whole.
    pub piecewise_residual: Option<f64>,
    /// Residuals beyond this counted linearly.
    pub huber: f64,
    /// Weight of each coordinate, next to that of each position; their geometric mean is 1.
    pub coordinate_weights: Vec<f64>,
}

/// Some frames of a video that follow each other, with the state at their beginning.
#[derive(Debug, Clone)]
struct FitSegment {
    track: usize,
    first: usize,
    frames: usize,
    state: Vec<f64>,
}

/// Residuals (rolled-out minus seen; 0 where nothing is seen) of a piece, and their derivatives.
pub(super) struct Linearised {
    pub residual: DVector<f64>,
    pub by_state: DMatrix<f64>,
    /// By the unconstrained parameters that are learned.
    pub by_unconstrained: DMatrix<f64>,
}

/// The unknowns of one length of the pieces.
#[derive(Debug, Clone)]
struct Unknowns {
    unconstrained: Vec<f64>,
    pieces: Vec<FitSegment>,
}

/// What is made least.
struct Goal<'a> {
    /// Weighted residuals beyond this count linearly.
    huber: f64,
    coordinate_weights: &'a [f64],
    /// Weight of the squared distance of the unconstrained parameters from where they began.
    held: f64,
    start: &'a [f64],
}

pub(super) struct Problem<'a> {
    pub dynamics: &'a Dynamics,
    /// Those that teach.
    pub tracks: Vec<&'a Observations>,
    /// Places of the parameters that are learned.
    pub learned: Vec<usize>,
}

/// Fits an equation to what is seen of the videos that teach.
///
/// # Errors
/// Too few frames, an equation that leads to infinity wherever the fit goes.
pub fn fit(dynamics: &Dynamics, tracks: &[Observations], start: &Start) -> Result<Fitted> {
    let problem = Problem::new(dynamics, tracks, &start.learned);
    ensure!(!problem.tracks.is_empty(), "all videos are held out whole; a fit needs one to learn from");
    for track in &problem.tracks {
        ensure!(track.trained >= 3, "a video of {} frames is too short to be fitted", track.trained);
    }
    let thinned: Vec<Observations> = tracks.iter().map(thinned).collect();
    let stride = tracks.iter().map(stride).max().unwrap_or(1);
    let coarse = Problem::new(dynamics, &thinned, &start.learned).grown(start, (start.piece / stride).max(LEAST_PIECE));
    if stride == 1 {
        return problem.fitted(coarse);
    }
    let mut grown = coarse;
    for (piece, track) in grown.unknowns.pieces.iter_mut().zip(&problem.tracks) {
        piece.frames = track.trained;
    }
    problem.fitted(problem.converged(grown))
}

/// Fits an equation to slightly other positions, from where a fit of it led to: each video is one piece from the beginning.
///
/// # Errors
/// An equation that leads to infinity.
pub fn refit(dynamics: &Dynamics, tracks: &[Observations], learned: &[bool], before: &Fitted) -> Result<Fitted> {
    let problem = Problem::new(dynamics, tracks, learned);
    let states = problem.tracks.iter().enumerate().zip(&before.states);
    let pieces =
        states.map(|((track, it), state)| FitSegment { track, first: 0, frames: it.trained, state: state.clone() });
    problem.fitted(problem.converged(Grown {
        unknowns: Unknowns { unconstrained: before.unconstrained.clone(), pieces: pieces.collect() },
        huber: before.huber,
        coordinate_weights: before.coordinate_weights.clone(),
        piecewise: before.piecewise_residual,
    }))
}

/// Every how many-th frame of a track is enough to lead to the whole of it.
fn stride(track: &Observations) -> usize {
    track.trained.div_ceil(MOST_FRAMES).max(1)
}

/// Some frames of the part that is learned from, evenly over it.
pub(super) fn thinned(track: &Observations) -> Observations {
    let stride = stride(track);
    if stride == 1 {
        return track.clone();
    }
    let coordinates = track.positions.len() / track.times.len();
    let rows =
        |of: &[f64]| of[..coordinates * track.trained].chunks(coordinates).step_by(stride).flatten().copied().collect();
    let times: Vec<f64> = track.times[..track.trained].iter().step_by(stride).copied().collect();
    Observations {
        trained: times.len(),
        positions: rows(&track.positions),
        weights: rows(&track.weights),
        times,
        ..*track
    }
}

/// Where growing pieces lead to.
struct Grown {
    /// One piece for each track.
    unknowns: Unknowns,
    huber: f64,
    coordinate_weights: Vec<f64>,
    /// What a residual usually was while pieces were short; none of tracks too short for two.
    piecewise: Option<f64>,
}

impl<'a> Problem<'a> {
    /// The unknowns of whole tracks after the last iterations, the second time with the scale that the first leaves.
    fn converged(&self, grown: Grown) -> Grown {
        let Grown { mut unknowns, mut huber, mut coordinate_weights, piecewise } = grown;
        let start = unknowns.unconstrained.clone();
        for _ in 0..2 {
            let goal = Goal { huber, coordinate_weights: &coordinate_weights, held: 0.0, start: &start };
            self.minimise(&mut unknowns, &goal, CONVERGED);
            coordinate_weights = self.coordinate_weights(&unknowns);
            huber = HUBER * self.usual_weighted(&unknowns, &coordinate_weights);
        }
        Grown { unknowns, huber, coordinate_weights, piecewise }
    }

    /// The fit with its residuals.
    fn fitted(&self, Grown { unknowns, huber, coordinate_weights, piecewise }: Grown) -> Result<Fitted> {
        let residuals = unknowns.pieces.iter().map(|piece| {
            let weights = self.weights(piece, &coordinate_weights);
            self.residual(piece, &unknowns.unconstrained)
                .iter()
                .zip(weights.iter())
                .map(|(x, weight)| -x * weight)
                .collect()
        });
        let residuals: Vec<Vec<f64>> = residuals.collect();
        ensure!(
            residuals.iter().flatten().all(|x| x.is_finite()),
            "the equation leads to infinity; are its bounds and starts right?"
        );
        Ok(Fitted {
            usual_residual: self.usual(&unknowns),
            coordinate_weights,
            piecewise_residual: piecewise,
            states: unknowns.pieces.iter().map(|piece| piece.state.clone()).collect(),
            unconstrained: unknowns.unconstrained,
            residuals,
            huber,
        })
    }

    /// Fits pieces of a growing number of frames until each is a whole track.
    fn grown(&self, start: &Start, piece: usize) -> Grown {
        let longest = self.tracks.iter().map(|track| track.trained).max().unwrap_or(0);
        let mut length = piece.clamp(LEAST_PIECE, longest.max(LEAST_PIECE));
        let mut unknowns = Unknowns { unconstrained: start.unconstrained.clone(), pieces: self.first_pieces(length) };
        let in_pieces = unknowns.pieces.len() >= 2 * self.tracks.len();
        let mut huber = f64::INFINITY;
        let mut coordinate_weights = vec![1.0; self.dynamics.coordinates()];
        let mut piecewise = None;
        loop {
            // The second time with the scale of what is left by the first.
            for _ in 0..2 {
                let last = length >= longest;
                let deviation = if last { 0.0 } else { self.usual(&unknowns).min(huber / HUBER) };
                let held = (deviation / HELD).powi(2);
                let goal = Goal { huber, coordinate_weights: &coordinate_weights, held, start: &start.unconstrained };
                self.minimise(&mut unknowns, &goal, if last { CONVERGED } else { NEAR_ENOUGH });
                coordinate_weights = self.coordinate_weights(&unknowns);
                huber = HUBER * self.usual_weighted(&unknowns, &coordinate_weights);
            }
            piecewise = piecewise.or(in_pieces.then(|| self.usual(&unknowns)));
            if length >= longest {
                return Grown { unknowns, huber, coordinate_weights, piecewise };
            }
            length = (2 * length).min(longest);
            unknowns.pieces = self.longer_pieces(&unknowns, length);
            // Longer pieces may at first be far off.
            huber = f64::INFINITY;
        }
    }

    pub(super) fn new(dynamics: &'a Dynamics, tracks: &'a [Observations], learned: &[bool]) -> Self {
        let learned = (0..learned.len()).filter(|place| learned[*place]).collect();
        Problem { dynamics, tracks: tracks.iter().filter(|track| track.teaches).collect(), learned }
    }

    /// Derivatives of a whole video's training part.
    pub(super) fn of_track(&self, track: usize, unconstrained: &[f64], state: &[f64]) -> Linearised {
        self.linearise(&self.training_part(track, state), unconstrained)
    }

    fn seen(&self, piece: &FitSegment) -> &[f64] {
        let coordinates = self.dynamics.coordinates();
        &self.tracks[piece.track].positions[coordinates * piece.first..coordinates * (piece.first + piece.frames)]
    }

    /// Where pieces of so many frames begin: what is left at the end and is shorter than half a piece joins the last.
    fn cut(&self, length: usize) -> Vec<(usize, usize, usize)> {
        let of_track = |(place, track): (usize, &&Observations)| {
            let count = ((track.trained + length / 2) / length).max(1);
            let end = move |piece: usize| if piece + 1 == count { track.trained } else { (piece + 1) * length };
            (0..count).map(move |piece| (place, piece * length, end(piece) - piece * length)).collect::<Vec<_>>()
        };
        self.tracks.iter().enumerate().flat_map(of_track).collect()
    }

    fn first_pieces(&self, length: usize) -> Vec<FitSegment> {
        let cut = self.cut(length).into_iter();
        cut.map(|(track, first, frames)| {
            let mut piece = FitSegment { track, first, frames, state: Vec::new() };
            piece.state = self.guessed(&piece);
            piece
        })
        .collect()
    }

    /// Position and velocity at the first frame of a piece, by a parabola through the first frames in which the object is seen.
    /// Where a piece has none, it rests where it was seen last before.
    fn guessed(&self, piece: &FitSegment) -> Vec<f64> {
        let (coordinates, seen) = (self.dynamics.coordinates(), self.seen(piece));
        let guess = |coordinate: usize| {
            let times = self.tracks[piece.track].times[piece.first..].iter().map(|time| time - self.begin(piece));
            let points = times.zip(seen.chunks(coordinates).map(|frame| frame[coordinate]));
            let points: Vec<_> = points.filter(|(_, x)| x.is_finite()).take(GUESSED_FROM).collect();
            if points.is_empty() {
                return (self.seen_before(piece, coordinate).unwrap_or(0.0), 0.0);
            }
            let powers = (points.len() - 1).min(2);
            let matrix = DMatrix::from_fn(points.len(), powers + 1, |row, power| points[row].0.powi(power as i32));
            let values = DVector::from_iterator(points.len(), points.iter().map(|(_, x)| *x));
            let solved = matrix.svd(true, true).solve(&values, 1e-12);
            let solved = solved.unwrap_or_else(|_| DVector::zeros(1));
            (solved.get(0).copied().unwrap_or(0.0), solved.get(1).copied().unwrap_or(0.0))
        };
        let (pos, vel): (Vec<_>, Vec<_>) = (0..coordinates).map(guess).unzip();
        pos.into_iter().chain(vel).collect()
    }

    /// Where a coordinate was seen last before a piece.
    fn seen_before(&self, piece: &FitSegment, coordinate: usize) -> Option<f64> {
        let coordinates = self.dynamics.coordinates();
        let before = self.tracks[piece.track].positions[..coordinates * piece.first].chunks(coordinates);
        before.map(|frame| frame[coordinate]).rfind(|x| x.is_finite())
    }

    /// Pieces that begin where some of the shorter ones do, or as near after one as they can.
    fn longer_pieces(&self, unknowns: &Unknowns, length: usize) -> Vec<FitSegment> {
        let cut = self.cut(length).into_iter();
        cut.map(|(track, first, frames)| {
            let before = unknowns.pieces.iter().rev().find(|piece| piece.track == track && piece.first <= first);
            let before = before.expect("the first piece begins with the video");
            let between = &self.tracks[track].times[before.first..=first];
            let way = self.dynamics.roll_out(&unknowns.unconstrained, &before.state, between);
            let led_to = FitSegment { track, first, frames, state: way[way.len() - before.state.len()..].to_vec() };
            let afresh = FitSegment { state: self.guessed(&led_to), ..led_to.clone() };
            // Over so long a way a state that was good for a short one may lead to infinity.
            let left = |piece: &FitSegment| {
                let left = self.residual(piece, &unknowns.unconstrained).norm();
                if left.is_finite() { left } else { f64::INFINITY }
            };
            if left(&afresh) < left(&led_to) { afresh } else { led_to }
        })
        .collect()
    }

    /// The time of a piece's first frame.
    fn begin(&self, piece: &FitSegment) -> f64 {
        self.tracks[piece.track].times[piece.first]
    }

    /// Observed positions in the frames of a piece as several motions have them, each from unconstrained parameters and a
    /// state at the first.
    fn rolled_out(&self, piece: &FitSegment, motions: &[(Vec<f64>, Vec<f64>)]) -> Vec<DVector<f64>> {
        let times = &self.tracks[piece.track].times[piece.first..piece.first + piece.frames];
        let coordinates = self.dynamics.coordinates();
        let mut all = self.dynamics.ensemble(motions, times);
        for (positions, (unconstrained, _)) in all.iter_mut().zip(motions) {
            for (frame, time) in positions.chunks_mut(coordinates).zip(times) {
                for (coordinate, x) in frame.iter_mut().enumerate() {
                    *x += self.dynamics.beside(unconstrained, *time, coordinate);
                }
            }
        }
        all.into_iter().map(DVector::from_vec).collect()
    }

    /// What the residuals of a piece are multiplied by.
    fn weights(&self, piece: &FitSegment, coordinate_weights: &[f64]) -> DVector<f64> {
        let coordinates = self.dynamics.coordinates();
        let of_track = &self.tracks[piece.track].weights[coordinates * piece.first..];
        DVector::from_fn(coordinates * piece.frames, |row, _| of_track[row] * coordinate_weights[row % coordinates])
    }

    /// The weights of a whole video's training part.
    pub(super) fn weights_of_track(&self, track: usize, coordinate_weights: &[f64]) -> DVector<f64> {
        self.weights(&self.training_part(track, &[]), coordinate_weights)
    }

    fn training_part(&self, track: usize, state: &[f64]) -> FitSegment {
        FitSegment { track, first: 0, frames: self.tracks[track].trained, state: state.to_vec() }
    }

    fn residual(&self, piece: &FitSegment, unconstrained: &[f64]) -> DVector<f64> {
        let own = self.rolled_out(piece, &[(unconstrained.to_vec(), piece.state.clone())]).swap_remove(0);
        self.minus_seen(piece, own)
    }

    fn minus_seen(&self, piece: &FitSegment, mut rolled_out: DVector<f64>) -> DVector<f64> {
        for (out, seen) in rolled_out.iter_mut().zip(self.seen(piece)) {
            *out = if seen.is_nan() { 0.0 } else { *out - seen };
        }
        rolled_out
    }

    /// All derivatives in one pass: central differences of motions side by side.
    fn linearise(&self, piece: &FitSegment, unconstrained: &[f64]) -> Linearised {
        let seen = self.seen(piece);
        let probed = |numbers: &[f64], place: usize, by: f64| {
            let mut numbers = numbers.to_vec();
            numbers[place] += by;
            numbers
        };
        let mut motions = vec![(unconstrained.to_vec(), piece.state.clone())];
        for place in 0..piece.state.len() {
            motions.extend([PROBE, -PROBE].map(|by| (unconstrained.to_vec(), probed(&piece.state, place, by))));
        }
        for place in &self.learned {
            motions.extend([PROBE, -PROBE].map(|by| (probed(unconstrained, *place, by), piece.state.clone())));
        }
        let mut rolled_out = self.rolled_out(piece, &motions).into_iter();
        let own = rolled_out.next().expect("the motion itself");
        let mut columns = Vec::with_capacity(motions.len() / 2);
        while let (Some(up), Some(down)) = (rolled_out.next(), rolled_out.next()) {
            let mut column = (up - down) / (2.0 * PROBE);
            column.iter_mut().zip(seen).filter(|(_, seen)| seen.is_nan()).for_each(|(x, _)| *x = 0.0);
            columns.push(column);
        }
        let matrix = |columns: &[DVector<f64>]| match columns {
            [] => DMatrix::zeros(seen.len(), 0),
            columns => DMatrix::from_columns(columns),
        };
        let (by_state, by_unconstrained) = columns.split_at(piece.state.len());
        Linearised {
            residual: self.minus_seen(piece, own),
            by_state: matrix(by_state),
            by_unconstrained: matrix(by_unconstrained),
        }
    }

    fn cost(&self, unknowns: &Unknowns, goal: &Goal) -> f64 {
        let huber = goal.huber;
        let loss = |x: f64| if x.abs() <= huber { 0.5 * x * x } else { huber * (x.abs() - 0.5 * huber) };
        let of_piece = |piece: &FitSegment| {
            let weighted = self
                .residual(piece, &unknowns.unconstrained)
                .component_mul(&self.weights(piece, goal.coordinate_weights));
            weighted.iter().map(|x| loss(*x)).sum::<f64>()
        };
        let away =
            self.learned.iter().map(|place| (unknowns.unconstrained[*place] - goal.start[*place]).powi(2)).sum::<f64>();
        let cost = unknowns.pieces.iter().map(of_piece).sum::<f64>() + 0.5 * goal.held * away;
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    /// What a residual usually is.
    fn usual(&self, unknowns: &Unknowns) -> f64 {
        self.usual_of(unknowns, &|_, _| 1.0)
    }

    /// The same of weighted residuals.
    fn usual_weighted(&self, unknowns: &Unknowns, coordinate_weights: &[f64]) -> f64 {
        let coordinates = self.dynamics.coordinates();
        self.usual_of(unknowns, &|piece, row| {
            self.tracks[piece.track].weights[coordinates * piece.first + row] * coordinate_weights[row % coordinates]
        })
    }

    /// The reciprocal of what a residual of each coordinate usually is, over the geometric mean of these.
    fn coordinate_weights(&self, unknowns: &Unknowns) -> Vec<f64> {
        let coordinates = self.dynamics.coordinates();
        let usual = |coordinate: usize| {
            self.usual_of(unknowns, &|_, row| if row % coordinates == coordinate { 1.0 } else { f64::NAN }).ln()
        };
        let logarithms: Vec<f64> = (0..coordinates).map(usual).collect();
        let mean = logarithms.iter().sum::<f64>() / coordinates as f64;
        logarithms.into_iter().map(|it| (mean - it).exp().clamp(MOST_WEIGHT.recip(), MOST_WEIGHT)).collect()
    }

    /// What a residual times its weight usually is, from the median of their sizes. `weight` of a piece's rows; those that are
    /// no numbers are left out.
    fn usual_of(&self, unknowns: &Unknowns, weight: &dyn Fn(&FitSegment, usize) -> f64) -> f64 {
        let of_piece = |piece: &FitSegment| {
            let residual = self.residual(piece, &unknowns.unconstrained);
            let seen = self.seen(piece).iter().zip(residual.iter()).enumerate().filter(|(_, (seen, _))| !seen.is_nan());
            let sizes = seen.map(|(row, (_, x))| (x * weight(piece, row)).abs()).filter(|size| !size.is_nan());
            sizes.collect::<Vec<_>>()
        };
        let size = upper_median(unknowns.pieces.iter().flat_map(of_piece)).unwrap_or(0.0);
        (size * MEDIAN_TO_DEVIATION).max(LEAST_DEVIATION)
    }

    /// Iterates until the cost stands still.
    fn minimise(&self, unknowns: &mut Unknowns, goal: &Goal, converged: f64) {
        let cost = |unknowns: &Unknowns| self.cost(unknowns, goal);
        let linearise = |unknowns: &Unknowns| {
            unknowns.pieces.iter().map(|piece| self.linearise(piece, &unknowns.unconstrained)).collect::<Vec<_>>()
        };
        let step = |unknowns: &Unknowns, at: &Vec<Linearised>, damping: f64| self.stepped(unknowns, at, goal, damping);
        least_squares::minimise(unknowns, (ITERATIONS, converged), cost, linearise, step);
    }

    /// The unknowns after a damped Gauss-Newton step; none where there is none.
    fn stepped(&self, unknowns: &Unknowns, at: &[Linearised], goal: &Goal, damping: f64) -> Option<Unknowns> {
        let count = self.learned.len();
        let huber = goal.huber;
        let mut normal = DMatrix::identity(count, count) * goal.held;
        let away = self.learned.iter().map(|place| unknowns.unconstrained[*place] - goal.start[*place]);
        let mut gradient = DVector::from_iterator(count, away) * goal.held;
        let mut of_pieces = Vec::with_capacity(at.len());
        for (piece, Linearised { residual, by_state, by_unconstrained }) in unknowns.pieces.iter().zip(at) {
            let weights = self.weights(piece, goal.coordinate_weights);
            let weight = residual.zip_map(&weights, |x, weight| {
                let within = huber / (weight * x).abs().max(huber);
                weight * weight * if within.is_nan() { 1.0 } else { within }
            });
            let weighted = |jacobian: &DMatrix<f64>| {
                let mut jacobian = jacobian.clone();
                jacobian.column_iter_mut().for_each(|mut column| column.component_mul_assign(&weight));
                jacobian.transpose()
            };
            let (state, unconstrained) = (weighted(by_state), weighted(by_unconstrained));
            let factor = damped(&state * by_state, damping).cholesky()?;
            let (mixed, right) = (&state * by_unconstrained, &state * residual);
            let (by_mixed, by_right) = (factor.solve(&mixed), factor.solve(&right));
            normal += &unconstrained * by_unconstrained - mixed.transpose() * &by_mixed;
            gradient += &unconstrained * residual - mixed.transpose() * &by_right;
            of_pieces.push((by_mixed, by_right));
        }
        let mut change = if count > 0 { -damped(normal, damping).cholesky()?.solve(&gradient) } else { gradient };
        let largest = change.amax();
        if count > 0 && largest > LARGEST_STEP {
            change *= LARGEST_STEP / largest;
        }
        let mut next = unknowns.clone();
        self.learned.iter().zip(change.iter()).for_each(|(place, change)| next.unconstrained[*place] += change);
        for (piece, (by_mixed, by_right)) in next.pieces.iter_mut().zip(of_pieces) {
            let of_state = by_right + by_mixed * &change;
            piece.state.iter_mut().zip(of_state.iter()).for_each(|(state, change)| *state -= change);
        }
        Some(next)
    }
}

/// With a larger diagonal.
fn damped(mut normal: DMatrix<f64>, damping: f64) -> DMatrix<f64> {
    for place in 0..normal.nrows() {
        normal[(place, place)] += damping * normal[(place, place)].abs() + 1e-12;
    }
    normal
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball that falls, lost from sight at the beginning and for longer than a piece: what is left says its g all the same.
    #[test]
    fn a_piece_in_which_nothing_is_seen_says_nothing() {
        let system = paig::tasks::builtin("falling").unwrap().system;
        let dynamics = Dynamics::new(paig::network::System { objects: 1, ..system }, 0.1).unwrap();
        let times = dynamics.even_times(60);
        let positions = dynamics.positions(&[7.0_f64.ln()], &[3.0, 4.0, 1.0, -2.0], &times);
        let start = Start { unconstrained: vec![6.0_f64.ln()], learned: vec![true], piece: 10 };
        for unseen in [0..9, 0..12, 10..30, 9..21] {
            let mut track = Observations::new(positions.clone(), times.clone(), 60);
            track.positions[2 * unseen.start..2 * unseen.end].fill(f64::NAN);
            let fitted = fit(&dynamics, &[track], &start).unwrap();
            // The positions have no errors.
            assert!(
                (fitted.unconstrained[0].exp() - 7.0).abs() < 1e-4,
                "{unseen:?}: {}",
                fitted.unconstrained[0].exp()
            );
        }
    }
}
