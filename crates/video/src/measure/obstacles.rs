//! Surfaces and strings whose numbers are parameters: where a fit begins to look for them.

use super::dynamics::Dynamics;
use super::fit::Observations;
use paig::network::cells::Build;
use paig::network::cells::text::TableNumber;
use paig::support::random::named_generator;
use rand::Rng;

/// Share of positions that lie beyond by noise alone.
const BEYOND: f64 = 0.02;
/// Distance at which a position touches, as a share of what the positions extend over; and up to which it may be held.
const TOUCHING: f64 = 0.01;
const HELD: f64 = 0.04;
/// Circles that are tried, of so many positions at most; a position outside of one counts against so many on it.
const CIRCLES: usize = 3000;
const MOST_POSITIONS: usize = 400;
const OUTSIDE: f64 = 5.0;
/// Most extents of the positions in the radius of a circle.
const MOST_RADIUS: f64 = 10.0;

/// A number of the table: given, or a parameter by its place.
#[derive(Debug, Clone, Copy)]
enum NumberSource {
    Given(f64),
    Parameter(usize),
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum ObstacleShape {
    Line,
    Inside,
    Outside,
}

/// A surface, or a string that is fastened to a point.
#[derive(Debug)]
struct Obstacle {
    shape: ObstacleShape,
    point: [NumberSource; 2],
    angle: NumberSource,
    distance: NumberSource,
    /// The only object; all if none.
    object: Option<usize>,
}

/// ObjectPaths of single objects, frame by frame.
type ObjectPaths = Vec<Vec<[f64; 2]>>;

impl Obstacle {
    fn all(dynamics: &Dynamics) -> Vec<Self> {
        let cell = &dynamics.system.cell;
        let Build::Text(equation) = &cell.build else { return Vec::new() };
        let source = |given: &TableNumber| match given {
            TableNumber::Number(number) => Some(NumberSource::Given(*number)),
            TableNumber::Parameter(name) => {
                cell.parameters.iter().position(|it| it.name == name.as_str()).map(NumberSource::Parameter)
            }
        };
        let or_zero = |given: &Option<TableNumber>| given.as_ref().map_or(Some(NumberSource::Given(0.0)), source);
        let table = equation.table();
        let surfaces = table.surfaces.iter().filter_map(|it| {
            let (shape, point) = match (&it.line, &it.bowl, &it.bump) {
                (Some(point), ..) => (ObstacleShape::Line, point),
                (_, Some(centre), _) => (ObstacleShape::Inside, centre),
                (.., centre) => (ObstacleShape::Outside, centre.as_ref()?),
            };
            let point = [source(&point[0])?, source(&point[1])?];
            Some(Obstacle {
                shape,
                point,
                angle: or_zero(&it.angle)?,
                distance: or_zero(&it.distance)?,
                object: it.object,
            })
        });
        let strings = table.strings.iter().filter_map(|it| {
            let [x, y] = it.at.as_ref()?;
            Some(Obstacle {
                shape: ObstacleShape::Inside,
                point: [source(x)?, source(y)?],
                angle: NumberSource::Given(0.0),
                distance: source(&it.length)?,
                object: it.object,
            })
        });
        surfaces.chain(strings).collect()
    }

    fn paths(&self, dynamics: &Dynamics, tracks: &[Observations]) -> ObjectPaths {
        let coordinates = dynamics.coordinates();
        let objects = match self.object {
            Some(number) => number - 1..number,
            None => 0..dynamics.system.objects,
        };
        let teaching = tracks.iter().filter(|track| track.teaches);
        let of_track = |track: &Observations| -> ObjectPaths {
            let of_object = |object: usize| {
                let frames =
                    track.positions.chunks(coordinates).map(|frame| [frame[2 * object], frame[2 * object + 1]]);
                frames.filter(|[x, y]| x.is_finite() && y.is_finite()).collect()
            };
            objects.clone().map(of_object).collect()
        };
        teaching.flat_map(of_track).collect()
    }

    /// Point, angle and distance that the positions show, from those in `values`.
    fn shown(&self, paths: &ObjectPaths, values: &[f64]) -> Option<([f64; 2], f64, f64)> {
        let value = |source: NumberSource| match source {
            NumberSource::Given(number) => number,
            NumberSource::Parameter(place) => values[place],
        };
        let is_learned = |source: NumberSource| matches!(source, NumberSource::Parameter(_));
        let [mut point, mut angle, mut distance] =
            [self.point.map(value), [value(self.angle); 2], [value(self.distance); 2]];
        let positions: Vec<[f64; 2]> = paths.iter().flatten().copied().collect();
        if self.shape == ObstacleShape::Line {
            if is_learned(self.angle) {
                angle = [struck_edge(paths, &positions)?; 2];
            }
            let normal = [angle[0].sin(), -angle[0].cos()];
            let heights = positions.iter().map(|at| at[0] * normal[0] + at[1] * normal[1]);
            let off = quantile(heights, BEYOND)? - point[0] * normal[0] - point[1] * normal[1];
            // The coordinate that the line crosses most steeply takes it.
            let axis = usize::from(normal[1].abs() >= normal[0].abs());
            match [axis, 1 - axis].into_iter().find(|axis| is_learned(self.point[*axis])) {
                _ if is_learned(self.distance) => distance = [off; 2],
                Some(axis) => point[axis] += (off - distance[0]) / normal[axis],
                None => {}
            }
            return Some((point, angle[0], distance[0]));
        }
        if self.shape == ObstacleShape::Inside && self.point.into_iter().any(is_learned) {
            let (centre, radius) = enclosing_circle(&positions)?;
            return Some((centre, 0.0, radius));
        }
        let radii = positions.iter().map(|at| (at[0] - point[0]).hypot(at[1] - point[1]));
        let share = if self.shape == ObstacleShape::Inside { 1.0 - BEYOND } else { BEYOND };
        Some((point, 0.0, quantile(radii, share)?))
    }
}

/// Unconstrained parameters of surfaces and strings by their places, of those that are `learned`: where the positions end. `start`
/// has all unconstrained parameters.
pub(super) fn touched(
    dynamics: &Dynamics,
    tracks: &[Observations],
    learned: &[bool],
    start: &[f64],
) -> Vec<(usize, f64)> {
    let values = dynamics.values(start);
    let mut found = Vec::new();
    for obstacle in Obstacle::all(dynamics) {
        let paths = obstacle.paths(dynamics, tracks);
        let Some((point, angle, distance)) = obstacle.shown(&paths, &values) else { continue };
        let [x, y] = obstacle.point;
        for (source, value) in [(x, point[0]), (y, point[1]), (obstacle.angle, angle), (obstacle.distance, distance)] {
            let NumberSource::Parameter(place) = source else { continue };
            let unconstrained = dynamics.system.cell.parameters[place].bounds.unconstrained(value);
            if learned[place] && unconstrained.is_finite() {
                found.push((place, unconstrained));
            }
        }
    }
    found
}

/// Whether positions of all objects are away from each surface and string, `extent` being what the tracks extend over.
pub(super) fn is_free(dynamics: &Dynamics, start: &[f64], positions: &[f64], extent: f64) -> bool {
    let values = dynamics.values(start);
    let value = |source: NumberSource| match source {
        NumberSource::Given(number) => number,
        NumberSource::Parameter(place) => values[place],
    };
    Obstacle::all(dynamics).iter().all(|obstacle| {
        let (point, distance) = (obstacle.point.map(value), value(obstacle.distance));
        let away = |(object, at): (usize, &[f64])| {
            let arm = [at[0] - point[0], at[1] - point[1]];
            let angle = value(obstacle.angle);
            let gap = match obstacle.shape {
                ObstacleShape::Line => arm[0] * angle.sin() - arm[1] * angle.cos() - distance,
                ObstacleShape::Inside => distance - arm[0].hypot(arm[1]),
                ObstacleShape::Outside => arm[0].hypot(arm[1]) - distance,
            };
            obstacle.object.is_some_and(|number| number != object + 1) || gap > HELD * extent
        };
        positions.chunks(2).enumerate().all(away)
    })
}

/// The greater side of the box about all positions.
pub(super) fn extent(dynamics: &Dynamics, tracks: &[Observations]) -> f64 {
    let teaching = tracks.iter().filter(|track| track.teaches);
    let positions: Vec<f64> = teaching.flat_map(|track| track.positions.iter().copied()).collect();
    let side = |axis: usize| {
        let along = positions.iter().skip(axis).step_by(2).filter(|x| x.is_finite());
        let [least, most] = along.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(*x), b.max(*x)]);
        most - least
    };
    if dynamics.coordinates() < 2 { 0.0 } else { side(0).max(side(1)) }
}

fn quantile(values: impl Iterator<Item = f64>, share: f64) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(((values.len().max(1) - 1) as f64 * share).round() as usize).copied()
}

/// Angle of the edge of the positions' convex hull against which the paths bounce hardest.
fn struck_edge(paths: &ObjectPaths, positions: &[[f64; 2]]) -> Option<f64> {
    let hull = hull(positions);
    let edges = (0..hull.len()).map(|place| [hull[place], hull[(place + 1) % hull.len()]]);
    let struck = edges.map(|[from, to]| {
        let angle = (to[1] - from[1]).atan2(to[0] - from[0]);
        let normal = [angle.sin(), -angle.cos()];
        let height = |at: &[f64; 2]| (at[0] - from[0]) * normal[0] + (at[1] - from[1]) * normal[1];
        let near = HELD * positions.iter().map(height).fold(0.0, f64::max);
        let bounces = paths.iter().flat_map(|path| path.windows(3)).map(|three| {
            let [a, b, c] = [0, 1, 2].map(|place| height(&three[place]));
            if b < near && b <= a && b <= c { a + c - 2.0 * b } else { 0.0 }
        });
        (bounces.sum::<f64>(), angle)
    });
    struck.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, angle)| angle)
}

/// Corners of the convex hull, so ordered that the positions lie on the side of the normal (sin, -cos) of each edge's direction.
fn hull(positions: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted = positions.to_vec();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    sorted.dedup();
    let turn = |o: [f64; 2], a: [f64; 2], b: [f64; 2]| (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    let half = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while let [.., o, a] = chain[..] {
                if turn(o, a, point) < 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut all = half(&mut sorted.iter().copied());
    all.extend(half(&mut sorted.iter().rev().copied()));
    all
}

/// Centre and radius of the circle on which most positions lie and hardly any outside.
fn enclosing_circle(positions: &[[f64; 2]]) -> Option<([f64; 2], f64)> {
    let stride = positions.len().div_ceil(MOST_POSITIONS).max(1);
    let positions: Vec<[f64; 2]> = positions.iter().copied().step_by(stride).collect();
    let side = |axis: usize| {
        let along = positions.iter().map(|at| at[axis]);
        let [least, most] = along.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)]);
        most - least
    };
    let extent = side(0).max(side(1));
    if positions.len() < 3 {
        return None;
    }
    let mut random = named_generator(0, "circles");
    let mut draw = || positions[random.random_range(0..positions.len())];
    let tried = (0..CIRCLES).filter_map(|_| {
        let (centre, radius) = circle([draw(), draw(), draw()]).filter(|(_, radius)| *radius < MOST_RADIUS * extent)?;
        let beyond = positions.iter().map(|at| (at[0] - centre[0]).hypot(at[1] - centre[1]) - radius);
        let score = beyond.map(|beyond| match beyond / (TOUCHING * extent) {
            off if off > 1.0 => -OUTSIDE,
            off if off > -1.0 => 1.0,
            _ => 0.0,
        });
        Some((score.sum::<f64>(), centre, radius))
    });
    tried.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, centre, radius)| (centre, radius))
}

/// The circle through three points; none on a line.
fn circle([a, b, c]: [[f64; 2]; 3]) -> Option<([f64; 2], f64)> {
    let [b, c] = [b, c].map(|point| [point[0] - a[0], point[1] - a[1]]);
    let double = 2.0 * (b[0] * c[1] - b[1] * c[0]);
    let [bb, cc] = [b, c].map(|[x, y]| x * x + y * y);
    let arm = [(c[1] * bb - b[1] * cc) / double, (b[0] * cc - c[0] * bb) / double];
    let radius = arm[0].hypot(arm[1]);
    radius.is_finite().then_some(([a[0] + arm[0], a[1] + arm[1]], radius))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_encloses_a_swing_and_a_flight() {
        let swing = (0..40)
            .map(|place| 0.05 * f64::from(place))
            .map(|angle: f64| [30.0 + 20.0 * angle.cos(), 10.0 + 20.0 * angle.sin()]);
        let flight = (0..20).map(|place| [48.0 - f64::from(place), 0.0 + 0.05 * f64::from(place * place)]);
        let (centre, radius) = enclosing_circle(&swing.chain(flight).collect::<Vec<_>>()).unwrap();
        // Positions touch to a hundredth of the extent.
        assert!((radius - 20.0).abs() < 1.0 && (centre[0] - 30.0).hypot(centre[1] - 10.0) < 1.0, "{centre:?} {radius}");
    }

    #[test]
    fn the_struck_edge_is_the_incline() {
        let (angle, steps) = (0.3_f64, 60);
        // Bounces of 10 frames each along the incline, y down.
        let path: Vec<[f64; 2]> = (0..steps)
            .map(|frame| {
                let phase = f64::from(frame % 10) - 5.0;
                let (along, height) = (f64::from(frame), 0.5 * (25.0 - phase * phase));
                [along * angle.cos() + height * angle.sin(), along * angle.sin() - height * angle.cos()]
            })
            .collect();
        let found = struck_edge(&vec![path.clone()], &path).unwrap();
        assert!((found - angle).abs() < 1e-9, "{found}");
    }
}
