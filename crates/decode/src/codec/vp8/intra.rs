//! Prediction from the edges of the same frame (RFC 6386, section 12).

use super::modes::PredictionMode;
use super::plane::Vp8Plane;

/// Levels beyond the frame: above it, and on its left.
const ABOVE: u8 = 127;
const LEFT: u8 = 129;

/// Levels around a square.
struct EdgeSamples {
    /// Above, and beyond on the right for blocks.
    above: [u8; 20],
    left: [u8; 16],
    corner: u8,
}

impl EdgeSamples {
    fn of(plane: &Vp8Plane, (x, y): (usize, usize), side: usize) -> Self {
        let mut edges = EdgeSamples { above: [ABOVE; 20], left: [LEFT; 16], corner: ABOVE };
        if y > 0 {
            let place = (y - 1) * plane.width + x;
            edges.above[..side].copy_from_slice(&plane.levels[place..place + side]);
            edges.corner = if x > 0 { plane.at(x - 1, y - 1) } else { LEFT };
        }
        if x > 0 {
            (0..side).for_each(|row| edges.left[row] = plane.at(x - 1, y + row));
        }
        edges
    }
}

/// Predicts a square of 8 or 16.
pub(super) fn whole(plane: &mut Vp8Plane, place: (usize, usize), side: usize, mode: PredictionMode) {
    let edges = EdgeSamples::of(plane, place, side);
    let (above, left) = (&edges.above[..side], &edges.left[..side]);
    let sum = |levels: &[u8]| levels.iter().map(|&level| u32::from(level)).sum::<u32>();
    let count = side as u32;
    let mean = match (place.1 > 0, place.0 > 0) {
        (true, true) => (sum(above) + sum(left) + count) / (2 * count),
        (true, false) => (sum(above) + count / 2) / count,
        (false, true) => (sum(left) + count / 2) / count,
        (false, false) => 128,
    };
    let mut levels = [0; 256];
    for (y, row) in levels.chunks_exact_mut(side).take(side).enumerate() {
        match mode {
            PredictionMode::Mean => row.fill(mean as u8),
            PredictionMode::Vertical => row.copy_from_slice(above),
            PredictionMode::Horizontal => row.fill(left[y]),
            PredictionMode::Gradient => {
                for (level, above) in row.iter_mut().zip(above) {
                    *level = gradient(*above, left[y], edges.corner);
                }
            }
        }
    }
    plane.put(place, side, &levels[..side * side]);
}

fn gradient(above: u8, left: u8, corner: u8) -> u8 {
    (i32::from(above) + i32::from(left) - i32::from(corner)).clamp(0, 255) as u8
}

/// Predicts a block of 4 x 4; `beyond` are the four levels above on its right.
pub(super) fn block(plane: &mut Vp8Plane, place: (usize, usize), mode: u8, beyond: [u8; 4]) {
    let edges = EdgeSamples::of(plane, place, 4);
    let mut above = [0; 8];
    above[..4].copy_from_slice(&edges.above[..4]);
    above[4..].copy_from_slice(&beyond);
    let left = [edges.left[0], edges.left[1], edges.left[2], edges.left[3]];
    // From the lowest level on the left around the corner to the last above.
    let mut around = [0; 13];
    (0..4).for_each(|at| around[at] = left[3 - at]);
    around[4] = edges.corner;
    around[5..].copy_from_slice(&above);
    let two = |a: u8, b: u8| (u32::from(a) + u32::from(b)).div_ceil(2) as u8;
    let three = |a: u8, b: u8, c: u8| ((u32::from(a) + 2 * u32::from(b) + u32::from(c) + 2) / 4) as u8;
    // Smoothed around a place of `around`, and between it and the next.
    let at = |place: usize| three(around[place - 1], around[place], around[place + 1]);
    let between = |place: usize| two(around[place], around[place + 1]);
    let up = |place: usize| three(above[place], above[place + 1], above[(place + 2).min(7)]);
    let down = |place: usize| three(left[place.min(3)], left[(place + 1).min(3)], left[(place + 2).min(3)]);
    let mean = above[..4].iter().chain(&left).map(|&level| u32::from(level)).sum::<u32>();
    let level = |x: usize, y: usize| match mode {
        0 => ((mean + 4) / 8) as u8,
        1 => gradient(above[x], left[y], edges.corner),
        2 => at(5 + x),
        3 if y == 3 => three(left[2], left[3], left[3]),
        3 => at(3 - y),
        // Left-down, right-down.
        4 => up(x + y),
        5 => at(4 + x - y),
        // Vertical-right: along lines of two rows down for one to the right.
        6 => match 2 * x as i32 - y as i32 {
            -3 => at(2),
            -2 => at(3),
            -1 => at(4),
            step if step % 2 == 0 => between(4 + step as usize / 2),
            step => at(4 + (step as usize).div_ceil(2)),
        },
        // Vertical-left, with two exceptions in its last rows.
        7 => match (x, y) {
            (3, 2) => up(4),
            (3, 3) => up(5),
            (x, y) if y % 2 == 0 => two(above[x + y / 2], above[x + y / 2 + 1]),
            (x, y) => up(x + y / 2),
        },
        // Horizontal-down.
        8 => match 2 * y as i32 - x as i32 {
            -3 => at(6),
            -2 => at(5),
            -1 => at(4),
            step if step % 2 == 0 => between(3 - step as usize / 2),
            step => at(4 - (step as usize).div_ceil(2)),
        },
        // Horizontal-up.
        _ => match x + 2 * y {
            step if step > 5 => left[3],
            step if step % 2 == 0 => two(left[step / 2], left[(step / 2 + 1).min(3)]),
            step => down(step / 2),
        },
    };
    let levels: [u8; 16] = std::array::from_fn(|place| level(place % 4, place / 4));
    plane.put(place, 4, &levels);
}

/// The four levels above a macroblock of luma on its right, which the blocks of its last column share.
pub(super) fn beyond(plane: &Vp8Plane, (x, y): (usize, usize)) -> [u8; 4] {
    match y.checked_sub(1) {
        None => [ABOVE; 4],
        Some(above) if x + 16 >= plane.width => [plane.at(x + 15, above); 4],
        Some(above) => std::array::from_fn(|step| plane.at(x + 16 + step, above)),
    }
}
