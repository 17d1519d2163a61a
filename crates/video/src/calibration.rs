//! From pixels of a video to metres on the plane of the motion, seen at an angle and through a lens.

use anyhow::Result;
use paig_track::HALF_PIXEL;
use paig_track::calibration::{Lens, MotionPlane};

/// Plane of the motion by a rectangle of known size in it, and the lens.
///
/// Rectified frames are what a camera in front of the plane would film. They are as large as the filmed ones; at the middle of
/// the rectangle a pixel has the size that it has in the filmed frame, and the bottom of the rectangle is level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    plane: MotionPlane,
    lens: Option<Lens>,
    /// Pixels of a rectified frame to a metre.
    pub pixels_per_metre: f64,
    /// See [`MotionPlane::foreshortening`], at the middle of the rectangle.
    pub foreshortening: f64,
    /// Place of the plane's origin in a rectified frame, pixels; pixel centres are integers.
    origin: [f64; 2],
}

impl Calibration {
    /// By the corners of a rectangle in pixels of the video from its top left corner (bottom left, bottom right, top right, top
    /// left) and its width and height in metres.
    ///
    /// # Errors
    /// As [`MotionPlane::of_rectangle`].
    pub fn new(corners: [[f64; 2]; 4], [width, height]: [f64; 2], lens: Option<Lens>) -> Result<Self> {
        let centred = corners.map(|corner| corner.map(|place| place - HALF_PIXEL));
        let straight = centred.map(|corner| lens.map_or(corner, |lens| lens.straight(corner)));
        let plane = MotionPlane::of_rectangle(straight, width, height)?;
        let middle = [0.5 * width, 0.5 * height];
        let seen = plane.pixel(middle);
        let pixels_per_metre = 1.0 / plane.metres_per_pixel(seen);
        let shown = lens.map_or(seen, |lens| lens.bent(seen));
        let origin = [shown[0] - pixels_per_metre * middle[0], shown[1] + pixels_per_metre * middle[1]];
        Ok(Calibration { plane, lens, pixels_per_metre, foreshortening: plane.foreshortening(seen), origin })
    }

    /// Position and deviations on the plane, metres, of a position of the tracker.
    pub(crate) fn metres(&self, position: [f64; 2], covariance: [[f64; 2]; 2]) -> [f64; 4] {
        let straight = self.lens.map_or(position, |lens| lens.straight(position));
        let [x, y] = self.plane.metres(straight);
        let [[xx, _], [_, yy]] = self.plane.covariance(straight, covariance);
        [x, y, xx.sqrt(), yy.sqrt()]
    }

    /// Place in a rectified frame of a place in the filmed one; pixel centres are integers in both.
    pub fn rectified(&self, place: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.plane.metres(self.lens.map_or(place, |lens| lens.straight(place)));
        [self.origin[0] + self.pixels_per_metre * x, self.origin[1] - self.pixels_per_metre * y]
    }

    /// The inverse of [`Calibration::rectified`].
    pub(crate) fn filmed(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let metres = [(x - self.origin[0]) / self.pixels_per_metre, (self.origin[1] - y) / self.pixels_per_metre];
        let place = self.plane.pixel(metres);
        self.lens.map_or(place, |lens| lens.bent(place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rectangle_becomes_one_with_level_sides_and_the_given_size() {
        let corners = [[100.0, 300.0], [300.0, 270.0], [300.0, 110.0], [100.0, 80.0]];
        for lens in [None, Some(Lens::new(-0.1, 400, 400).unwrap())] {
            let calibration = Calibration::new(corners, [0.4, 0.4], lens).unwrap();
            let corner = |x: f64, y: f64| calibration.rectified([x - HALF_PIXEL, y - HALF_PIXEL]);
            let [a, b, c] = [corner(100.0, 300.0), corner(300.0, 270.0), corner(300.0, 110.0)];
            assert!((a[1] - b[1]).abs() < 1e-9 && (b[0] - c[0]).abs() < 1e-9, "{a:?} {b:?} {c:?}");
            assert!((b[0] - a[0] - 0.4 * calibration.pixels_per_metre).abs() < 1e-9);
            for place in [[120.0, 90.0], [250.0, 200.0]] {
                let back = calibration.filmed(calibration.rectified(place));
                assert!((back[0] - place[0]).hypot(back[1] - place[1]) < 1e-9, "{back:?}");
            }
        }
    }
}
