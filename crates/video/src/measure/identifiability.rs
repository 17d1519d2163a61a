//! How the unknowns of a fit show in what is seen: each by itself, or only together with others.

use nalgebra::DMatrix;

use super::dynamics::Dynamics;
use super::fit::{Fitted, Observations, Problem};
use super::normal_equations::NormalEquations;

/// How an unconstrained parameter shows in what is seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Identifiability {
    /// It does, or it is not learned.
    ByItself,
    /// Others, or the state in which a motion begins, can take its place. It has no interval.
    OnlyWithOthers,
    /// It changes nothing that is seen. It has no interval.
    Not,
}

/// How each unconstrained parameter of a fit shows; none of a fit whose derivatives are no numbers.
pub fn shown(
    dynamics: &Dynamics,
    tracks: &[Observations],
    learned: &[bool],
    fitted: &Fitted,
) -> Option<Vec<Identifiability>> {
    let problem = Problem::new(dynamics, tracks, learned);
    let jacobian = jacobian(&problem, fitted);
    let equations = NormalEquations::new(&(jacobian.transpose() * &jacobian))?;
    Some(of_unknowns(&problem, fitted, &jacobian, &equations))
}

/// The same by what is already at hand: the derivatives, and the normal equations made of them.
pub(super) fn of_unknowns(
    problem: &Problem,
    fitted: &Fitted,
    jacobian: &DMatrix<f64>,
    equations: &NormalEquations,
) -> Vec<Identifiability> {
    let unidentifiable = equations.are_unidentifiable();
    let mut shown = vec![Identifiability::ByItself; fitted.unconstrained.len()];
    for (column, place) in problem.learned.iter().enumerate() {
        if jacobian.column(column).amax() <= 0.0 {
            shown[*place] = Identifiability::Not;
        } else if unidentifiable[column] {
            shown[*place] = Identifiability::OnlyWithOthers;
        }
    }
    shown
}

/// Derivatives of all rolled-out positions, times their weights, by the unconstrained parameters that are learned, then by
/// the states of each video.
pub(super) fn jacobian(problem: &Problem, fitted: &Fitted) -> DMatrix<f64> {
    let parts: Vec<_> = (0..fitted.states.len())
        .map(|track| problem.of_track(track, &fitted.unconstrained, &fitted.states[track]))
        .collect();
    let rows = parts.iter().map(|part| part.residual.len()).sum();
    let (count, state) = (problem.learned.len(), fitted.states.first().map_or(0, Vec::len));
    let mut jacobian = DMatrix::zeros(rows, count + state * parts.len());
    let mut row = 0;
    for (track, part) in parts.iter().enumerate() {
        let length = part.residual.len();
        jacobian.view_mut((row, 0), (length, count)).copy_from(&part.by_unconstrained);
        jacobian.view_mut((row, count + state * track), (length, state)).copy_from(&part.by_state);
        let weights = problem.weights_of_track(track, &fitted.coordinate_weights);
        jacobian.rows_mut(row, length).column_iter_mut().for_each(|mut column| column.component_mul_assign(&weights));
        row += length;
    }
    jacobian
}
