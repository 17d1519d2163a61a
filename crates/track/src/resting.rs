//! Objects that rest in most frames and so are in the median background.
//!
//! A pixel with two states, object and background, does not show which is which. The background continues beyond the
//! border of the region where the states alternate; the object has an edge there.

use ndarray::Array3;

/// Fewest pixels of a region.
const LEAST_AREA: usize = 30;
/// Step across the border with the other state, relative to that with the median, below which the states are swapped.
const SMOOTHER: f64 = 0.6;

/// Replaces the levels, `[height, width, 3]`, of regions in which the other state continues the surroundings better.
/// `other` holds the other state, NaN where a pixel has one state only. Returns the number of pixels changed.
pub(crate) fn remove_resting(levels: &mut Array3<f32>, other: &Array3<f32>) -> usize {
    let (height, width, _) = levels.dim();
    let two_states = |place: usize| !other[[place / width, place % width, 0]].is_nan();
    let mut visited = vec![false; width * height];
    let mut changed = 0;
    for seed in 0..width * height {
        if visited[seed] || !two_states(seed) {
            continue;
        }
        let mut region = vec![seed];
        visited[seed] = true;
        let mut border = Vec::new();
        let mut next = 0;
        while next < region.len() {
            let place = region[next];
            next += 1;
            for beside in neighbours(place, width, height) {
                if !two_states(beside) {
                    border.push((place, beside));
                } else if !visited[beside] {
                    visited[beside] = true;
                    region.push(beside);
                }
            }
        }
        if region.len() < LEAST_AREA || border.is_empty() {
            continue;
        }
        let step = |inner: &Array3<f32>| -> f64 {
            let pair = |&(place, beside): &(usize, usize)| -> f64 {
                (0..3)
                    .map(|c| {
                        let a = inner[[place / width, place % width, c]];
                        f64::from((a - levels[[beside / width, beside % width, c]]).abs())
                    })
                    .sum()
            };
            border.iter().map(pair).sum()
        };
        if step(other) < SMOOTHER * step(levels) {
            changed += region.len();
            for place in region {
                for c in 0..3 {
                    levels[[place / width, place % width, c]] = other[[place / width, place % width, c]];
                }
            }
        }
    }
    changed
}

fn neighbours(place: usize, width: usize, height: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (place % width, place / width);
    [
        (x > 0).then(|| place - 1),
        (x + 1 < width).then_some(place + 1),
        (y > 0).then(|| place - width),
        (y + 1 < height).then_some(place + width),
    ]
    .into_iter()
    .flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(x: usize, y: usize) -> f32 {
        60.0 + 2.0 * x as f32 + y as f32
    }

    #[test]
    fn the_state_that_continues_the_surroundings_is_kept() {
        let square = |x: usize, y: usize| (10..18).contains(&x) && (5..13).contains(&y);
        let background = Array3::from_shape_fn((20, 30, 3), |(y, x, _)| scene(x, y));
        let object = Array3::from_shape_fn((20, 30, 3), |(y, x, _)| if square(x, y) { 200.0 } else { scene(x, y) });
        let state = |levels: &Array3<f32>| {
            Array3::from_shape_fn((20, 30, 3), |(y, x, c)| if square(x, y) { levels[[y, x, c]] } else { f32::NAN })
        };
        let mut levels = object.clone();
        assert_eq!(remove_resting(&mut levels, &state(&background)), 64);
        assert_eq!(levels, background);
        assert_eq!(remove_resting(&mut levels, &state(&object)), 0);
        assert_eq!(levels, background);
    }
}
