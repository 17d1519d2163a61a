//! Quality of a track.

use serde::{Deserialize, Serialize};

use crate::statistics::{NORMAL_MAD, median};
use crate::track::{Method, Point, Visibility};

/// Coefficients of the third and fifth difference, and the variance of each over that of white noise.
const THIRD: (&[f64], f64) = (&[-1.0, 3.0, -3.0, 1.0], 20.0);
const FIFTH: (&[f64], f64) = (&[-1.0, 5.0, -10.0, 10.0, -5.0, 1.0], 252.0);
/// Fewest differences that give a jitter, and fewest that correct a covariance.
const LEAST_DIFFERENCES: usize = 5;
const LEAST_CORRECTING: usize = 20;

/// Factors on a standard deviation. Jitter misses errors that change slowly; at low frame rates it contains the motion.
const FACTORS: std::ops::Range<f64> = 0.3..4.0;

/// What a track rests on. Shares are 0..=1; absent values could not be computed from so few frames.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Quality {
    /// Share of all frames with a position.
    pub followed: f64,
    /// Share of the frames between the first and the last position that have one.
    pub unbroken: f64,
    /// Share of the positions that come from the template.
    pub registered: f64,
    /// Median over the frames of the residual energy over the template's energy: 0 for a rigid object without noise, 1
    /// where the template explains nothing.
    pub misfit: f64,
    /// Median distance between the template's position and the region's centroid, less their mean offset, pixels.
    pub disagreement: f64,
    /// Noise of the positions along x and y from their third and fifth differences, pixels. Includes jitter of the time
    /// stamps and, at low frame rates, the motion's own derivatives.
    pub jitter: Option<[f64; 2]>,
    /// Median standard deviation of the positions along x and y, pixels.
    pub deviation: [f64; 2],
    /// Median second difference of the positions over that of the same positions in shuffled order: 1 is chance level.
    pub chance: Option<f64>,
    /// Extent of the path over the object's diameter.
    pub extent: f64,
    /// Score of the best other moving path over this one's.
    pub rival: f64,
}

/// Noise of positions along x and y: the smaller of the estimates from third and fifth differences over consecutive
/// frames. Fifth differences remove more of the motion, third ones reach less far across a bounce. `None` below `least`
/// differences.
pub(crate) fn jitter(positions: &[Option<[f64; 2]>], least: usize) -> Option<[f64; 2]> {
    let third = difference_noise(positions, THIRD, least)?;
    let fifth = difference_noise(positions, FIFTH, least).unwrap_or(third);
    Some([third[0].min(fifth[0]), third[1].min(fifth[1])])
}

fn difference_noise(
    positions: &[Option<[f64; 2]>],
    (coefficients, variance): (&[f64], f64),
    least: usize,
) -> Option<[f64; 2]> {
    let differences: Vec<[f64; 2]> = positions
        .windows(coefficients.len())
        .filter_map(|window| {
            window
                .iter()
                .zip(coefficients)
                .try_fold([0.0; 2], |sum, (position, c)| position.map(|p| [sum[0] + c * p[0], sum[1] + c * p[1]]))
        })
        .collect();
    (differences.len() >= least).then(|| {
        [0, 1].map(|axis| {
            let mut sizes: Vec<f64> = differences.iter().map(|d| d[axis].abs()).collect();
            median(&mut sizes).unwrap_or(0.0) * NORMAL_MAD / variance.sqrt()
        })
    })
}

/// Median second difference over that of the shuffled positions; `None` below 8 positions.
pub(crate) fn chance(positions: &[Option<[f64; 2]>]) -> Option<f64> {
    let present: Vec<[f64; 2]> = positions.iter().copied().flatten().collect();
    if present.len() < 8 {
        return None;
    }
    // A stride near the golden section visits all positions in an order far from theirs.
    let count = present.len();
    let mut stride = (count as f64 * 0.618_034) as usize;
    while greatest_common_divisor(stride, count) != 1 {
        stride += 1;
    }
    let shuffled: Vec<[f64; 2]> = (0..count).map(|i| present[i * stride % count]).collect();
    let bend = |values: &[[f64; 2]]| {
        let mut sizes: Vec<f64> = values
            .windows(3)
            .map(|w| (w[2][0] - 2.0 * w[1][0] + w[0][0]).hypot(w[2][1] - 2.0 * w[1][1] + w[0][1]))
            .collect();
        median(&mut sizes).unwrap_or(0.0)
    };
    let random = bend(&shuffled);
    (random > 0.0).then(|| bend(&present) / random)
}

/// Scales the template's covariances to the jitter of its positions. Residuals alone mislead both ways: compression and
/// pixel phases move the template by more, while a change of motion blur is symmetric and moves it by less.
pub(crate) fn calibrate(points: &mut [Point]) {
    let template = |p: &Point| p.measurement.filter(|m| m.method == Method::Template);
    let positions: Vec<Option<[f64; 2]>> = points.iter().map(|p| template(p).map(|m| m.position)).collect();
    let Some(jitter) = jitter(&positions, LEAST_CORRECTING) else { return };
    let factor = [0, 1].map(|axis| {
        let mut deviations: Vec<f64> =
            points.iter().filter_map(template).map(|m| m.covariance[axis][axis].sqrt()).collect();
        median(&mut deviations).map_or(1.0, |deviation| (jitter[axis] / deviation).clamp(FACTORS.start, FACTORS.end))
    });
    for measurement in points.iter_mut().filter_map(|p| p.measurement.as_mut()) {
        if measurement.method == Method::Template {
            for row in 0..2 {
                for column in 0..2 {
                    measurement.covariance[row][column] *= factor[row] * factor[column];
                }
            }
        }
    }
}

fn greatest_common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

/// Quality measures that follow from the points alone.
pub(crate) fn of_points(points: &[Point]) -> Quality {
    let positions: Vec<Option<[f64; 2]>> = points.iter().map(|p| p.measurement.map(|m| m.position)).collect();
    let present = positions.iter().flatten().count();
    let first = positions.iter().position(Option::is_some).unwrap_or(0);
    let last = positions.iter().rposition(Option::is_some).unwrap_or(0);
    let measured: Vec<_> = points.iter().filter_map(|p| p.measurement).collect();
    let registered = measured.iter().filter(|m| m.method == Method::Template).count();
    let deviation = [0, 1].map(|axis| {
        let mut values: Vec<f64> = measured.iter().map(|m| m.covariance[axis][axis].sqrt()).collect();
        median(&mut values).unwrap_or(0.0)
    });
    let mut misfits: Vec<f64> =
        points.iter().filter(|p| p.visibility != Visibility::Absent).filter_map(|p| p.misfit).collect();
    Quality {
        followed: present as f64 / points.len().max(1) as f64,
        unbroken: present as f64 / (last + 1 - first) as f64,
        registered: registered as f64 / measured.len().max(1) as f64,
        misfit: median(&mut misfits).unwrap_or(1.0),
        jitter: jitter(&positions, LEAST_DIFFERENCES),
        deviation,
        chance: chance(&positions),
        ..Quality::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_jitter_of_a_parabola_is_zero_and_of_alternating_noise_known() {
        let parabola: Vec<_> = (0..30).map(|i| Some([f64::from(i), 0.3 * f64::from(i * i)])).collect();
        assert!(jitter(&parabola, 5).unwrap().iter().all(|j| j.abs() < 1e-10));
        // Noise of alternating sign has third differences of 8 and fifth ones of 32 times its size.
        let alternating: Vec<_> = (0..30).map(|i| Some([if i % 2 == 0 { 0.1 } else { -0.1 }, 0.0])).collect();
        let expected = 0.8 * NORMAL_MAD / 20.0_f64.sqrt();
        assert!((jitter(&alternating, 5).unwrap()[0] - expected).abs() < 1e-12);
        assert_eq!(jitter(&alternating[..7], 5), None);
    }

    #[test]
    fn a_smooth_path_is_far_from_chance_and_a_random_one_is_not() {
        let smooth: Vec<_> = (0..100).map(|i| Some([50.0 * (f64::from(i) * 0.1).sin(), 0.0])).collect();
        assert!(chance(&smooth).unwrap() < 0.05);
        let random: Vec<_> = (0..200_u64).map(|i| Some([(i * i * 7919 % 101) as f64, (i * 31 % 97) as f64])).collect();
        assert!(chance(&random).unwrap() > 0.4, "{:?}", chance(&random));
    }
}
