//! Prediction from another frame (RFC 6386, section 18).

use super::modes::{Luma, Macroblock, Vector};
use super::plane::{Vp8Picture, Vp8Plane};

/// Weights of six samples by eighths of a pixel.
const SIX_TAPS: [[i32; 6]; 8] = [
    [0, 0, 128, 0, 0, 0],
    [0, -6, 123, 12, -1, 0],
    [2, -11, 108, 36, -8, 1],
    [0, -9, 93, 50, -6, 0],
    [3, -16, 77, 77, -16, 3],
    [0, -6, 50, 93, -9, 0],
    [1, -8, 36, 108, -11, 2],
    [0, -1, 12, 123, -6, 0],
];

/// Predicts a macroblock at a column and row.
pub(super) fn predict(to: &mut Vp8Picture, from: &Vp8Picture, (column, row): (usize, usize), it: &Macroblock) {
    let (x, y) = (16 * column, 16 * row);
    if it.luma != Luma::Divided {
        // A quarter of a pixel of luma is an eighth of one of chroma.
        let vector = it.vectors[0];
        square(&mut to[0], &from[0], (x, y), 16, Vector { x: 2 * vector.x, y: 2 * vector.y });
        (1..3).for_each(|plane| square(&mut to[plane], &from[plane], (x / 2, y / 2), 8, vector));
        return;
    }
    for (block, vector) in it.vectors.iter().enumerate() {
        let place = (x + 4 * (block % 4), y + 4 * (block / 4));
        square(&mut to[0], &from[0], place, 4, Vector { x: 2 * vector.x, y: 2 * vector.y });
    }
    for quarter in 0..4 {
        let (across, down) = (quarter % 2, quarter / 2);
        let first = 8 * down + 2 * across;
        let four = [first, first + 1, first + 4, first + 5].map(|block| it.vectors[block]);
        // Halves are rounded away from zero.
        let mean = |sum: i32| (sum + 2 + (sum >> 31)) >> 2;
        let vector = Vector { x: mean(four.iter().map(|it| it.x).sum()), y: mean(four.iter().map(|it| it.y).sum()) };
        let place = (x / 2 + 4 * across, y / 2 + 4 * down);
        (1..3).for_each(|plane| square(&mut to[plane], &from[plane], place, 4, vector));
    }
}

/// Predicts a square from another frame's, moved by eighths of a pixel.
fn square(to: &mut Vp8Plane, from: &Vp8Plane, (x, y): (usize, usize), side: usize, vector: Vector) {
    let (left, top) = (x as i32 + (vector.x >> 3), y as i32 + (vector.y >> 3));
    let (across, down) = (SIX_TAPS[(vector.x & 7) as usize], SIX_TAPS[(vector.y & 7) as usize]);
    // The square with two samples before it and three after.
    let wide = side + 5;
    let mut around = [0u8; 21 * 21];
    let is_inside = left >= 2
        && top >= 2
        && left + side as i32 + 3 <= from.width as i32
        && top + side as i32 + 3 <= from.height as i32;
    for (row, out) in around.chunks_exact_mut(wide).take(wide).enumerate() {
        let y = top - 2 + row as i32;
        if is_inside {
            let place = y as usize * from.width + left as usize - 2;
            out.copy_from_slice(&from.levels[place..place + wide]);
        } else {
            (-2..).zip(out).for_each(|(step, level)| *level = from.nearest(left + step, y));
        }
    }
    let filter = |taps: &[i32; 6], levels: [u8; 6]| {
        let sum: i32 = taps.iter().zip(levels).map(|(tap, level)| tap * i32::from(level)).sum();
        ((sum + 64) >> 7).clamp(0, 255) as u8
    };
    let mut rows = [0u8; 21 * 16];
    for (row, out) in around.chunks_exact(wide).zip(rows.chunks_exact_mut(side)) {
        for (x, level) in out.iter_mut().enumerate() {
            *level = if vector.x & 7 == 0 {
                row[x + 2]
            } else {
                filter(&across, [row[x], row[x + 1], row[x + 2], row[x + 3], row[x + 4], row[x + 5]])
            };
        }
    }
    let mut levels = [0u8; 256];
    for (place, level) in levels.iter_mut().take(side * side).enumerate() {
        let at = |step: usize| rows[place + step * side];
        *level = if vector.y & 7 == 0 { at(2) } else { filter(&down, [at(0), at(1), at(2), at(3), at(4), at(5)]) };
    }
    to.put((x, y), side, &levels[..side * side]);
}
