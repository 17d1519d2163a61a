//! What a motion over a whole video shows at a glance: how far it swings, and how long a swing takes.

use nalgebra::Matrix2;
use rand::seq::SliceRandom;

use super::fit::Observations;
use paig::support::random::named_generator;
use paig::support::statistics::{MEDIAN_TO_DEVIATION, upper_median};

/// Cycles from which on a motion counts as a swing, and how far their lengths may differ.
const LEAST_CYCLES: usize = 2;
const EVEN: f64 = 0.2;
/// Rounds in which the level about which a motion swings is found.
const ROUNDS: usize = 4;

/// What the positions of a track say by themselves, in the unit of a coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackMotion {
    /// Share of the frames in which all objects are seen.
    pub seen: f64,
    /// Half of the way from one end to the other.
    pub amplitude: f64,
    /// Noise of a coordinate from third differences; contains the motion's own third derivative.
    pub noise: f64,
    /// Median second difference over that of the same positions in shuffled order: 1 is chance. None of few frames.
    pub chance: Option<f64>,
}

/// Variance of third differences over that of white noise.
const THIRD_DIFFERENCES: f64 = 20.0;
/// Fewest frames of which chance is known.
const LEAST_FRAMES: usize = 8;

impl TrackMotion {
    /// Of the frames of a track.
    pub fn of(track: &Observations, coordinates: usize) -> Self {
        let frames: Vec<&[f64]> =
            track.positions.chunks(coordinates).filter(|frame| frame.iter().all(|x| x.is_finite())).collect();
        let present: Vec<f64> = frames.iter().flat_map(|frame| frame.iter().copied()).collect();
        let third = frames.windows(4).flat_map(|w| {
            (0..coordinates).map(|c| (w[3][c] - 3.0 * w[2][c] + 3.0 * w[1][c] - w[0][c]).abs()).collect::<Vec<_>>()
        });
        let third = upper_median(third).unwrap_or(0.0);
        TrackMotion {
            seen: frames.len() as f64 / track.times.len().max(1) as f64,
            amplitude: amplitude(&along_the_way(&present, coordinates)),
            noise: third * MEDIAN_TO_DEVIATION / THIRD_DIFFERENCES.sqrt(),
            chance: chance(&frames),
        }
    }
}

fn chance(frames: &[&[f64]]) -> Option<f64> {
    if frames.len() < LEAST_FRAMES {
        return None;
    }
    let bend = |frames: &[&[f64]]| {
        let sizes = frames.windows(3).map(|w| {
            let bends = w[0].iter().zip(w[1]).zip(w[2]).map(|((a, b), c)| (c - 2.0 * b + a).powi(2));
            bends.sum::<f64>().sqrt()
        });
        upper_median(sizes).unwrap_or(0.0)
    };
    let mut shuffled = frames.to_vec();
    shuffled.shuffle(&mut named_generator(0, "chance"));
    let random = bend(&shuffled);
    (random > 0.0).then(|| bend(frames) / random)
}

/// The first object's positions, frame by frame, along the line on which it moves most. `coordinates`: numbers of a
/// frame; one of them is an angle.
pub fn along_the_way(positions: &[f64], coordinates: usize) -> Vec<f64> {
    if coordinates == 1 {
        return positions.to_vec();
    }
    let frames = || positions.chunks(coordinates).map(|frame| [frame[0], frame[1]]);
    let count = frames().count().max(1) as f64;
    let mean = frames().fold([0.0; 2], |sum, [x, y]| [sum[0] + x / count, sum[1] + y / count]);
    let centred = || frames().map(|[x, y]| [x - mean[0], y - mean[1]]);
    let covariance = centred().fold(Matrix2::zeros(), |sum, [x, y]| sum + Matrix2::new(x * x, x * y, x * y, y * y));
    let eigen = covariance.symmetric_eigen();
    let way = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    // Whichever way round it is found, x or y grows along it.
    let sign = if way[way.iamax()] < 0.0 { -1.0 } else { 1.0 };
    centred().map(|[x, y]| sign * (x * way[0] + y * way[1])).collect()
}

/// Half of the way from one end to the other.
pub fn amplitude(along: &[f64]) -> f64 {
    let (least, most) = along.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
    (most - least) / 2.0
}

/// Mean duration of a cycle, frames; none of a motion that does not swing evenly.
pub fn period(along: &[f64]) -> Option<f64> {
    let mut level = along.iter().sum::<f64>() / along.len().max(1) as f64;
    let mut upwards = Vec::new();
    for _ in 0..ROUNDS {
        upwards = crossings(along, level);
        let (first, last) = (*upwards.first()?, *upwards.last()?);
        if upwards.len() <= LEAST_CYCLES {
            return None;
        }
        // Over whole cycles a swing's mean is what it swings about.
        let whole = &along[first.ceil() as usize..last.floor() as usize];
        level = whole.iter().sum::<f64>() / whole.len().max(1) as f64;
    }
    let cycles = upwards.windows(2).map(|pair| pair[1] - pair[0]);
    let mean = (upwards.last()? - upwards[0]) / (upwards.len() - 1) as f64;
    let even = cycles.into_iter().all(|cycle| (cycle / mean - 1.0).abs() < EVEN);
    even.then_some(mean)
}

/// When the level is passed upwards, frames.
fn crossings(along: &[f64], level: f64) -> Vec<f64> {
    let pairs = along.windows(2).enumerate();
    let passed = pairs.filter(|(_, pair)| pair[0] < level && pair[1] >= level);
    passed.map(|(frame, pair)| frame as f64 + (level - pair[0]) / (pair[1] - pair[0])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_damped_swing_has_its_period_and_a_fall_has_none() {
        let swing: Vec<f64> = (0..500)
            .flat_map(|frame| {
                let time = f64::from(frame);
                let along = 8.0 * (-0.001 * time).exp() * (time * std::f64::consts::TAU / 61.3 + 0.4).sin();
                [20.0 + 0.8 * along, 11.0 - 0.6 * along]
            })
            .collect();
        let along = along_the_way(&swing, 2);
        let period_found = period(&along).unwrap();
        // Between the frames the crossing is taken on a straight line.
        assert!((period_found - 61.3).abs() < 0.02, "{period_found}");
        assert!((amplitude(&along) - 7.9).abs() < 0.15, "{}", amplitude(&along));
        let fall: Vec<f64> = (0..100).flat_map(|frame| [3.0, 0.01 * f64::from(frame).powi(2)]).collect();
        assert_eq!(period(&along_the_way(&fall, 2)), None);
    }
}
