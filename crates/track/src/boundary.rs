//! Motion on both sides of the boundary between two frames.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use crate::statistics::median;
use crate::time_base::TimeBase;
use crate::track::Track;

/// Frames on either side of a boundary from which the motion there is extrapolated.
pub(crate) const SIDE: usize = 5;
/// Longest step within them, in usual ones.
const GAP: f64 = 2.5;

/// Position and velocity, pixels per usual step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PointState {
    pub(crate) position: [f64; 2],
    pub(crate) velocity: [f64; 2],
    /// Root mean square distance of the positions from their parabola, corrected for its parameters, pixels.
    pub(crate) residual: f64,
}

/// States in the middle between a frame and the one before, from parabolas through the frames of each side.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Boundary {
    pub(crate) frame: usize,
    pub(crate) before: PointState,
    pub(crate) after: PointState,
}

/// Boundaries of a track.
pub(crate) struct TrackBoundaries {
    /// Noise of a position, pixels.
    pub(crate) noise: f64,
    /// All boundaries without a gap around them.
    pub(crate) boundaries: Vec<Boundary>,
}

impl TrackBoundaries {
    /// Boundaries between the frames of a track that show something new; `None` where it has too few.
    pub(crate) fn of(track: &Track, base: &TimeBase) -> Option<Self> {
        let found: Vec<(usize, [f64; 2])> = track
            .points
            .iter()
            .filter(|p| base.stale.binary_search(&p.frame).is_err())
            .filter_map(|p| p.measurement.map(|m| (p.frame, m.position)))
            .collect();
        let noise = track.quality.jitter.unwrap_or(track.quality.deviation);
        let mut steps: Vec<f64> = found.windows(2).map(|w| base.time(w[1].0) - base.time(w[0].0)).collect();
        let interval = median(&mut steps).filter(|interval| *interval > 0.0)?;
        let boundaries = (SIDE..found.len().saturating_sub(SIDE - 1))
            .filter_map(|place| boundary(&found[place - SIDE..place + SIDE], |frame| base.time(frame) / interval))
            .collect();
        Some(Self { noise: noise[0].max(noise[1]).max(0.05), boundaries })
    }
}

fn boundary(found: &[(usize, [f64; 2])], time: impl Fn(usize) -> f64) -> Option<Boundary> {
    let times: Vec<f64> = found.iter().map(|(frame, _)| time(*frame)).collect();
    if times.windows(2).any(|w| w[1] - w[0] > GAP || w[1] <= w[0]) {
        return None;
    }
    let middle = 0.5 * (times[SIDE - 1] + times[SIDE]);
    let state = |range: Range<usize>| -> Option<PointState> {
        let rows = DMatrix::from_fn(SIDE, 3, |row, power| (times[range.start + row] - middle).powi(power as i32));
        let decomposed = rows.clone().svd(true, true);
        let mut square = 0.0;
        let fitted = [0, 1].map(|axis| {
            let values = DVector::from_fn(SIDE, |row, _| found[range.start + row].1[axis]);
            let solution = decomposed.solve(&values, 1e-9).ok()?;
            square += (&rows * &solution - values).norm_squared();
            Some(solution)
        });
        let [Some(x), Some(y)] = fitted else { return None };
        let residual = (square / (2 * (SIDE - 3)) as f64).sqrt();
        Some(PointState { position: [x[0], y[0]], velocity: [x[1], y[1]], residual })
    };
    Some(Boundary { frame: found[SIDE].0, before: state(0..SIDE)?, after: state(SIDE..2 * SIDE)? })
}

/// Length of a vector.
pub(crate) fn size([x, y]: [f64; 2]) -> f64 {
    x.hypot(y)
}
