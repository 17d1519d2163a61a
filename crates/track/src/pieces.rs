//! Paths cut at jumps that no motion explains, and pieces of one object joined by their looks.

use crate::statistics::median;

/// Jump, in units of the step that motion explains, from which on a path is cut.
const JUMP: f64 = 4.0;
/// Ratio of the diameters, and distance of the colours in levels, up to which two pieces are one object.
const LIKE_SIZE: f64 = 1.5;
const LIKE_COLOUR: f64 = 40.0;

/// Region on a path.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stop {
    pub(crate) frame: usize,
    pub(crate) centre: [f64; 2],
    pub(crate) diameter: f64,
    /// Mean colour, levels.
    pub(crate) colour: [f64; 3],
}

/// Groups of indices into `stops` (a path in order of time): pieces of the path that look alike are in one group.
/// Groups are ordered by their number of stops, largest first.
pub(crate) fn pieces(stops: &[Stop]) -> Vec<Vec<usize>> {
    let mut pieces: Vec<Vec<usize>> = Vec::new();
    for index in 0..stops.len() {
        if index == 0 || jumps(stops, index) {
            pieces.push(Vec::new());
        }
        pieces.last_mut().expect("a piece was just pushed").push(index);
    }
    pieces.sort_by_key(|piece| std::cmp::Reverse(piece.len()));
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for piece in pieces {
        match groups.iter_mut().find(|group| alike(stops, group, &piece)) {
            Some(group) => group.extend(piece),
            None => groups.push(piece),
        }
    }
    groups.iter_mut().for_each(|group| group.sort_unstable());
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    groups
}

/// Whether the step to `index` is far longer than the size of the object and the steps around it explain.
fn jumps(stops: &[Stop], index: usize) -> bool {
    let step = |to: usize| -> Option<f64> {
        let (a, b) = (stops.get(to.checked_sub(1)?)?, stops.get(to)?);
        let distance = (a.centre[0] - b.centre[0]).hypot(a.centre[1] - b.centre[1]);
        Some(distance / (b.frame - a.frame) as f64)
    };
    let frames = (stops[index].frame - stops[index - 1].frame) as f64;
    let length = step(index).unwrap_or(0.0) * frames;
    // The faster of the steps before and after: an object accelerates from rest.
    let around = (1..=2).flat_map(|k| [index.checked_sub(k).and_then(step), step(index + k)]);
    let speed = around.flatten().fold(0.0, f64::max);
    let size = stops[index].diameter.max(stops[index - 1].diameter);
    length > JUMP * (speed * frames.min(6.0)).max(0.5 * size + 2.0)
}

fn alike(stops: &[Stop], one: &[usize], other: &[usize]) -> bool {
    let typical = |piece: &[usize], value: &dyn Fn(&Stop) -> f64| {
        let mut values: Vec<f64> = piece.iter().map(|&index| value(&stops[index])).collect();
        median(&mut values).unwrap_or(0.0)
    };
    let ratio = typical(one, &|s| s.diameter) / typical(other, &|s| s.diameter);
    let colour = (0..3).map(|c| (typical(one, &|s| s.colour[c]) - typical(other, &|s| s.colour[c])).abs());
    (1.0 / LIKE_SIZE..LIKE_SIZE).contains(&ratio) && colour.fold(0.0, f64::max) < LIKE_COLOUR
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stop(frame: usize, x: f64, red: f64) -> Stop {
        Stop { frame, centre: [x, 50.0], diameter: 10.0, colour: [red, 80.0, 80.0] }
    }

    #[test]
    fn a_jump_to_something_else_is_cut_off_and_the_object_is_joined_again() {
        let mut stops: Vec<Stop> = (0..20).map(|f| stop(f, 4.0 * f as f64, 200.0)).collect();
        stops.extend((20..30).map(|f| stop(f, 400.0, 20.0)));
        stops.extend((30..45).map(|f| stop(f, 3.0 * (f - 30) as f64, 195.0)));
        let groups = pieces(&stops);
        assert_eq!(groups.len(), 2);
        assert_eq!(groups[0].len(), 35);
        assert!(groups[1].iter().all(|&i| stops[i].colour[0] == 20.0));
    }

    #[test]
    fn an_accelerating_object_that_bounces_is_one_piece() {
        let height = |t: f64| 100.0 - (0.2 * t * t - 50.0).abs();
        let stops: Vec<Stop> = (0..30)
            .map(|f| Stop { frame: f, centre: [10.0, height(f as f64)], diameter: 8.0, colour: [9.0; 3] })
            .collect();
        assert_eq!(pieces(&stops).len(), 1);
    }
}
