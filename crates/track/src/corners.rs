//! Corners of an image, spread over it (Shi and Tomasi 1994), and their displacement in another one (Lucas and Kanade
//! 1981, on pyramids).

use rayon::prelude::*;

use crate::plane::Plane;

/// Cells along the longer side; each gives its strongest corners.
const CELLS: usize = 16;
const PER_CELL: usize = 3;
/// Half side of the window of a corner, pixels.
const REACH: usize = 4;
/// Least smaller eigenvalue of a corner's mean gradient matrix, (levels per pixel)^2.
const LEAST_EIGENVALUE: f32 = 2.0;
/// Steps of a search on each level.
const STEPS: usize = 10;
/// Distance between a corner and where the search back from its match ends, pixels.
const RETURNS: f64 = 0.3;
/// Root mean square difference of matched windows, less their mean, relative to the contrast of the window.
const UNLIKE: f32 = 0.7;

/// A corner: its place and the cell of the image in which it lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Corner {
    pub(crate) at: [f64; 2],
    pub(crate) cell: usize,
}

/// Corners of an image, several for each cell of a grid.
pub(crate) fn corners(image: &Plane) -> Vec<Corner> {
    let margin = REACH + 2;
    let (width, height) = (image.width, image.height);
    if width.min(height) <= 2 * margin + 1 {
        return Vec::new();
    }
    let side = (width.max(height) / CELLS).max(8);
    let columns = width.div_ceil(side);
    let cells: Vec<(usize, usize)> =
        (0..height.div_ceil(side)).flat_map(|row| (0..columns).map(move |column| (column, row))).collect();
    cells
        .par_iter()
        .flat_map_iter(|&(column, row)| {
            let span = |cell: usize, end: usize| (cell * side).max(margin)..((cell + 1) * side).min(end - margin);
            let mut found: Vec<(f32, [usize; 2])> = Vec::new();
            for y in span(row, height) {
                for x in span(column, width) {
                    let strength = strength(image, x, y);
                    if strength > LEAST_EIGENVALUE {
                        found.push((strength, [x, y]));
                    }
                }
            }
            found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            let mut kept: Vec<[usize; 2]> = Vec::new();
            for (_, at) in found {
                let apart = |other: &[usize; 2]| at[0].abs_diff(other[0]).max(at[1].abs_diff(other[1])) > REACH;
                if kept.len() < PER_CELL && kept.iter().all(apart) {
                    kept.push(at);
                }
            }
            let cell = row * columns + column;
            kept.into_iter().map(move |at| Corner { at: at.map(|place| place as f64), cell })
        })
        .collect()
}

/// Smaller eigenvalue of the mean gradient matrix over the inner window.
fn strength(image: &Plane, x: usize, y: usize) -> f32 {
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for row in y - 2..=y + 2 {
        for column in x - 2..=x + 2 {
            let across = 0.5 * (image.at(column + 1, row) - image.at(column - 1, row));
            let down = 0.5 * (image.at(column, row + 1) - image.at(column, row - 1));
            xx += across * across;
            xy += across * down;
            yy += down * down;
        }
    }
    let (half, difference) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    (half - difference.hypot(xy)) / 25.0
}

/// Places of the corners of `from` in `to`, both pyramids, from expected places; `None` where a search does not return.
pub(crate) fn displaced(
    from: &[Plane],
    to: &[Plane],
    corners: &[Corner],
    expected: &[[f64; 2]],
) -> Vec<Option<[f64; 2]>> {
    corners
        .par_iter()
        .zip(expected)
        .map(|(corner, &expected)| {
            let there = search(from, to, corner.at, expected)?;
            let back = search(to, from, there, [0, 1].map(|k| corner.at[k] + there[k] - expected[k]))?;
            let returns = (back[0] - corner.at[0]).hypot(back[1] - corner.at[1]) < RETURNS;
            (returns && alike(&from[0], corner.at, &to[0], there)).then_some(there)
        })
        .collect()
}

/// Place in `to` of the window around `at` in `from`.
fn search(from: &[Plane], to: &[Plane], at: [f64; 2], expected: [f64; 2]) -> Option<[f64; 2]> {
    let mut place = expected;
    for level in (0..from.len()).rev() {
        let scale = (1_u32 << level) as f64;
        // A coarse sample's centre lies between the fine ones.
        let down = |p: [f64; 2]| p.map(|v| (v + 0.5) / scale - 0.5);
        let found = step(&from[level], &to[level], down(at), down(place));
        match found {
            Some(found) => place = found.map(|v| (v + 0.5) * scale - 0.5),
            // The border of a coarse level is near: a finer one may do.
            None if level > 0 => {}
            None => return None,
        }
    }
    Some(place)
}

const SIDE: usize = 2 * REACH + 1;

fn step(from: &Plane, to: &Plane, at: [f64; 2], start: [f64; 2]) -> Option<[f64; 2]> {
    // One sample more on each side for the gradients.
    let window: [f32; (SIDE + 2) * (SIDE + 2)] = window(from, at)?;
    let value = |x: usize, y: usize| window[y * (SIDE + 2) + x];
    let mut slopes = [[0.0_f32; 2]; SIDE * SIDE];
    let mut levels = [0.0_f32; SIDE * SIDE];
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for y in 0..SIDE {
        for x in 0..SIDE {
            let slope = [0.5 * (value(x + 2, y + 1) - value(x, y + 1)), 0.5 * (value(x + 1, y + 2) - value(x + 1, y))];
            xx += slope[0] * slope[0];
            xy += slope[0] * slope[1];
            yy += slope[1] * slope[1];
            slopes[y * SIDE + x] = slope;
            levels[y * SIDE + x] = value(x + 1, y + 1);
        }
    }
    let determinant = xx * yy - xy * xy;
    if determinant <= 1e-3 * (xx + yy) {
        return None;
    }
    let mean = levels.iter().sum::<f32>() / levels.len() as f32;
    let mut place = start;
    for _ in 0..STEPS {
        let there: [f32; SIDE * SIDE] = window_of(to, place)?;
        // A change of light is no displacement.
        let offset = there.iter().sum::<f32>() / there.len() as f32 - mean;
        let (mut right, mut down) = (0.0, 0.0);
        for ((new, old), slope) in there.iter().zip(&levels).zip(&slopes) {
            let difference = new - offset - old;
            right += difference * slope[0];
            down += difference * slope[1];
        }
        let dx = f64::from((yy * right - xy * down) / determinant);
        let dy = f64::from((xx * down - xy * right) / determinant);
        place = [place[0] - dx.clamp(-2.0, 2.0), place[1] - dy.clamp(-2.0, 2.0)];
        if dx.hypot(dy) < 0.01 {
            break;
        }
    }
    Some(place)
}

fn window(image: &Plane, at: [f64; 2]) -> Option<[f32; (SIDE + 2) * (SIDE + 2)]> {
    bilinear::<{ SIDE + 2 }, { (SIDE + 2) * (SIDE + 2) }>(image, at)
}

fn window_of(image: &Plane, at: [f64; 2]) -> Option<[f32; SIDE * SIDE]> {
    bilinear::<SIDE, { SIDE * SIDE }>(image, at)
}

/// Samples on a grid of `N * N` around a point, linearly interpolated; `None` beyond the border.
fn bilinear<const N: usize, const M: usize>(image: &Plane, at: [f64; 2]) -> Option<[f32; M]> {
    let first = at.map(|v| v - (N / 2) as f64);
    if !(first[0] >= 0.0 && first[1] >= 0.0) {
        return None;
    }
    let [left, top] = first.map(|v| v as usize);
    if left + N + 1 > image.width || top + N + 1 > image.height {
        return None;
    }
    let [u, v] = [(first[0] - left as f64) as f32, (first[1] - top as f64) as f32];
    let mut values = [0.0; M];
    for (y, out) in values.chunks_exact_mut(N).enumerate() {
        let above = &image.values[(top + y) * image.width + left..][..N + 1];
        let below = &image.values[((top + y + 1).min(image.height - 1)) * image.width + left..][..N + 1];
        for (x, value) in out.iter_mut().enumerate() {
            let upper = above[x] + u * (above[x + 1] - above[x]);
            let lower = below[x] + u * (below[x + 1] - below[x]);
            *value = upper + v * (lower - upper);
        }
    }
    Some(values)
}

/// Whether two windows look alike but for their brightness.
fn alike(from: &Plane, at: [f64; 2], to: &Plane, there: [f64; 2]) -> bool {
    let (Some(one), Some(other)) = (window_of(from, at), window_of(to, there)) else { return false };
    let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
    let (m, n) = (mean(&one), mean(&other));
    let contrast = one.iter().map(|v| (v - m).powi(2)).sum::<f32>();
    let difference = one.iter().zip(&other).map(|(a, b)| (a - m - b + n).powi(2)).sum::<f32>();
    difference < UNLIKE.powi(2) * contrast
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grey::pyramid;

    fn image(shift: [f64; 2]) -> Plane {
        let mut plane = Plane::zeros(200, 150);
        for y in 0..150 {
            for x in 0..200 {
                let (u, v) = (x as f64 - shift[0], y as f64 - shift[1]);
                let level = 120.0 + 40.0 * (u * 0.19).sin() * (v * 0.23).cos() + 40.0 * (u * 0.05 + 0.07 * v).sin();
                plane.values[y * 200 + x] = level as f32;
            }
        }
        plane
    }

    #[test]
    fn corners_are_followed_over_many_pixels() {
        let (from, to) = (pyramid(&image([0.0; 2])), pyramid(&image([9.37, -5.61])));
        let corners = corners(&from[0]);
        assert!(corners.len() > 100);
        let expected: Vec<[f64; 2]> = corners.iter().map(|c| c.at).collect();
        let found = displaced(&from, &to, &corners, &expected);
        let mut errors: Vec<f64> = found
            .iter()
            .zip(&corners)
            .filter_map(|(there, c)| there.map(|t| (t[0] - c.at[0] - 9.37).hypot(t[1] - c.at[1] + 5.61)))
            .collect();
        // A wave repeats every 33 pixels, so some corners find the wrong crest; linear interpolation costs hundredths.
        assert!(errors.len() * 3 > corners.len(), "{} of {}", errors.len(), corners.len());
        errors.sort_by(f64::total_cmp);
        assert!(errors[errors.len() / 2] < 0.05, "{}", errors[errors.len() / 2]);
    }

    #[test]
    fn a_plain_image_and_an_edge_have_no_corners() {
        let mut plane = Plane::zeros(100, 80);
        assert!(corners(&plane).is_empty());
        for y in 0..80 {
            plane.values[y * 100 + 50..(y + 1) * 100].fill(200.0);
        }
        assert!(corners(&plane).is_empty());
    }
}
