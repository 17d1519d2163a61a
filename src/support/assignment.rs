//! Which of these is which of those: the assignment of least cost.

use pathfinding::kuhn_munkres::kuhn_munkres_min;
use pathfinding::matrix::Matrix;

/// The solver needs whole numbers.
const UNIT: f64 = 1e6;
const LARGEST: f64 = 1e15;

/// The column for each row of a square matrix of costs, each column once, so that the sum of the costs is least.
///
/// # Panics
/// A matrix that is not square.
pub(crate) fn best_assignment(costs: &[Vec<f64>]) -> Vec<usize> {
    let whole =
        costs.iter().map(|row| row.iter().map(|cost| (cost * UNIT).min(LARGEST).round() as i64).collect::<Vec<_>>());
    let (_, columns) = kuhn_munkres_min(&Matrix::from_rows(whole).expect("rows of one length"));
    columns
}

#[cfg(test)]
mod tests {
    use super::best_assignment;

    #[test]
    fn each_column_is_taken_once() {
        // The cheapest of the first two rows is the same column.
        let costs = [vec![1.0, 2.0, 9.0], vec![1.0, 9.0, 9.0], vec![0.5, 0.5, 3.0]];
        assert_eq!(best_assignment(&costs), [1, 0, 2]);
    }
}
