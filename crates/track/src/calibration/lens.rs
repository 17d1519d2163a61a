//! Radial distortion of a lens with one coefficient: the division model (Fitzgibbon 2001).

use super::CalibrationError;

/// Fewest points on a line that show its bend.
const LEAST_POINTS: usize = 3;
/// Largest coefficient that is looked for.
const MOST: f64 = 0.5;
/// Least change of the lines' bend, in pixels, from no distortion to [`MOST`].
const LEAST_BEND: f64 = 2.0;

/// Lens: a pixel at the distance r from the middle, in half diagonals of the picture, lies at r / (1 + k r^2) without
/// distortion. Negative coefficients are those of wide lenses (barrel).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    pub coefficient: f64,
    middle: [f64; 2],
    radius: f64,
}

impl Lens {
    /// Lens of a picture of `width` by `height` pixels whose axis goes through the middle.
    ///
    /// # Errors
    /// A coefficient beyond (-1, 1): the map from pixels to places without distortion is not monotonic along a radius of the
    /// picture.
    pub fn new(coefficient: f64, width: usize, height: usize) -> Result<Self, CalibrationError> {
        // The map's derivative (1 - k r^2) / (1 + k r^2)^2 changes its sign or its value is infinite at r^2 = 1 / |k|.
        if coefficient.abs() < 1.0 {
            Ok(Self::of(coefficient, width, height))
        } else {
            Err(CalibrationError::Folded { coefficient, radius: coefficient.abs().powf(-0.5) })
        }
    }

    fn of(coefficient: f64, width: usize, height: usize) -> Self {
        let middle = [0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0)];
        Self { coefficient, middle, radius: middle[0].hypot(middle[1]) }
    }

    /// Lens that makes lines straight, each given by points along it, pixels.
    ///
    /// # Errors
    /// Lines of fewer than three points, and lines that no lens bends.
    pub fn of_straight_lines(lines: &[Vec<[f64; 2]>], width: usize, height: usize) -> Result<Self, CalibrationError> {
        let found = lines.iter().map(Vec::len).min().unwrap_or(0);
        if found < LEAST_POINTS {
            return Err(CalibrationError::FewPoints { least: LEAST_POINTS, found });
        }
        let bend = |coefficient: f64| {
            let lens = Self::of(coefficient, width, height);
            lines.iter().map(|line| bend(line.iter().map(|point| lens.straight(*point)))).sum::<f64>()
        };
        // The bend has one minimum: golden section.
        let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
        let (mut low, mut high) = (-MOST, MOST);
        while high - low > 1e-6 {
            let (a, b) = (high - ratio * (high - low), low + ratio * (high - low));
            if bend(a) < bend(b) {
                high = b;
            } else {
                low = a;
            }
        }
        let best = 0.5 * (low + high);
        if (bend(MOST).max(bend(-MOST)) - bend(best)).sqrt() < LEAST_BEND {
            return Err(CalibrationError::Unidentifiable);
        }
        Ok(Self::of(best, width, height))
    }

    /// Place of a pixel without distortion.
    pub fn straight(&self, pixel: [f64; 2]) -> [f64; 2] {
        let away = [0, 1].map(|axis| (pixel[axis] - self.middle[axis]) / self.radius);
        let factor = 1.0 / (1.0 + self.coefficient * (away[0] * away[0] + away[1] * away[1]));
        [0, 1].map(|axis| self.middle[axis] + factor * (pixel[axis] - self.middle[axis]))
    }

    /// Pixel at which a place without distortion is seen; the inverse of [`Lens::straight`].
    pub fn bent(&self, place: [f64; 2]) -> [f64; 2] {
        let away = [0, 1].map(|axis| (place[axis] - self.middle[axis]) / self.radius);
        let square = self.coefficient * (away[0] * away[0] + away[1] * away[1]);
        // The root of k s r^2 - r + s = 0 that is s where k is 0; beyond its range the lens shows nothing, and the edge stands in.
        let factor = 2.0 / (1.0 + (1.0 - 4.0 * square).max(0.0).sqrt());
        [0, 1].map(|axis| self.middle[axis] + factor * (place[axis] - self.middle[axis]))
    }
}

/// Sum of the squared distances of points from the line that fits them best, pixels^2.
fn bend(points: impl Iterator<Item = [f64; 2]>) -> f64 {
    let points: Vec<[f64; 2]> = points.collect();
    let mean = [0, 1].map(|axis| points.iter().map(|p| p[axis]).sum::<f64>() / points.len() as f64);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for point in &points {
        let [x, y] = [point[0] - mean[0], point[1] - mean[1]];
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    // Smaller eigenvalue of the scatter.
    0.5 * (xx + yy) - (0.5 * (xx - yy)).hypot(xy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn straight_lines_give_the_coefficient() {
        let lens = Lens::new(-0.12, 1280, 720).unwrap();
        let line = |from: [f64; 2], to: [f64; 2]| -> Vec<[f64; 2]> {
            (0..8)
                .map(|k| f64::from(k) / 7.0)
                .map(|t| lens.bent([from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])]))
                .collect()
        };
        let lines = [line([100.0, 80.0], [1150.0, 60.0]), line([120.0, 100.0], [140.0, 650.0])];
        let found = Lens::of_straight_lines(&lines, 1280, 720).unwrap();
        assert!((found.coefficient + 0.12).abs() < 1e-4, "{found:?}");
    }

    #[test]
    fn a_bent_place_is_straightened_to_where_it_was() {
        for coefficient in [-0.2, 0.0, 0.15] {
            let lens = Lens::new(coefficient, 1280, 720).unwrap();
            for place in [[100.0, 80.0], [640.0, 360.0], [1100.0, 500.0]] {
                let [x, y] = lens.straight(lens.bent(place));
                assert!((x - place[0]).hypot(y - place[1]) < 1e-9, "{coefficient} {place:?}: {x} {y}");
            }
        }
    }

    /// The largest coefficients that are taken still map each radius to another place; larger ones do not.
    #[test]
    fn a_lens_that_folds_the_picture_is_refused() {
        for coefficient in [-0.999, 0.999] {
            let lens = Lens::new(coefficient, 641, 481).unwrap();
            let along =
                (0..=100).map(|step| lens.straight([320.0 + 3.2 * f64::from(step), 240.0 + 2.4 * f64::from(step)])[0]);
            assert!(along.collect::<Vec<_>>().windows(2).all(|pair| pair[0] < pair[1]), "{coefficient}");
        }
        for coefficient in [-1.0, 1.0, -4.0, 100.0, f64::NAN] {
            assert!(Lens::new(coefficient, 641, 481).is_err(), "{coefficient}");
        }
        let said = Lens::new(100.0, 641, 481).unwrap_err().to_string();
        assert!(said.contains("100") && said.contains("at 0.100 of"), "{said}");
    }

    #[test]
    fn lines_through_the_middle_show_nothing() {
        let line: Vec<[f64; 2]> = (0..6).map(|k| [100.0 + 200.0 * f64::from(k), 359.5]).collect();
        assert_eq!(Lens::of_straight_lines(&[line], 1280, 720), Err(CalibrationError::Unidentifiable));
    }
}
