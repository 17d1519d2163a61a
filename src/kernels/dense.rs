//! The matrix products of a dense layer, by the crate gemm: on AMD's processors libtorch's take vectors of half the width.

use gemm_common::Parallelism;
use gemm_f32::gemm::f32::get_gemm_fn;

use super::threads::on_all_threads;

/// A matrix in memory, row by row, or its transpose.
#[derive(Debug, Clone, Copy)]
pub struct Matrix<'a> {
    data: &'a [f32],
    size: [usize; 2],
    /// Floats from one row to the next, and from one column to the next.
    apart: [isize; 2],
}

impl<'a> Matrix<'a> {
    /// `[rows, columns]`.
    ///
    /// # Panics
    /// Another number of floats.
    pub fn new(data: &'a [f32], size: [usize; 2]) -> Self {
        assert_eq!(data.len(), size[0] * size[1]);
        Matrix { data, size, apart: [size[1] as isize, 1] }
    }

    pub fn transposed(self) -> Self {
        let ([rows, columns], [row, column]) = (self.size, self.apart);
        Matrix { size: [columns, rows], apart: [column, row], ..self }
    }
}

/// `a b` to `to`, row by row. Its sums do not depend on the number of threads.
///
/// # Panics
/// Matrices that do not fit.
pub fn product(a: Matrix, b: Matrix, to: &mut [f32]) {
    let ([rows, terms], [_, columns]) = (a.size, b.size);
    assert!(terms == b.size[0] && to.len() == rows * columns);
    let ([a_row, a_column], [b_row, b_column]) = (a.apart, b.apart);
    on_all_threads(|threads| {
        let threads = if threads == 1 { Parallelism::None } else { Parallelism::Rayon(threads) };
        let (to, to_row) = (to.as_mut_ptr(), columns as isize);
        let [a, b] = [a, b].map(|matrix| matrix.data.as_ptr());
        // `to` is not added to, and nothing is conjugated.
        let (adds, conjugates) = (false, false);
        // SAFETY: each slice has as many floats as its rows and columns say, and `to` is borrowed alone.
        unsafe {
            get_gemm_fn()(
                rows, columns, terms, to, 1, to_row, adds, a, a_column, a_row, b, b_column, b_row, 0.0, 1.0,
                conjugates, conjugates, conjugates, threads,
            );
        }
    });
}
