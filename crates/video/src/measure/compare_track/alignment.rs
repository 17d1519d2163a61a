//! Similarity between the positions of two tracks of one motion.

use nalgebra::Complex;
use paig::support::statistics::upper_median;
use serde::Serialize;

/// Rounds of reweighting, and the distance in medians beyond which a pair counts less (Huber 1964).
const ROUNDS: usize = 12;
const HUBER: f64 = 2.0;
/// Distance below which no pair counts more than others, pixels.
const LEAST: f64 = 1e-9;

/// Positions of the same object in the same frame: those of the other track, and ours in pixels of the video.
pub(super) type PositionPair = ([f64; 2], [f64; 2]);

/// Maps positions of the other track to pixels of the video: `a z + b` of complex numbers, `z` conjugated where its y axis points up.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Alignment {
    /// Pixels of the video to a unit of the other track.
    pub pixels_per_unit: f64,
    /// Turn from its x axis to the video's, degrees, clockwise.
    pub degrees: f64,
    pub y_up: bool,
    pub offset: [f64; 2],
    /// Frames by which the other track's numbering is behind.
    pub shift: i64,
    #[serde(skip)]
    pub(super) a: Complex<f64>,
}

impl Alignment {
    /// An offset alone: of tracks in pixels of the same video.
    pub(super) fn offset(pairs: &[PositionPair]) -> Self {
        Self::fitted(pairs, false, Some(Complex::new(1.0, 0.0)))
    }

    /// The similarity with the smaller residual of both directions of the y axis.
    pub(super) fn similarity(pairs: &[PositionPair]) -> Self {
        let [down, up] = [false, true].map(|y_up| Self::fitted(pairs, y_up, None));
        // A motion along a line obeys both; then y points down, as in the video.
        if up.median(pairs) < 0.99 * down.median(pairs) { up } else { down }
    }

    /// Least squares, reweighted for outliers; `turn` is `a` where it is known.
    fn fitted(pairs: &[PositionPair], y_up: bool, turn: Option<Complex<f64>>) -> Self {
        let points: Vec<_> = pairs.iter().map(|(z, w)| (complex(*z, y_up), complex(*w, false))).collect();
        let mut weights = vec![1.0; pairs.len()];
        let (mut a, mut b) = (Complex::new(1.0, 0.0), Complex::new(0.0, 0.0));
        for _ in 0..ROUNDS {
            let total: f64 = weights.iter().sum();
            let weighted = || points.iter().zip(&weights).map(|((z, w), weight)| (z, w, weight / total));
            let z: Complex<f64> = weighted().map(|(z, _, weight)| z * weight).sum();
            let w: Complex<f64> = weighted().map(|(_, w, weight)| w * weight).sum();
            let across: Complex<f64> =
                weighted().map(|(own, other, weight)| (own - z).conj() * (other - w) * weight).sum();
            let extent: f64 = weighted().map(|(own, _, weight)| (own - z).norm_sqr() * weight).sum();
            a = turn.unwrap_or(if extent > 0.0 { across / extent } else { a });
            b = w - a * z;
            let distances: Vec<f64> = points.iter().map(|(z, w)| (a * z + b - w).norm()).collect();
            let bound = (HUBER * upper_median(distances.iter().copied()).unwrap_or(0.0)).max(LEAST);
            weights = distances.iter().map(|distance| (bound / distance.max(LEAST)).min(1.0)).collect();
        }
        let (pixels_per_unit, angle) = a.to_polar();
        Alignment { pixels_per_unit, degrees: angle.to_degrees(), y_up, offset: [b.re, b.im], shift: 0, a }
    }

    pub(super) fn is_offset(&self) -> bool {
        self.a == Complex::new(1.0, 0.0) && !self.y_up
    }

    /// A position of the other track in pixels of the video.
    pub(super) fn apply(&self, at: [f64; 2]) -> [f64; 2] {
        let place = self.a * complex(at, self.y_up);
        [place.re + self.offset[0], place.im + self.offset[1]]
    }

    /// Distances that are left, pixels of the video.
    pub(super) fn distances(&self, pairs: &[PositionPair]) -> Vec<f64> {
        let distance = |(theirs, ours): &PositionPair| {
            let at = self.apply(*theirs);
            (at[0] - ours[0]).hypot(at[1] - ours[1])
        };
        pairs.iter().map(distance).collect()
    }

    pub(super) fn median(&self, pairs: &[PositionPair]) -> f64 {
        upper_median(self.distances(pairs)).unwrap_or(f64::INFINITY)
    }
}

fn complex([x, y]: [f64; 2], y_up: bool) -> Complex<f64> {
    Complex::new(x, if y_up { -y } else { y })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ours is theirs in metres, y up, turned by 30 degrees, 200 px to a metre; one pair is far off.
    #[test]
    fn a_similarity_is_found_beside_an_outlier() {
        let turn = Complex::from_polar(200.0, 30.0_f64.to_radians());
        let pair = |step: i32| {
            let t = 0.1 * f64::from(step);
            let theirs = [t, 2.0 * t - t * t];
            let ours = turn * complex(theirs, true) + Complex::new(50.0, 400.0);
            (theirs, [ours.re + if step == 7 { 90.0 } else { 0.0 }, ours.im])
        };
        let pairs: Vec<PositionPair> = (0..30).map(pair).collect();
        let alignment = Alignment::similarity(&pairs);
        // The outlier's pull falls with each round of reweighting.
        assert!(alignment.y_up && (alignment.pixels_per_unit / 200.0 - 1.0).abs() < 1e-3, "{alignment:?}");
        assert!((alignment.degrees - 30.0).abs() < 0.1 && alignment.median(&pairs) < 0.1, "{alignment:?}");
    }
}
