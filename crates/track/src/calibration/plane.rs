//! Plane of the motion seen at an angle: the homography of a rectangle of known size (Hartley and Zisserman 2004, 4.1).

use nalgebra::{Matrix2, Matrix3, SMatrix, SVector, Vector3};

use super::CalibrationError;

/// Foreshortening of a rectangle beyond which its corners are not those of its sides: 87 degrees from the front.
const EDGE_ON: f64 = 20.0;

/// Plane of the motion: maps pixels to metres and back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionPlane {
    to_metres: Matrix3<f64>,
    to_pixels: Matrix3<f64>,
}

impl MotionPlane {
    /// Plane of a rectangle of `width` by `height` metres whose corners are seen at these places, pixels: bottom left, bottom
    /// right, top right, top left. The origin is the bottom left corner, x runs along the bottom, y up.
    ///
    /// # Errors
    /// Sides that are not positive; corners that are not in order around a convex shape, or show a rectangle of these sides from its
    /// edge.
    pub fn of_rectangle(corners: [[f64; 2]; 4], width: f64, height: f64) -> Result<Self, CalibrationError> {
        if !(width > 0.0 && height > 0.0 && width.is_finite() && height.is_finite()) {
            return Err(CalibrationError::Sides { width, height });
        }
        // The same sense of turning at each corner.
        let turns = [0, 1, 2, 3].map(|k| {
            let [a, b, c] = [corners[k], corners[(k + 1) % 4], corners[(k + 2) % 4]];
            (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
        });
        if !(turns.iter().all(|turn| *turn > 0.0) || turns.iter().all(|turn| *turn < 0.0)) {
            return Err(CalibrationError::Corners);
        }
        let metres = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
        let to_pixels = homography(metres, corners).ok_or(CalibrationError::Corners)?;
        let to_metres = to_pixels.try_inverse().ok_or(CalibrationError::Corners)?;
        let plane = Self { to_metres, to_pixels };
        let ratio = plane.foreshortening(plane.pixel([0.5 * width, 0.5 * height]));
        if ratio.is_nan() || ratio > EDGE_ON {
            return Err(CalibrationError::EdgeOn { width, height, most: EDGE_ON });
        }
        Ok(plane)
    }

    /// Metres per pixel in the direction in which they are most over those in the direction in which they are least, at a pixel: 1
    /// from the front, 1 / cos of the angle obliquely.
    pub fn foreshortening(&self, pixel: [f64; 2]) -> f64 {
        let sizes = self.jacobian(pixel).singular_values();
        sizes[0].max(sizes[1]) / sizes[0].min(sizes[1])
    }

    /// Place on the plane of a pixel, metres.
    pub fn metres(&self, pixel: [f64; 2]) -> [f64; 2] {
        mapped(&self.to_metres, pixel)
    }

    /// Pixel of a place on the plane.
    pub fn pixel(&self, metres: [f64; 2]) -> [f64; 2] {
        mapped(&self.to_pixels, metres)
    }

    /// Covariance on the plane, m^2, of a position with a covariance in pixels^2.
    pub fn covariance(&self, pixel: [f64; 2], covariance: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
        let jacobian = self.jacobian(pixel);
        let [[xx, xy], [yx, yy]] = covariance;
        let result = jacobian * Matrix2::new(xx, xy, yx, yy) * jacobian.transpose();
        [[result[(0, 0)], result[(0, 1)]], [result[(1, 0)], result[(1, 1)]]]
    }

    /// Metres per pixel at a pixel, the geometric mean over the directions.
    pub fn metres_per_pixel(&self, pixel: [f64; 2]) -> f64 {
        self.jacobian(pixel).determinant().abs().sqrt()
    }

    fn jacobian(&self, [x, y]: [f64; 2]) -> Matrix2<f64> {
        let h = &self.to_metres;
        let [u, v, w] = (h * Vector3::new(x, y, 1.0)).into();
        let row =
            |value: f64, row: usize| [0, 1].map(|column| (h[(row, column)] * w - value * h[(2, column)]) / (w * w));
        let (across, up) = (row(u, 0), row(v, 1));
        Matrix2::new(across[0], across[1], up[0], up[1])
    }
}

fn mapped(map: &Matrix3<f64>, [x, y]: [f64; 2]) -> [f64; 2] {
    let [u, v, w] = (map * Vector3::new(x, y, 1.0)).into();
    [u / w, v / w]
}

/// Homography that takes four points to four others.
fn homography(from: [[f64; 2]; 4], to: [[f64; 2]; 4]) -> Option<Matrix3<f64>> {
    let mut rows = SMatrix::<f64, 8, 8>::zeros();
    let mut values = SVector::<f64, 8>::zeros();
    for (k, ([x, y], [u, v])) in from.into_iter().zip(to).enumerate() {
        rows.set_row(2 * k, &[x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y].into());
        rows.set_row(2 * k + 1, &[0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y].into());
        (values[2 * k], values[2 * k + 1]) = (u, v);
    }
    let h = rows.lu().solve(&values)?;
    Some(Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixel of a place on a plane turned by 30 degrees about its vertical axis, 3 m before a camera of 1000 pixels focal
    /// length.
    fn seen([x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = 30.0_f64.to_radians().sin_cos();
        let depth = 3.0 + sin * (x - 0.5);
        [640.0 + 1000.0 * cos * (x - 0.5) / depth, 360.0 - 1000.0 * (y - 0.5) / depth]
    }

    #[test]
    fn places_on_a_plane_at_thirty_degrees_are_found() {
        let (width, height) = (1.2, 0.8);
        let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].map(seen);
        let plane = MotionPlane::of_rectangle(corners, width, height).unwrap();
        for place in [[0.3, 0.4], [1.5, -0.2], [-0.4, 1.1]] {
            let found = plane.metres(seen(place));
            assert!((found[0] - place[0]).abs() < 1e-9 && (found[1] - place[1]).abs() < 1e-9, "{found:?}");
            let back = plane.pixel(place);
            assert!((back[0] - seen(place)[0]).abs() < 1e-9);
            // The Jacobian is that of the map.
            let step = 1e-4;
            let [x, y] = seen(place);
            let beside = plane.metres([x + step, y]);
            let slope = [0, 1].map(|k| (beside[k] - place[k]) / step);
            let spread = plane.covariance([x, y], [[1.0, 0.0], [0.0, 0.0]]);
            assert!(
                (spread[0][0] - slope[0] * slope[0]).abs() < 1e-8 && (spread[0][1] - slope[0] * slope[1]).abs() < 1e-8
            );
        }
    }

    #[test]
    fn corners_out_of_order_are_refused() {
        let corners = [[0.0, 0.0], [100.0, 80.0], [100.0, 0.0], [0.0, 80.0]];
        assert_eq!(MotionPlane::of_rectangle(corners, 1.0, 1.0), Err(CalibrationError::Corners));
        let corners = [[0.0, 0.0], [100.0, 0.0], [100.0, 80.0], [0.0, 80.0]];
        assert!(matches!(MotionPlane::of_rectangle(corners, 0.0, 1.0), Err(CalibrationError::Sides { .. })));
    }

    #[test]
    fn sides_that_the_corners_cannot_show_are_refused() {
        let corners = [[0.0, 80.0], [100.0, 80.0], [100.0, 0.0], [0.0, 0.0]];
        let ratio = |width: f64, height: f64| {
            let plane = MotionPlane::of_rectangle(corners, width, height)?;
            Ok::<_, CalibrationError>(plane.foreshortening([50.0, 40.0]))
        };
        // From the front, and where the height is seen at half its length.
        assert!((ratio(1.0, 0.8).unwrap() - 1.0).abs() < 1e-9 && (ratio(1.0, 1.6).unwrap() - 2.0).abs() < 1e-9);
        for (width, height) in [(1e9, 1e-9), (1e-9, 1e9), (1.0, 0.03)] {
            assert!(matches!(ratio(width, height), Err(CalibrationError::EdgeOn { .. })), "{width} x {height}");
        }
    }
}
