//! The matrix products of a dense layer, forward and backward: on AMD's processors libtorch's take vectors of half the
//! width, and a library for matrices of any shape copies as much as it multiplies where they are as flat as these.
//!
//! Numbers of a row stand side by side. A sum has the same order whatever the number of threads.

use super::simd::{Instructions, Lanes, dispatched};
use super::threads::{in_parallel, threads};

/// Rows that go over the weights together, and numbers of each at a time: they stay in a core's cache.
const ROWS: usize = 64;
const SEGMENT: usize = 1024;
/// Rows in a tile of sums over rows; with the other matrix's they fill the registers.
const TILE_ROWS: usize = 4;

/// Vectors side by side in a panel of columns, and rows of it at a time.
const PANEL: usize = 3;
const DEPTH: usize = 256;
/// Lanes of the widest vectors.
const WIDEST: usize = 16;

/// `x weight^T`: rows `[rows, terms]` of both, to `[rows, outputs]`.
///
/// # Panics
/// Matrices that do not fit.
pub fn by_rows(instructions: Instructions, terms: usize, x: &[f32], weight: &[f32], to: &mut [f32]) {
    let (rows, outputs) = (x.len() / terms, weight.len() / terms);
    assert!([x.len(), weight.len(), to.len()] == [rows * terms, outputs * terms, rows * outputs]);
    let part = rows_of_each(rows, TILE_ROWS).min(ROWS);
    let parts = x.chunks(part * terms).zip(to.chunks_mut(part * outputs));
    in_parallel(parts.collect(), |(x, to)| sums_over_rows(instructions, terms, x, weight, to));
}

/// Rows that each thread has, in whole tiles.
fn rows_of_each(rows: usize, tile: usize) -> usize {
    rows.div_ceil(threads()).next_multiple_of(tile).max(tile)
}

dispatched! {
    fn sums_over_rows(terms: usize, x: &[f32], weight: &[f32], to: &mut [f32]) = sums_over_rows_lanes
}

#[inline(always)]
fn sums_over_rows_lanes<L: Lanes>(terms: usize, x: &[f32], weight: &[f32], to: &mut [f32]) {
    if L::LANES == 16 {
        sums_in_tiles::<L, 6>(terms, x, weight, to);
    } else {
        sums_in_tiles::<L, 2>(terms, x, weight, to);
    }
}

#[inline(always)]
fn sums_in_tiles<L: Lanes, const OUTPUTS: usize>(terms: usize, x: &[f32], weight: &[f32], to: &mut [f32]) {
    let (rows, outputs) = (x.len() / terms, weight.len() / terms);
    to.fill(0.0);
    for first in (0..terms).step_by(SEGMENT) {
        let length = SEGMENT.min(terms - first);
        // Past the last row stands the last one again.
        let row = |of: &[f32], count: usize, row: usize| of[row.min(count - 1) * terms + first..][..length].as_ptr();
        for output in (0..outputs).step_by(OUTPUTS) {
            let weights: [_; OUTPUTS] = std::array::from_fn(|i| row(weight, outputs, output + i));
            for at in (0..rows).step_by(TILE_ROWS) {
                let seen: [_; TILE_ROWS] = std::array::from_fn(|i| row(x, rows, at + i));
                // SAFETY: each points to `length` numbers.
                let sums = unsafe { tile_of_sums::<L, OUTPUTS>(length, seen, weights) };
                for (o, sums) in sums.iter().enumerate().take(outputs - output) {
                    for (r, sum) in sums.iter().enumerate().take(rows - at) {
                        to[(at + r) * outputs + output + o] += sum;
                    }
                }
            }
        }
    }
}

/// The sums of products of each of some rows with each of some others.
///
/// # Safety
/// All point to `length` numbers.
#[inline(always)]
unsafe fn tile_of_sums<L: Lanes, const OUTPUTS: usize>(
    length: usize,
    x: [*const f32; TILE_ROWS],
    weights: [*const f32; OUTPUTS],
) -> [[f32; TILE_ROWS]; OUTPUTS] {
    unsafe {
        let mut sums = [[L::splat(0.0); TILE_ROWS]; OUTPUTS];
        let whole = length - length % L::LANES;
        for at in (0..whole).step_by(L::LANES) {
            let x = x.map(|x| L::load(x.add(at)));
            for (sums, weights) in sums.iter_mut().zip(weights) {
                let weight = L::load(weights.add(at));
                sums.iter_mut().zip(x).for_each(|(sum, x)| *sum = sum.add_product(x, weight));
            }
        }
        let mut totals = [[0.0; TILE_ROWS]; OUTPUTS];
        for ((totals, sums), weights) in totals.iter_mut().zip(sums).zip(weights) {
            *totals = L::sums(sums);
            for at in whole..length {
                totals.iter_mut().zip(x).for_each(|(total, x)| *total += *x.add(at) * *weights.add(at));
            }
        }
        totals
    }
}

/// What the rows of a matrix are multiplied with: `[rows, terms]` in memory as the two distances say.
#[derive(Debug, Clone, Copy)]
pub struct Factors<'a> {
    data: &'a [f32],
    rows: usize,
    terms: usize,
    /// Numbers from one row to the next, and from one term to the next.
    apart: [usize; 2],
}

impl<'a> Factors<'a> {
    /// `[rows, terms]`, row by row.
    pub fn new(data: &'a [f32], terms: usize) -> Self {
        let rows = data.len() / terms;
        assert_eq!(data.len(), rows * terms);
        Factors { data, rows, terms, apart: [terms, 1] }
    }

    pub fn transposed(self) -> Self {
        let [row, term] = self.apart;
        Factors { rows: self.terms, terms: self.rows, apart: [term, row], ..self }
    }

    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Where the factor of a term stands in a row.
    fn place(&self, row: usize, term: usize) -> *const f32 {
        self.data[row * self.apart[0] + term * self.apart[1]..].as_ptr()
    }
}

/// `factors matrix`: `[rows, terms]` and `[terms, columns]` to `[rows, columns]`.
///
/// # Panics
/// Matrices that do not fit.
pub fn combined(instructions: Instructions, factors: Factors, matrix: &[f32], to: &mut [f32]) {
    if factors.rows == 0 || factors.terms == 0 {
        return to.fill(0.0);
    }
    let columns = to.len() / factors.rows;
    assert!([matrix.len(), to.len()] == [factors.terms * columns, factors.rows * columns]);
    let part = rows_of_each(factors.rows, 2 * TILE_ROWS);
    let parts: Vec<_> = to.chunks_mut(part * columns).enumerate().collect();
    in_parallel(parts, |(number, to)| combine(instructions, factors, number * part, matrix, to));
}

dispatched! {
    /// The rows from `first` on.
    fn combine(factors: Factors, first: usize, matrix: &[f32], to: &mut [f32]) = combine_lanes
}

#[inline(always)]
fn combine_lanes<L: Lanes>(factors: Factors, first: usize, matrix: &[f32], to: &mut [f32]) {
    if L::LANES == 16 {
        combine_in_tiles::<L, 8>(factors, first, matrix, to);
    } else {
        combine_in_tiles::<L, 4>(factors, first, matrix, to);
    }
}

#[inline(always)]
fn combine_in_tiles<L: Lanes, const TILE: usize>(factors: Factors, first: usize, matrix: &[f32], to: &mut [f32]) {
    let columns = matrix.len() / factors.terms;
    let rows = to.len() / columns;
    let width = PANEL * L::LANES;
    let mut panel = vec![0.0; DEPTH.min(factors.terms) * width];
    for start in (0..factors.terms).step_by(DEPTH) {
        let depth = DEPTH.min(factors.terms - start);
        for column in (0..columns).step_by(width) {
            let taken = width.min(columns - column);
            for (term, kept) in panel.chunks_exact_mut(width).take(depth).enumerate() {
                let row = &matrix[(start + term) * columns + column..];
                kept[..taken].copy_from_slice(&row[..taken]);
                // SAFETY: what is asked for need not be there.
                (0..PANEL).for_each(|i| unsafe { L::fetch(row.as_ptr().wrapping_add(width + i * L::LANES)) });
            }
            for row in (0..rows).step_by(TILE) {
                // Past the last row stands the last one again.
                let place = |i: usize| factors.place((first + row + i).min(first + rows - 1), start);
                // SAFETY: each row has `depth` factors from there on, and the panel as many rows.
                let sums = unsafe {
                    let rows: [_; TILE] = std::array::from_fn(place);
                    tile_of_combinations::<L, TILE>(depth, rows, factors.apart[1], panel.as_ptr())
                };
                for (r, sums) in sums.iter().enumerate().take(rows - row) {
                    write(sums, &mut to[(row + r) * columns + column..][..taken], start > 0);
                }
            }
        }
    }
}

/// The sums of a panel's rows, each times the factor of its term, for each of some rows of factors.
///
/// # Safety
/// Each row points to `depth` factors that are `apart` from each other, and the panel to as many rows of vectors.
#[inline(always)]
unsafe fn tile_of_combinations<L: Lanes, const TILE: usize>(
    depth: usize,
    rows: [*const f32; TILE],
    apart: usize,
    panel: *const f32,
) -> [[L; PANEL]; TILE] {
    unsafe {
        let mut sums = [[L::splat(0.0); PANEL]; TILE];
        for term in 0..depth {
            let values: [L; PANEL] = std::array::from_fn(|i| L::load(panel.add((term * PANEL + i) * L::LANES)));
            for (sums, row) in sums.iter_mut().zip(rows) {
                let factor = L::splat(*row.add(term * apart));
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum = sum.add_product(factor, value));
            }
        }
        sums
    }
}

/// Writes the first numbers of some vectors, or adds them to what is there.
#[inline(always)]
fn write<L: Lanes>(vectors: &[L; PANEL], to: &mut [f32], adds: bool) {
    if to.len() == PANEL * L::LANES {
        for (vector, to) in vectors.iter().zip(to.chunks_exact_mut(L::LANES)) {
            // SAFETY: as many numbers as a vector has.
            unsafe { if adds { vector.add(L::load(to.as_ptr())) } else { *vector }.store(to.as_mut_ptr()) };
        }
        return;
    }
    let mut numbers = [0.0; PANEL * WIDEST];
    for (vector, numbers) in vectors.iter().zip(numbers.chunks_exact_mut(L::LANES)) {
        // SAFETY: as above.
        unsafe { vector.store(numbers.as_mut_ptr()) };
    }
    for (to, number) in to.iter_mut().zip(numbers) {
        *to = if adds { *to + number } else { number };
    }
}

#[cfg(test)]
mod tests {
    use rand::Rng;

    use super::{Factors, Instructions, by_rows, combined};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    /// Whole and broken tiles, panels, vectors, segments and depths, against sums in double precision: 1e-6 of the sum of
    /// magnitudes is twenty roundings of float32, and the longest sum has seventy vectors after each other.
    #[test]
    fn products_are_exact_to_rounding_on_all_instructions() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        for [rows, terms, columns] in [[1, 1, 1], [3, 17, 5], [4, 16, 6], [9, 600, 50], [70, 1100, 200], [8, 256, 48]] {
            let [x, weight, matrix] = [rows * terms, columns * terms, terms * columns]
                .map(|n| -> Vec<f32> { (0..n).map(|_| random.random::<f32>() - 0.5).collect() });
            let sum = |row: usize, of_term: &dyn Fn(usize) -> f32| {
                let products = (0..terms).map(|term| f64::from(x[row * terms + term]) * f64::from(of_term(term)));
                products.fold((0.0, 0.0), |(sum, size), product| (sum + product, size + product.abs()))
            };
            for instructions in Instructions::all() {
                let mut by = vec![f32::NAN; rows * columns];
                by_rows(instructions, terms, &x, &weight, &mut by);
                let mut straight = vec![f32::NAN; rows * columns];
                combined(instructions, Factors::new(&x, terms), &matrix, &mut straight);
                let turned: Vec<_> = (0..terms * rows).map(|i| x[i % rows * terms + i / rows]).collect();
                let mut transposed = vec![f32::NAN; rows * columns];
                combined(instructions, Factors::new(&turned, rows).transposed(), &matrix, &mut transposed);
                assert_eq!(straight, transposed, "{rows} x {terms} x {columns}");
                for place in 0..rows * columns {
                    let (row, column) = (place / columns, place % columns);
                    let exact = [
                        (by[place], sum(row, &|term| weight[column * terms + term])),
                        (straight[place], sum(row, &|term| matrix[term * columns + column])),
                    ];
                    for (ours, (sum, size)) in exact {
                        let off = (f64::from(ours) - sum).abs();
                        assert!(off <= 1e-6 * size, "{rows} x {terms} x {columns} at {place}: {ours} for {sum}");
                    }
                }
            }
        }
    }

    #[test]
    fn no_rows_change_no_weight() {
        for instructions in Instructions::all() {
            let mut gradient = [f32::NAN; 6];
            combined(instructions, Factors::new(&[], 3).transposed(), &[], &mut gradient);
            assert_eq!(gradient, [0.0; 6]);
            combined(instructions, Factors::new(&[], 3), &[1.0; 6], &mut []);
        }
    }
}
