//! The part of a recording that obeys the equation: before it a hand may hold the object, after it something else may stop it.
//!
//! Short windows that the equation explains to within the noise grow on both sides as long as new frames are explained as well;
//! the longest of them is taken. Nothing but the equation and the positions is used, so that it works for any equation.

use std::ops::Range;

use super::dynamics::Dynamics;
use super::fit::{Fitted, Observations, Start, fit};
use super::judgement::PIECEWISE;
use super::motion::TrackMotion;
use super::starts::starts;

/// Windows that are tried, and the frames of each: this share of all, within these bounds.
const WINDOWS: usize = 9;
const SHARE: usize = 8;
const WINDOW: Range<usize> = 9..60;
/// A window is explained where the fit leaves at most so many times the noise, or this share of the window's own extent.
const EXPLAINED: f64 = 2.0;
const SHARE_OF_EXTENT: f64 = 0.03;
/// Share of its extent that the fit to a part that has grown may leave: many periods say more than the few that fit best.
const SHARE_OF_GROWN: f64 = 0.025;
/// Share of a window's frames in which all objects must be seen.
const SEEN: f64 = 0.7;
/// New frames are explained where they leave at most so many times what the others do.
const AS_WELL: f64 = 3.0;
/// Most frames in which windows grow: of longer recordings every n-th is taken.
const MOST_FRAMES: usize = 240;
/// Fewest frames of a part.
const LEAST: usize = 8;

/// A part that the equation explains, and the fit to it.
#[derive(Debug, Clone)]
pub struct FreeMotion {
    pub frames: Range<usize>,
    pub fitted: Fitted,
    /// What a residual of the first window usually was, or of the positions' noise where that is more.
    usual: f64,
}

/// The longest part of a track that the equation explains; none where no window is explained.
pub fn free_motion(dynamics: &Dynamics, track: &Observations) -> Option<FreeMotion> {
    let stride = track.times.len().div_ceil(MOST_FRAMES);
    let few = every(track, stride, dynamics.coordinates());
    let found = longest(&Growth::new(dynamics, &few))?;
    let frames = found.frames.start * stride..((found.frames.end - 1) * stride + 1).min(track.times.len());
    Some(FreeMotion { frames: of_seen(track, frames, dynamics.coordinates()), ..found })
}

/// The same frames from the first to the last in which all objects are seen: what is not seen is explained by anything.
fn of_seen(track: &Observations, frames: Range<usize>, coordinates: usize) -> Range<usize> {
    let seen: Vec<bool> = track.seen(coordinates).collect();
    let (first, last) = (frames.clone().find(|frame| seen[*frame]), frames.clone().rfind(|frame| seen[*frame]));
    first.zip(last).map_or(frames, |(first, last)| first..last + 1)
}

fn longest(growth: &Growth) -> Option<FreeMotion> {
    let mut best: Option<FreeMotion> = None;
    for window in growth.windows() {
        // A window within what is explained leads there again.
        let known = |best: &FreeMotion| best.frames.start <= window.start && window.end <= best.frames.end;
        if best.as_ref().is_some_and(known) {
            continue;
        }
        let Some(grown) = growth.seed(window).map(|seed| growth.grow(seed)) else { continue };
        if best.as_ref().is_none_or(|best| growth.seen(&grown.frames) > growth.seen(&best.frames)) {
            best = Some(grown);
        }
    }
    best
}

/// Frames of a track, on its own times.
pub fn cut(track: &Observations, frames: Range<usize>, coordinates: usize) -> Observations {
    let rows = coordinates * frames.start..coordinates * frames.end;
    Observations {
        positions: track.positions[rows.clone()].to_vec(),
        times: track.times[frames.clone()].to_vec(),
        weights: track.weights[rows].to_vec(),
        trained: frames.len(),
        teaches: true,
    }
}

/// Every so many-th frame.
fn every(track: &Observations, stride: usize, coordinates: usize) -> Observations {
    let rows = |of: &[f64]| of.chunks(coordinates).step_by(stride).flatten().copied().collect();
    let times: Vec<f64> = track.times.iter().step_by(stride).copied().collect();
    Observations {
        positions: rows(&track.positions),
        weights: rows(&track.weights),
        trained: times.len(),
        times,
        teaches: true,
    }
}

struct Growth<'a> {
    dynamics: &'a Dynamics,
    track: &'a Observations,
    coordinates: usize,
    noise: f64,
    window: usize,
}

impl<'a> Growth<'a> {
    fn new(dynamics: &'a Dynamics, track: &'a Observations) -> Self {
        let coordinates = dynamics.coordinates();
        let window = (track.times.len() / SHARE).clamp(WINDOW.start, WINDOW.end).min(track.times.len());
        let noise = TrackMotion::of(track, coordinates).noise;
        Growth { dynamics, track, coordinates, noise, window }
    }

    /// Evenly over the track, those in its middle first.
    fn windows(&self) -> Vec<Range<usize>> {
        let last = self.track.times.len() - self.window;
        let count = WINDOWS.min(last + 1);
        let first = |number: usize| if count > 1 { number * last / (count - 1) } else { 0 };
        let mut windows: Vec<_> = (0..count).map(|number| first(number)..first(number) + self.window).collect();
        windows.sort_by_key(|window| (window.start + window.end).abs_diff(self.track.times.len()));
        windows
    }

    /// Frames in which all objects are seen.
    fn seen(&self, frames: &Range<usize>) -> usize {
        self.track.seen(self.coordinates).skip(frames.start).take(frames.len()).filter(|seen| *seen).count()
    }

    fn fitted(&self, frames: &Range<usize>, start: &Start) -> Option<Fitted> {
        fit(self.dynamics, &[cut(self.track, frames.clone(), self.coordinates)], start).ok()
    }

    /// What is good enough for a part of this extent.
    fn tolerance(&self, extent: f64) -> f64 {
        (EXPLAINED * self.noise).max(SHARE_OF_EXTENT * extent)
    }

    fn extent(&self, frames: &Range<usize>) -> f64 {
        TrackMotion::of(&cut(self.track, frames.clone(), self.coordinates), self.coordinates).amplitude
    }

    /// The fit to a window; none where the equation does not explain it.
    fn seed(&self, frames: Range<usize>) -> Option<FreeMotion> {
        if (self.seen(&frames) as f64) < SEEN * frames.len() as f64 {
            return None;
        }
        let own = cut(self.track, frames.clone(), self.coordinates);
        let fits = starts(self.dynamics, &[own], frames.len(), (&[], true), Some(self.track))
            .into_iter()
            .filter_map(|start| self.fitted(&frames, &start));
        let fitted = fits.min_by(|a, b| a.usual_residual.total_cmp(&b.usual_residual))?;
        let usual = fitted.usual_residual.max(self.noise);
        (fitted.usual_residual <= self.tolerance(self.extent(&frames))).then_some(FreeMotion { frames, fitted, usual })
    }

    fn grow(&self, mut motion: FreeMotion) -> FreeMotion {
        let all = self.track.times.len();
        let mut steps = [motion.frames.len() / 2; 2];
        while steps.iter().any(|step| *step > 0) {
            for (side, step) in steps.iter_mut().enumerate() {
                let Range { start, end } = motion.frames;
                let wider = if side == 0 { start.saturating_sub(*step)..end } else { start..(end + *step).min(all) };
                if wider == motion.frames {
                    *step = 0;
                    continue;
                }
                match self.wider(&motion, wider) {
                    Some(wider) => {
                        motion = wider;
                        *step = motion.frames.len() / 2;
                    }
                    None => *step /= 2,
                }
            }
        }
        motion
    }

    /// The fit to a wider part; none where new frames are not explained.
    fn wider(&self, motion: &FreeMotion, frames: Range<usize>) -> Option<FreeMotion> {
        let learned = vec![true; motion.fitted.unconstrained.len()];
        let cell = &self.dynamics.system.cell;
        let learned = learned.iter().zip(&*cell.parameters).map(|(_, kind)| kind.fixed.is_none()).collect();
        let start = Start { unconstrained: motion.fitted.unconstrained.clone(), learned, piece: motion.frames.len() };
        let fitted = self.fitted(&frames, &start)?;
        let extent = self.extent(&frames);
        let usual = motion.usual.max(self.tolerance(extent) / EXPLAINED);
        let allowed = AS_WELL * usual;
        // A model that is right in short windows and wrong in long ones lacks something.
        let grown = (SHARE_OF_GROWN * extent).min(PIECEWISE * motion.usual);
        let seen = |frame: &usize| self.seen(&(*frame..*frame + 1)) > 0;
        let new = frames.clone().filter(|frame| !motion.frames.contains(frame)).filter(seen);
        let residual = |frame: usize| {
            let first = self.coordinates * (frame - frames.start);
            let of_frame = &fitted.residuals[0][first..first + self.coordinates];
            of_frame.iter().map(|x| x.abs()).fold(0.0, f64::max)
        };
        let mut sizes: Vec<f64> = new.map(residual).collect();
        sizes.sort_by(f64::total_cmp);
        // Some frames may be off; a side that is off as a whole is another motion.
        let most = sizes.get(sizes.len() * 3 / 4).copied().unwrap_or(0.0);
        let explained = most <= allowed && fitted.usual_residual <= usual.max(grown);
        (explained && frames.len() >= LEAST).then_some(FreeMotion { frames, fitted, usual: motion.usual })
    }
}

#[cfg(test)]
mod tests {
    use paig::network::System;

    use super::*;

    /// What is not seen is explained by anything: a throw ends where it is last seen, not where the track does.
    #[test]
    fn a_part_begins_and_ends_where_the_object_is_seen() {
        let system = paig::tasks::builtin("falling").unwrap().system;
        let dynamics = Dynamics::new(System { objects: 1, ..system }, 0.1).unwrap();
        let times = dynamics.even_times(44);
        let mut positions = dynamics.positions(&[7.0_f64.ln()], &[3.0, 20.0, 2.0, -8.0], &times);
        for frame in (0..4).chain(20..22).chain(34..44) {
            positions[2 * frame..2 * frame + 2].fill(f64::NAN);
        }
        let found = free_motion(&dynamics, &Observations::new(positions, times, 44)).unwrap();
        assert_eq!(found.frames, 4..34);
    }
}
