//! Normal equations whose unknowns may be of very different size.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Added to the diagonal, which is 1, so that unknowns that cannot be told apart have a solution, too. It says nothing of them:
/// see [`NormalEquations::are_unidentifiable`].
const RIDGE: f64 = 1e-11;
/// A combination of unknowns, of one scaled length, that has less of an eigenvalue does not show. Of what is exactly one, the
/// ridge and rounding leave 1e-11; films that tell their unknowns apart leave 1e-5 and more.
const FLAT: f64 = 1e-8;

/// A symmetric matrix, scaled to a diagonal of 1 and factored.
#[derive(Debug)]
pub struct NormalEquations {
    factor: Cholesky<f64, Dyn>,
    /// By which rows and columns were multiplied.
    scale: DVector<f64>,
}

impl NormalEquations {
    /// None of a matrix that is not positive, or no number.
    pub fn new(matrix: &DMatrix<f64>) -> Option<Self> {
        let scale = matrix.diagonal().map(|x| if x > 0.0 { x.sqrt().recip() } else { 1.0 });
        let mut scaled = scaled(matrix, &scale);
        (0..scaled.nrows()).for_each(|i| scaled[(i, i)] += RIDGE);
        Some(NormalEquations { factor: scaled.cholesky()?, scale })
    }

    pub fn inverse(&self) -> DMatrix<f64> {
        scaled(&self.factor.inverse(), &self.scale)
    }

    /// The unknowns for this right side.
    pub fn solve(&self, right: &DVector<f64>) -> DVector<f64> {
        self.factor.solve(&right.component_mul(&self.scale)).component_mul(&self.scale)
    }

    /// Of each unknown, whether it has a part in a combination that does not show. Then nothing is known of it, however narrow
    /// it comes out: what is seen is multiplied by no more than rounding, and divided by the ridge.
    pub fn are_unidentifiable(&self) -> Vec<bool> {
        let lower = self.factor.l();
        let eigen = (&lower * lower.transpose()).symmetric_eigen();
        let mut parts = DVector::zeros(lower.nrows());
        for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
            if *value < FLAT {
                parts += vector.component_mul(&vector);
            }
        }
        // From here on the combination widens it by more than it would be wide if all others were known.
        parts.iter().map(|part| *part > FLAT).collect()
    }

    /// The logarithm of the determinant.
    pub fn log_determinant(&self) -> f64 {
        2.0 * (self.factor.l().diagonal().map(f64::ln).sum() - self.scale.map(f64::ln).sum())
    }
}

fn scaled(matrix: &DMatrix<f64>, scale: &DVector<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] * scale[i] * scale[j])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknowns_of_different_size_are_solved_for() {
        let matrix = DMatrix::from_row_slice(2, 2, &[4e12, 2e3, 2e3, 9e-6]);
        let equations = NormalEquations::new(&matrix).unwrap();
        let determinant: f64 = 4e12 * 9e-6 - 4e6;
        // The ridge shows from the eleventh digit on.
        assert!((equations.log_determinant() - determinant.ln()).abs() < 1e-9);
        let unknowns = equations.solve(&(&matrix * DVector::from_vec(vec![1e-6, 300.0])));
        assert!((unknowns[0] * 1e6 - 1.0).abs() < 1e-9 && (unknowns[1] / 300.0 - 1.0).abs() < 1e-9, "{unknowns}");
        let inverse = equations.inverse();
        assert!((inverse[(1, 1)] * determinant / 4e12 - 1.0).abs() < 1e-9, "{inverse}");
        assert!(NormalEquations::new(&DMatrix::from_element(2, 2, f64::NAN)).is_none());
    }

    /// The third unknown does what the first does, but for a part that is rounding, or that shows.
    #[test]
    fn unknowns_that_are_one_are_told() {
        let unidentifiable = |own: f64| {
            let slopes = DMatrix::from_fn(20, 3, |row, column| {
                let t = row as f64 / 20.0;
                [t, t * t, 300.0 * (t + own * t.powi(3))][column]
            });
            NormalEquations::new(&(slopes.transpose() * &slopes)).unwrap().are_unidentifiable()
        };
        assert_eq!(unidentifiable(1e-10), [true, false, true]);
        assert_eq!(unidentifiable(0.1), [false; 3]);
    }
}
