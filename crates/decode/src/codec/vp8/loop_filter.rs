//! The filter along the edges of blocks (RFC 6386, section 15).

use super::plane::{Vp8Picture, Vp8Plane};

/// Strength of the filter of a macroblock.
#[derive(Debug, Clone, Copy)]
pub(super) struct Strength {
    level: i32,
    interior: i32,
    /// Differences above this one are edges of the picture, not of blocks.
    high_variance: i32,
    /// Whether blocks within it are filtered.
    pub inner: bool,
}

impl Strength {
    /// The strength of a level above 0.
    pub(super) fn new(level: i32, sharpness: i32, is_key: bool, inner: bool) -> Self {
        let shift = if sharpness > 4 { 2 } else { i32::from(sharpness > 0) };
        let most = if sharpness > 0 { 9 - sharpness } else { i32::MAX };
        let high_variance = match level {
            40.. if is_key => 2,
            40.. => 3,
            20.. if !is_key => 2,
            15.. => 1,
            _ => 0,
        };
        Strength { level, interior: (level >> shift).min(most).max(1), high_variance, inner }
    }

    /// Limits of the differences across the edge of a macroblock, and of a block.
    fn limits(&self) -> [i32; 2] {
        [2 * (self.level + 2) + self.interior, 2 * self.level + self.interior]
    }
}

/// Filters the edges of a macroblock at a column and row: on the left, within, above, within.
pub(super) fn normal(picture: &mut Vp8Picture, (column, row): (usize, usize), strength: &Strength) {
    let [whole, inner] = strength.limits();
    for (plane, side) in picture.iter_mut().zip([16, 8, 8]) {
        let (x, y) = (column * side, row * side);
        for (begin, along, across) in [(column > 0, plane.width, 1), (row > 0, 1, plane.width)] {
            let first = y * plane.width + x;
            if begin {
                (0..side).for_each(|at| edge(plane, first + at * along, across, whole, strength, true));
            }
            for block in (4..side).step_by(4).filter(|_| strength.inner) {
                (0..side)
                    .for_each(|at| edge(plane, first + at * along + block * across, across, inner, strength, false));
            }
        }
    }
}

/// The same in its simple form, on luma only.
pub(super) fn simple(picture: &mut Vp8Picture, (column, row): (usize, usize), strength: &Strength) {
    let [whole, inner] = strength.limits();
    let plane = &mut picture[0];
    for (begin, along, across) in [(column > 0, plane.width, 1), (row > 0, 1, plane.width)] {
        let first = 16 * (row * plane.width + column);
        for block in (0..16).step_by(4) {
            let limit = match block {
                0 if begin => whole,
                1.. if strength.inner => inner,
                _ => continue,
            };
            for at in 0..16 {
                let place = first + at * along + block * across;
                let [p1, p0, q0, q1] = around(plane, place, across);
                if 2 * p0.abs_diff(q0) + p1.abs_diff(q1) / 2 <= limit as u32 {
                    let by = clamp(clamp(p1 - q1) + 3 * (q0 - p0));
                    set(plane, place, q0 - (clamp(by + 4) >> 3));
                    set(plane, place - across, p0 + (clamp(by + 3) >> 3));
                }
            }
        }
    }
}

fn clamp(number: i32) -> i32 {
    number.clamp(-128, 127)
}

/// The two levels on both sides of an edge, less 128.
fn around(plane: &Vp8Plane, place: usize, across: usize) -> [i32; 4] {
    let at = |place: usize| i32::from(plane.levels[place]) - 128;
    [at(place - 2 * across), at(place - across), at(place), at(place + across)]
}

fn set(plane: &mut Vp8Plane, place: usize, level: i32) {
    plane.levels[place] = (clamp(level) + 128) as u8;
}

/// Filters across an edge at one place; `is_whole` for the edge of a macroblock.
fn edge(plane: &mut Vp8Plane, place: usize, across: usize, limit: i32, strength: &Strength, is_whole: bool) {
    let [p1, p0, q0, q1] = around(plane, place, across);
    let at = |place: usize| i32::from(plane.levels[place]) - 128;
    let (p3, p2) = (at(place - 4 * across), at(place - 3 * across));
    let (q2, q3) = (at(place + 2 * across), at(place + 3 * across));
    let steps = [p3 - p2, p2 - p1, p1 - p0, q1 - q0, q2 - q1, q3 - q2];
    if steps.iter().any(|step| step.abs() > strength.interior) || 2 * (p0 - q0).abs() + (p1 - q1).abs() / 2 > limit {
        return;
    }
    let is_high = (p1 - p0).abs().max((q1 - q0).abs()) > strength.high_variance;
    let outer = if is_high || is_whole { clamp(p1 - q1) } else { 0 };
    let by = clamp(outer + 3 * (q0 - p0));
    if is_whole && !is_high {
        for (step, (weight, [p, q])) in [27, 18, 9].into_iter().zip([[p0, q0], [p1, q1], [p2, q2]]).enumerate() {
            let by = clamp((63 + by * weight) >> 7);
            set(plane, place + step * across, q - by);
            set(plane, place - (step + 1) * across, p + by);
        }
        return;
    }
    let (after, before) = (clamp(by + 4) >> 3, clamp(by + 3) >> 3);
    set(plane, place, q0 - after);
    set(plane, place - across, p0 + before);
    if !is_high {
        let further = (after + 1) >> 1;
        set(plane, place + across, q1 - further);
        set(plane, place - 2 * across, p1 + further);
    }
}
