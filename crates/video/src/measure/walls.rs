//! Walls whose places are parameters: where a fit begins to look for them.

use super::dynamics::Dynamics;
use super::fit::Observations;
use paig::network::cells::Build;
use paig::network::cells::text::{TableNumber, WallTable};

/// Share of a wall's side on which positions lie beyond the wall by noise alone.
const BEYOND_WALL: f64 = 0.02;
/// Distance of a wall from the furthest position, as a share of the way along its axis, from which on no frame shows an impact,
/// and up to which paths are extended.
const HIDDEN: [f64; 2] = [0.02, 0.3];

/// A wall across an axis, 0 for x and 1 for y; `far` at the greater coordinates.
#[derive(Clone, Copy)]
struct Wall {
    place: usize,
    axis: usize,
    far: bool,
}

/// Unconstrained parameters of walls by their places: where the tracks turn.
pub(super) fn furthest(dynamics: &Dynamics, tracks: &[Observations]) -> Vec<(usize, f64)> {
    let found = learned(dynamics).into_iter().filter_map(|wall| {
        let [near, far] = range(&along(dynamics, tracks, wall.axis))?;
        unconstrained(dynamics, wall, if wall.far { far } else { near })
    });
    found.collect()
}

/// The same of walls that lie beyond all positions: where the paths before and after an impact between two frames meet.
pub(super) fn beyond(dynamics: &Dynamics, tracks: &[Observations]) -> Vec<(usize, f64)> {
    let found = learned(dynamics).into_iter().filter_map(|wall| {
        let paths = along(dynamics, tracks, wall.axis);
        let [near, far] = range(&paths)?;
        let sign = if wall.far { 1.0 } else { -1.0 };
        let furthest = if wall.far { far } else { near };
        let impacts = paths.iter().flat_map(|path| path.windows(4).filter_map(|four| impact(four, sign)));
        let (_, place) = impacts.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let hidden = sign * (place - furthest) / (far - near);
        (HIDDEN[0]..HIDDEN[1]).contains(&hidden).then(|| unconstrained(dynamics, wall, place))?
    });
    found.collect()
}

/// Speed before an impact between the middle two of four `(time, position)`, and its place, if there is one towards `sign`.
fn impact(four: &[(f64, f64)], sign: f64) -> Option<(f64, f64)> {
    let [a, b, c, d] = *four else { return None };
    let speed = |from: (f64, f64), to: (f64, f64)| sign * (to.1 - from.1) / (to.0 - from.0);
    let (towards, away) = (speed(a, b), -speed(c, d));
    let gap = c.0 - b.0;
    // From both sides to the wall within the gap.
    let until = (sign * (c.1 - b.1) + away * gap) / (towards + away);
    (towards > 0.0 && away > 0.0 && (0.0..=gap).contains(&until)).then_some((towards, b.1 + sign * towards * until))
}

fn learned(dynamics: &Dynamics) -> Vec<Wall> {
    let cell = &dynamics.system.cell;
    let Build::Text(equation) = &cell.build else { return Vec::new() };
    let WallTable::At(sides) = &equation.table().walls else { return Vec::new() };
    let all = [(&sides.left, 0, false), (&sides.right, 0, true), (&sides.top, 1, false), (&sides.bottom, 1, true)];
    let walls = all.into_iter().filter_map(|(given, axis, far)| {
        let Some(TableNumber::Parameter(name)) = given else { return None };
        let place = cell.parameters.iter().position(|parameter| parameter.name == name.as_str())?;
        Some(Wall { place, axis, far })
    });
    walls.collect()
}

/// `(time, position)` along an axis of each object of each track.
fn along(dynamics: &Dynamics, tracks: &[Observations], axis: usize) -> Vec<Vec<(f64, f64)>> {
    let coordinates = dynamics.coordinates();
    let teaching = tracks.iter().filter(|track| track.teaches);
    let paths = teaching.flat_map(|track| {
        (axis..coordinates).step_by(2).map(move |place| {
            let positions = track.positions.chunks(coordinates).map(move |frame| frame[place]);
            track.times.iter().copied().zip(positions).filter(|(_, x)| x.is_finite()).collect()
        })
    });
    paths.collect()
}

/// Ends of the positions less what lies beyond by noise.
fn range(paths: &[Vec<(f64, f64)>]) -> Option<[f64; 2]> {
    let mut all: Vec<f64> = paths.iter().flatten().map(|(_, x)| *x).collect();
    all.sort_by(f64::total_cmp);
    let place = |share: f64| ((all.len().max(1) - 1) as f64 * share).round() as usize;
    Some([*all.get(place(BEYOND_WALL))?, *all.get(place(1.0 - BEYOND_WALL))?])
}

fn unconstrained(dynamics: &Dynamics, wall: Wall, at: f64) -> Option<(usize, f64)> {
    let value = dynamics.system.cell.parameters[wall.place].bounds.unconstrained(at);
    value.is_finite().then_some((wall.place, value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_before_and_after_an_impact_meet_at_the_wall() {
        // 20 px a second towards a floor at 100, 12 away from it, the frame of the impact missing.
        let four = [(0.0, 76.0), (0.5, 86.0), (1.7, 94.0), (2.2, 88.0)];
        let (speed, floor) = impact(&four, 1.0).unwrap();
        assert!((speed - 20.0).abs() < 1e-9 && (floor - 100.0).abs() < 1e-9, "{floor}");
        assert_eq!(impact(&four, -1.0), None);
        let upside_down = four.map(|(time, y)| (time, -y));
        assert!((impact(&upside_down, -1.0).unwrap().1 + 100.0).abs() < 1e-9);
    }
}
