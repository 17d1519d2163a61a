//! What the camera does to the positions: distortion by the lens, and a plane of motion that is seen at an angle. Each is tried as
//! a correction of the observed positions, with the same equation.

use paig::network::cells::Coordinates;

use super::explain::{Explained, explain_again};
use super::fit::{Observations, thinned};
use super::recording::RecordedSystem;

/// First step of a coefficient, its largest size, and rounds of the search.
const STEP: f64 = 0.01;
const LARGEST: f64 = 0.4;
const ROUNDS: usize = 3;

/// A way in which the camera may change what is seen, by one coefficient or two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ViewDistortion {
    /// Radial distortion about the middle of the picture; the coefficient is the shift at its corner over the distance from the
    /// middle.
    Lens,
    /// Perspective: the change of scale from the middle of the picture to a corner's distance, along x and along y.
    Perspective,
}

/// A correction with the fit to the corrected positions.
pub(super) struct Corrected {
    pub view: ViewDistortion,
    pub coefficients: Vec<f64>,
    pub explained: Explained,
    /// Extent of the corrected positions over that of the observed: what residuals are divided by to be compared.
    pub magnification: f64,
}

impl ViewDistortion {
    pub const ALL: [ViewDistortion; 2] = [ViewDistortion::Lens, ViewDistortion::Perspective];

    pub fn name(self) -> &'static str {
        match self {
            ViewDistortion::Lens => "lens distortion",
            ViewDistortion::Perspective => "perspective: the plane of the motion is seen at an angle",
        }
    }

    /// Names of the coefficients.
    pub fn coefficients(self) -> &'static [&'static str] {
        match self {
            ViewDistortion::Lens => &["distortion_at_the_corner"],
            ViewDistortion::Perspective => &["scale_along_x", "scale_along_y"],
        }
    }

    /// Where a place, from the middle of the picture in units of the distance of its corner, would be seen without it.
    fn corrected(self, coefficients: &[f64], [x, y]: [f64; 2]) -> [f64; 2] {
        match self {
            ViewDistortion::Lens => {
                let factor = 1.0 + coefficients[0] * (x * x + y * y);
                [x * factor, y * factor]
            }
            ViewDistortion::Perspective => {
                let factor = 1.0 / (1.0 + coefficients[0] * x + coefficients[1] * y);
                [x * factor, y * factor]
            }
        }
    }

    /// The coefficients with which an equation leaves least; none where it cannot be fitted. They are found on as many frames as
    /// lead to the whole track.
    pub fn fitted(self, scene: &RecordedSystem, tracks: &[Observations], judged: &Explained) -> Option<Corrected> {
        if judged.dynamics.system.cell.coordinates != Coordinates::Position {
            return None;
        }
        let frame = PictureExtent::of(scene);
        let few: Vec<Observations> = tracks.iter().map(thinned).collect();
        let mut best = self.at(&vec![0.0; self.coefficients().len()], &frame, (scene, &few), judged)?;
        let mut step = STEP;
        for _ in 0..ROUNDS {
            for place in 0..best.coefficients.len() {
                let beside = |by: f64| {
                    let mut coefficients = best.coefficients.clone();
                    coefficients[place] = (coefficients[place] + by).clamp(-LARGEST, LARGEST);
                    self.at(&coefficients, &frame, (scene, &few), &best.explained)
                };
                let (below, above) = (beside(-step)?, beside(step)?);
                let [low, middle, high] = [&below, &best, &above].map(Corrected::cost);
                // The vertex of the parabola through the three.
                let bend = low - 2.0 * middle + high;
                let way = if bend > 0.0 { 0.5 * (low - high) / bend } else { (low - high).signum() * 4.0 };
                let vertex = beside(step * way.clamp(-20.0, 20.0))?;
                let candidates = [below, above, vertex];
                let better = candidates.into_iter().min_by(|a, b| a.cost().total_cmp(&b.cost()))?;
                if better.cost() < best.cost() {
                    best = better;
                }
            }
            step *= 0.5;
        }
        self.at(&best.coefficients, &frame, (scene, tracks), &best.explained)
    }

    fn at(
        self,
        coefficients: &[f64],
        frame: &PictureExtent,
        (scene, tracks): (&RecordedSystem, &[Observations]),
        before: &Explained,
    ) -> Option<Corrected> {
        let corrected: Vec<Observations> = tracks.iter().map(|track| self.track(track, coefficients, frame)).collect();
        let magnification = extent(&corrected) / extent(tracks);
        let explained = explain_again(before, &corrected, scene.piece).ok()?;
        let coefficients = coefficients.to_vec();
        Some(Corrected { view: self, coefficients, explained, magnification })
    }

    fn track(self, track: &Observations, coefficients: &[f64], frame: &PictureExtent) -> Observations {
        let place = |at: &[f64]| {
            let from_middle = [0, 1].map(|axis| (at[axis] - frame.middle[axis]) / frame.corner);
            let corrected = self.corrected(coefficients, from_middle);
            [0, 1].map(|axis| frame.middle[axis] + frame.corner * corrected[axis])
        };
        Observations { positions: track.positions.chunks(2).flat_map(place).collect(), ..track.clone() }
    }
}

impl Corrected {
    /// Mean loss of the residuals as they are seen.
    fn cost(&self) -> f64 {
        self.explained.errors.learned / self.magnification
    }
}

/// The picture in the coordinates of the equation.
struct PictureExtent {
    middle: [f64; 2],
    /// Distance of a corner from the middle.
    corner: f64,
}

impl PictureExtent {
    fn of(scene: &RecordedSystem) -> Self {
        let [width, height] = scene.record.size.map(|side| side as f64);
        let middle = scene.scale.in_frame([width / 2.0, height / 2.0]);
        PictureExtent { middle, corner: width.hypot(height) / 2.0 / scene.scale.video_pixels }
    }
}

/// Root mean square distance of the positions from their mean, over all tracks.
fn extent(tracks: &[Observations]) -> f64 {
    let seen = || {
        tracks.iter().flat_map(|track| track.positions.chunks(2)).filter(|at| at[0].is_finite() && at[1].is_finite())
    };
    let count = seen().count().max(1) as f64;
    let mean = seen().fold([0.0; 2], |sum, at| [sum[0] + at[0] / count, sum[1] + at[1] / count]);
    (seen().map(|at| (at[0] - mean[0]).powi(2) + (at[1] - mean[1]).powi(2)).sum::<f64>() / count).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_view_without_coefficients_changes_nothing_and_the_corner_is_where_it_is_said() {
        assert_eq!(ViewDistortion::Lens.corrected(&[0.0], [0.3, 0.4]), [0.3, 0.4]);
        assert_eq!(ViewDistortion::Perspective.corrected(&[0.0, 0.0], [0.3, 0.4]), [0.3, 0.4]);
        // At the corner (0.6, 0.8) a coefficient of 0.1 moves a place outwards by a tenth.
        let [x, y] = ViewDistortion::Lens.corrected(&[0.1], [0.6, 0.8]);
        assert!((x - 0.66).abs() < 1e-12 && (y - 0.88).abs() < 1e-12);
        // The right side is nearer to the camera by a fifth.
        let [x, _] = ViewDistortion::Perspective.corrected(&[0.25, 0.0], [1.0, 0.0]);
        assert!((x - 0.8).abs() < 1e-12);
    }
}
