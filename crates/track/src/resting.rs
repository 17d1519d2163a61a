//! Objects that rest in most frames and so are in the median background.
//!
//! A pixel with two states, object and background, does not show which is which. The background continues beyond the
//! border of a region where the states alternate; the object has an edge there. Regions are swapped one after the other,
//! each time the one that removes most of the edges.

use ndarray::Array3;

/// Fewest pixels of a region.
const LEAST_AREA: usize = 30;
/// Step across the border with the other state, relative to that with the median, below which the states are swapped.
const SMOOTHER: f64 = 0.6;
/// Most regions that are swapped.
const MOST_SWAPS: usize = 40;

/// Connected pixels with two states, none of which has an edge inside.
struct RestingRegion {
    pixels: Vec<usize>,
    /// Pixels of the region and their neighbours beyond it.
    border: Vec<(usize, usize)>,
}

/// Replaces the levels, `[height, width, 3]`, of regions in which the other state continues the surroundings better.
/// `other` holds the other state, NaN where a pixel has one state only; states of neighbours within `alike` levels belong
/// to one region. Returns the number of pixels changed.
pub(crate) fn remove_resting(levels: &mut Array3<f32>, other: &mut Array3<f32>, alike: f32) -> usize {
    let regions = regions(levels, other, alike);
    let mut changed = 0;
    for _ in 0..MOST_SWAPS {
        let gain = |region: &RestingRegion| {
            let (now, then) = (steps(region, levels, levels), steps(region, other, levels));
            if then < SMOOTHER * now { now - then } else { 0.0 }
        };
        let gains: Vec<f64> = regions.iter().map(gain).collect();
        let Some((best, _)) = gains.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).filter(|g| *g.1 > 0.0) else {
            break;
        };
        let width = levels.dim().1;
        changed += regions[best].pixels.len();
        for &place in &regions[best].pixels {
            for c in 0..3 {
                std::mem::swap(
                    &mut levels[[place / width, place % width, c]],
                    &mut other[[place / width, place % width, c]],
                );
            }
        }
    }
    changed
}

fn regions(levels: &Array3<f32>, other: &Array3<f32>, alike: f32) -> Vec<RestingRegion> {
    let (height, width, _) = levels.dim();
    let two_states = |place: usize| !other[[place / width, place % width, 0]].is_nan();
    let close = |image: &Array3<f32>, a: usize, b: usize| {
        let differs = |c| (image[[a / width, a % width, c]] - image[[b / width, b % width, c]]).abs() > alike;
        !(0..3).any(differs)
    };
    let mut visited = vec![false; width * height];
    let mut regions = Vec::new();
    for seed in 0..width * height {
        if visited[seed] || !two_states(seed) {
            continue;
        }
        let mut region = RestingRegion { pixels: vec![seed], border: Vec::new() };
        visited[seed] = true;
        let mut next = 0;
        while next < region.pixels.len() {
            let place = region.pixels[next];
            next += 1;
            for beside in neighbours(place, width, height) {
                let joined = two_states(beside) && close(levels, place, beside) && close(other, place, beside);
                if !joined {
                    region.border.push((place, beside));
                } else if !visited[beside] {
                    visited[beside] = true;
                    region.pixels.push(beside);
                }
            }
        }
        if region.pixels.len() >= LEAST_AREA && !region.border.is_empty() {
            regions.push(region);
        }
    }
    regions
}

/// Sum over the border of the differences between the inner pixels of one image and the outer ones of another.
fn steps(region: &RestingRegion, inner: &Array3<f32>, outer: &Array3<f32>) -> f64 {
    let width = inner.dim().1;
    let pair = |&(place, beside): &(usize, usize)| -> f64 {
        let step = |c| inner[[place / width, place % width, c]] - outer[[beside / width, beside % width, c]];
        (0..3).map(|c| f64::from(step(c).abs())).sum()
    };
    region.border.iter().map(pair).sum()
}

/// The four neighbours of a pixel within the frame.
pub(crate) fn neighbours(place: usize, width: usize, height: usize) -> impl Iterator<Item = usize> {
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
        assert_eq!(remove_resting(&mut levels, &mut state(&background), 20.0), 64);
        assert_eq!(levels, background);
        assert_eq!(remove_resting(&mut levels, &mut state(&object), 20.0), 0);
        assert_eq!(levels, background);
    }
}
