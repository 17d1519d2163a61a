//! Inverse discrete cosine transform of 8 x 8 coefficients in integers. JPEG leaves its rounding open; this one has the
//! constants and shifts of ffmpeg's "simple" transform, so that frames are the same as ffmpeg's, not a level off.

/// Cosines `round(2^14 sqrt(2) cos(k pi / 16))`, the fourth one less by 1.
const W: [i32; 8] = [0, 22_725, 21_407, 19_266, 16_383, 12_873, 8867, 4520];
/// Bits dropped after the rows and after the columns.
const ROW_SHIFT: u32 = 11;
const COLUMN_SHIFT: u32 = 20;

/// Transforms coefficients in row order; returns levels in row order.
pub(super) fn inverse(coefficients: &[i16; 64]) -> [u8; 64] {
    let mut rows = [0i16; 64];
    for (row, out) in coefficients.chunks_exact(8).zip(rows.chunks_exact_mut(8)) {
        if row[1..].iter().all(|it| *it == 0) {
            out.fill(row[0].wrapping_mul(8));
            continue;
        }
        let sums = sums(|at| row[at].into(), W[4].wrapping_mul(row[0].into()).wrapping_add(1 << (ROW_SHIFT - 1)));
        for (out, sum) in out.iter_mut().zip(sums) {
            *out = (sum >> ROW_SHIFT) as i16;
        }
    }
    let mut levels = [0; 64];
    for column in 0..8 {
        let first = i32::from(rows[column]) + (1 << (COLUMN_SHIFT - 1)) / W[4];
        let sums = sums(|at| rows[8 * at + column].into(), W[4].wrapping_mul(first));
        for (at, sum) in sums.into_iter().enumerate() {
            levels[8 * at + column] = (sum >> COLUMN_SHIFT).clamp(0, 255) as u8;
        }
    }
    levels
}

/// The eight sums of a row or column whose constant part is given.
fn sums(it: impl Fn(usize) -> i32, constant: i32) -> [i32; 8] {
    let product = |cosine: usize, at: usize| W[cosine].wrapping_mul(it(at));
    let even = [
        [product(2, 2), product(4, 4), product(6, 6)],
        [product(6, 2), -product(4, 4), -product(2, 6)],
        [-product(6, 2), -product(4, 4), product(2, 6)],
        [-product(2, 2), product(4, 4), -product(6, 6)],
    ];
    let odd = [
        [product(1, 1), product(3, 3), product(5, 5), product(7, 7)],
        [product(3, 1), -product(7, 3), -product(1, 5), -product(5, 7)],
        [product(5, 1), -product(1, 3), product(7, 5), product(3, 7)],
        [product(7, 1), -product(5, 3), product(3, 5), -product(1, 7)],
    ];
    let sum = |terms: &[i32]| terms.iter().fold(0i32, |sum, term| sum.wrapping_add(*term));
    let even = even.map(|terms| constant.wrapping_add(sum(&terms)));
    let odd = odd.map(|terms| sum(&terms));
    std::array::from_fn(|at| {
        let half = at.min(7 - at);
        if at < 4 { even[half].wrapping_add(odd[half]) } else { even[half].wrapping_sub(odd[half]) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Against the transform in double precision (ITU-T T.81, A.3.3); the standard of accuracy for such transforms
    /// (IEEE 1180) allows one level.
    #[test]
    fn levels_are_within_one_of_the_exact_transform() {
        let mut state = 1u32;
        for _ in 0..200 {
            let coefficients: [i16; 64] = std::array::from_fn(|at| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let size = if at == 0 { 2040 } else { 300 / (at as i32 + 1) };
                ((state >> 8) as i32 % (size + 1)) as i16 * if at > 0 && state & 1 == 1 { -1 } else { 1 }
            });
            let levels = inverse(&coefficients);
            for (at, level) in levels.into_iter().enumerate() {
                let [x, y] = [at % 8, at / 8].map(|it| it as f64);
                let exact: f64 = (0..64)
                    .map(|k| {
                        let [u, v] = [k % 8, k / 8];
                        let norm = |k: usize| if k == 0 { 0.5f64.sqrt() } else { 1.0 };
                        let wave = |x: f64, k: usize| ((2.0 * x + 1.0) * k as f64 * PI / 16.0).cos();
                        norm(u) * norm(v) / 4.0 * f64::from(coefficients[k]) * wave(x, u) * wave(y, v)
                    })
                    .sum();
                assert!((f64::from(level) - exact.clamp(0.0, 255.0)).abs() <= 1.0, "{level} for {exact}");
            }
        }
    }
}
