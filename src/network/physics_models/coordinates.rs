//! From where an object is seen to the coordinates its equation is written in.
//!
//! The encoder says where in the frame an object is. A turning rod is seen beside the point it turns about, the middle of
//! the frame, in the direction of its angle; so the angle needs no network of its own, and the guides that tie positions
//! to masks tie it as well.

use std::f64::consts::TAU;

use tch::{Kind, Tensor};

use crate::network::cells::Coordinates;

/// Encoded positions `[frames, 2 * objects]` (pixels) as `[frames, coordinates * objects]`.
pub(super) fn of(coordinates: Coordinates, positions: &Tensor, side: usize) -> Tensor {
    match coordinates {
        Coordinates::Position => positions.shallow_clone(),
        Coordinates::Angle => {
            let from_middle = positions.reshape([positions.size()[0], -1, 2]) - side as f64 / 2.0;
            // y points down, angle 0 up.
            from_middle.select(2, 0).atan2(&-from_middle.select(2, 1))
        }
    }
}

/// Places `[frames, 2 * objects]` (pixels), turned clockwise about the middle of the frame by `angles` (`[frames, objects]`).
pub(super) fn turned(places: &Tensor, angles: &Tensor, side: usize) -> Tensor {
    let middle = side as f64 / 2.0;
    let from_middle = places.reshape([places.size()[0], -1, 2]) - middle;
    let (x, y) = (from_middle.select(2, 0), from_middle.select(2, 1));
    let (cos, sin) = (angles.cos(), angles.sin());
    let turned = Tensor::stack(&[&x * &cos - &y * &sin, x * sin + y * cos], 2);
    turned.flatten(1, 2) + middle
}

/// Takes the turns out of angles `[batch, time, objects]`: from one frame to the next they change by less than half a turn.
pub(super) fn continuous(coordinates: Coordinates, positions: Tensor) -> Tensor {
    let time = positions.size()[1];
    if coordinates == Coordinates::Position || time < 2 {
        return positions;
    }
    let change = positions.detach().diff(1, 1, None::<Tensor>, None::<Tensor>);
    let turns = (change / TAU).round().cumsum(1, Kind::Float);
    let turns = Tensor::cat(&[turns.narrow(1, 0, 1).zeros_like(), turns], 1).to_kind(positions.kind());
    positions - turns * TAU
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_angle_is_clockwise_from_up() {
        let seen = Tensor::from_slice(&[32.0, 10.0, 40.0, 32.0, 32.0, 50.0, 20.0, 32.0]).reshape([4, 2]);
        let angles: Vec<f64> = of(Coordinates::Angle, &seen, 64).flatten(0, 1).try_into().unwrap();
        let quarter = TAU / 4.0;
        for (found, expected) in angles.iter().zip([0.0, quarter, 2.0 * quarter, -quarter]) {
            assert!((found - expected).abs() < 1e-12, "{found} instead of {expected}");
        }
    }

    #[test]
    fn a_place_is_turned_by_as_much_as_its_angle() {
        let seen = Tensor::from_slice(&[32.0, 10.0, 40.0, 32.0, 32.0, 50.0, 20.0, 37.0]).reshape([4, 2]);
        let by = Tensor::from_slice(&[0.3, -0.2, 0.1, 1.0]).reshape([4, 1]);
        let change = of(Coordinates::Angle, &turned(&seen, &by, 64), 64) - of(Coordinates::Angle, &seen, 64);
        let error = (change - by).remainder(TAU);
        let error: Vec<f64> = error.flatten(0, 1).try_into().unwrap();
        assert!(error.iter().all(|error| error.min(TAU - error) < 1e-12), "{error:?}");
    }

    #[test]
    fn angles_go_on_through_the_bottom() {
        let turning: Vec<f64> = (0..12).map(|i| 2.0 + 0.9 * f64::from(i)).collect();
        let wrapped: Vec<f64> = turning.iter().map(|angle| angle.sin().atan2(angle.cos())).collect();
        let found = continuous(Coordinates::Angle, Tensor::from_slice(&wrapped).reshape([1, 12, 1]));
        let found: Vec<f64> = found.flatten(0, 2).try_into().unwrap();
        for (found, expected) in found.iter().zip(turning) {
            assert!((found - expected).abs() < 1e-6, "{found} instead of {expected}");
        }
    }
}
