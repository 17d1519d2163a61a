//! The sum of squared differences, and its gradient, in one pass each.

use super::simd::{Instructions, Lanes, dispatched};
use super::threads::{in_parallel, part_of};

/// Rows of floats `[.., width]` in memory, one at each of these places.
#[derive(Debug, Clone)]
pub struct Rows<'a> {
    pub data: &'a [f32],
    pub starts: Vec<usize>,
    pub width: usize,
}

impl<'a> Rows<'a> {
    fn row(&self, row: usize) -> &'a [f32] {
        &self.data[self.starts[row]..][..self.width]
    }
}

/// `sum (a - b)^2`.
pub fn squared_error(instructions: Instructions, a: &Rows, b: &Rows) -> f64 {
    assert!(a.starts.len() == b.starts.len() && a.width == b.width);
    let rows: Vec<usize> = (0..a.starts.len()).collect();
    let parts: Vec<_> = rows.chunks(part_of(rows.len())).collect();
    let sums = in_parallel(parts, |rows| {
        let mut sum = 0.0;
        for &row in rows {
            add_squared_error(instructions, a.row(row), b.row(row), &mut sum);
        }
        sum
    });
    sums.iter().sum()
}

dispatched! {
    fn add_squared_error(a: &[f32], b: &[f32], sum: &mut f64) = add_squared_error_lanes
}

#[inline(always)]
fn add_squared_error_lanes<L: Lanes>(a: &[f32], b: &[f32], sum: &mut f64) {
    let (vectors, rest) = (a.len() / L::LANES, a.len() % L::LANES);
    assert_eq!(a.len(), b.len());
    // SAFETY: both slices have `vectors` vectors.
    unsafe {
        let minus = L::splat(-1.0);
        let mut total = L::splat(0.0);
        for i in 0..vectors {
            let [a, b] = [a, b].map(|slice| L::load(slice.as_ptr().add(i * L::LANES)));
            let difference = a.add_product(b, minus);
            total = total.add_product(difference, difference);
        }
        *sum += f64::from(total.sum());
    }
    let last = a.len() - rest..;
    *sum += a[last.clone()].iter().zip(&b[last]).map(|(a, b)| f64::from((a - b) * (a - b))).sum::<f64>();
}

/// `factor (a - b)` to `to`, `[rows, width]`.
pub fn difference(a: &Rows, b: &Rows, factor: f32, to: &mut [f32]) {
    assert!(a.starts.len() == b.starts.len() && a.width == b.width && to.len() == a.starts.len() * a.width);
    let part = part_of(a.starts.len());
    let parts: Vec<_> = to.chunks_mut(part * a.width).enumerate().collect();
    in_parallel(parts, |(number, to)| {
        for (i, to) in to.chunks_exact_mut(a.width).enumerate() {
            let (a, b) = (a.row(number * part + i), b.row(number * part + i));
            for ((to, a), b) in to.iter_mut().zip(a).zip(b) {
                *to = factor * (a - b);
            }
        }
    });
}
