//! Whether an object's size, and so the scale, changes along its way.

use nalgebra::{Matrix3, Vector3};

use crate::boundary::size;
use crate::statistics::{NORMAL_MAD, median};
use crate::track::{Track, Visibility};

/// Fewest frames that show a change of size.
const LEAST_FRAMES: usize = 20;
/// Change of the size between the ends of the way that matters.
const MATTERS: f64 = 0.04;
/// Standard errors by which it must exceed chance; sizes of neighbouring frames are alike.
const CERTAIN: f64 = 6.0;

/// One line where the apparent size of an object changes along one direction of the picture: it comes nearer or goes away,
/// and one scale does not hold. `None` where the size stays, or too few frames show it whole.
pub fn depth_line(track: &Track) -> Option<String> {
    let points: Vec<DiameterSample> = track
        .points
        .windows(3)
        .filter(|near| near.iter().all(|p| p.visibility == Visibility::Visible))
        .filter_map(|near| {
            let place = |k: usize| near[k].measurement.map(|m| m.position);
            let (before, at, after) = (place(0)?, place(1)?, place(2)?);
            Some(DiameterSample {
                at,
                speed: size([after[0] - before[0], after[1] - before[1]]),
                diameter: near[1].diameter?,
            })
        })
        .collect();
    if points.len() < LEAST_FRAMES {
        return None;
    }
    let usual = median(&mut points.iter().map(|p| p.diameter).collect::<Vec<_>>())?;
    let changes = [0, 1].map(|axis| change(&points, axis, usual));
    let (axis, (change, error)) = changes
        .into_iter()
        .enumerate()
        .filter_map(|(axis, found)| Some((axis, found?)))
        .max_by(|a, b| a.1.0.abs().total_cmp(&b.1.0.abs()))?;
    (change.abs() > MATTERS && change.abs() > CERTAIN * error).then(|| {
        let side = ["from left to right", "from top to bottom"][axis];
        format!(
            "the object looks {:.0} % {} {side}: it moves in depth, or the plane is seen at an angle; one scale does not hold",
            100.0 * change.abs(),
            if change > 0.0 { "larger" } else { "smaller" }
        )
    })
}

/// An object in one frame.
struct DiameterSample {
    at: [f64; 2],
    /// Pixels per two frames: motion blur makes a fast object look larger.
    speed: f64,
    diameter: f64,
}

/// Relative change of the diameter over the range along an axis, by least squares with the speed as another cause, and its
/// standard error. `None` where the object does not move along the axis.
fn change(points: &[DiameterSample], axis: usize, usual: f64) -> Option<(f64, f64)> {
    let range = points.iter().map(|p| p.at[axis]).fold(f64::NEG_INFINITY, f64::max)
        - points.iter().map(|p| p.at[axis]).fold(f64::INFINITY, f64::min);
    let fastest = points.iter().map(|p| p.speed).fold(1e-9, f64::max);
    if range < usual {
        return None;
    }
    let mean = points.iter().map(|p| p.at[axis]).sum::<f64>() / points.len() as f64;
    let row = |p: &DiameterSample| Vector3::new(1.0, (p.at[axis] - mean) / range, p.speed / fastest);
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for point in points {
        normal += row(point) * row(point).transpose();
        right += row(point) * (point.diameter / usual);
    }
    // A steady speed is no cause that differs.
    normal[(2, 2)] += 1e-6 * points.len() as f64;
    let inverse = normal.try_inverse()?;
    let found = inverse * right;
    let mut rests: Vec<f64> = points.iter().map(|p| (p.diameter / usual - row(p).dot(&found)).abs()).collect();
    let noise = NORMAL_MAD * median(&mut rests)?;
    Some((found[1], noise * inverse[(1, 1)].sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quality::Quality;
    use crate::track::{Method, Point, Role, TrackPoint};

    fn track(diameter: impl Fn(f64) -> f64) -> Track {
        let point = |frame: usize| {
            let x = 10.0 * frame as f64;
            let noise = 0.3 * ((frame * 7919 % 13) as f64 / 6.0 - 1.0);
            Point {
                frame,
                visibility: Visibility::Visible,
                measurement: Some(TrackPoint {
                    position: [x, 50.0],
                    covariance: [[0.01; 2]; 2],
                    method: Method::Template,
                }),
                centroid: None,
                misfit: None,
                contrast: None,
                diameter: Some(diameter(x) + noise),
            }
        };
        let points = (0..40).map(point).collect();
        Track { role: Role::Object, points, quality: Quality::default(), diameter: 24.0, bin: 1 }
    }

    #[test]
    fn an_object_that_grows_along_its_way_is_named() {
        let line = depth_line(&track(|x| 20.0 + 0.01 * x)).unwrap();
        assert!(line.contains("larger from left to right"), "{line}");
        assert_eq!(depth_line(&track(|_| 22.0)), None);
    }
}
