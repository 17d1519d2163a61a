//! Least squares by damped Gauss-Newton steps (Levenberg and Marquardt), for problems that solve their normal equations
//! themselves.

/// Damping at the start, its change after a failed or a good iteration, and where it gives up.
const DAMPING: f64 = 1e-2;
const DAMPING_UP: f64 = 8.0;
const DAMPING_DOWN: f64 = 0.3;
const DAMPING_LIMIT: f64 = 1e8;

/// Changes `unknowns` until their cost falls by less than a share of `converged` in an iteration, or no step makes it smaller,
/// or for so many iterations at most; returns how many there were. `step` gives the unknowns after a step from where they were
/// linearised, with a damping; none, and a cost that is not a number, are no better.
pub fn minimise<Unknowns, Linearised>(
    unknowns: &mut Unknowns,
    (most, converged): (usize, f64),
    cost: impl Fn(&Unknowns) -> f64,
    linearise: impl Fn(&Unknowns) -> Linearised,
    step: impl Fn(&Unknowns, &Linearised, f64) -> Option<Unknowns>,
) -> usize {
    let (mut damping, mut least) = (DAMPING, cost(unknowns));
    for iteration in 0..most {
        let at = linearise(unknowns);
        loop {
            let next = step(unknowns, &at, damping).map(|next| (cost(&next), next));
            if let Some((next_cost, next)) = next.filter(|(next_cost, _)| *next_cost < least) {
                let fall = (least - next_cost) / least;
                (*unknowns, least) = (next, next_cost);
                damping *= DAMPING_DOWN;
                if fall < converged {
                    return iteration + 1;
                }
                break;
            }
            damping *= DAMPING_UP;
            if damping > DAMPING_LIMIT {
                return iteration + 1;
            }
        }
    }
    most
}

#[cfg(test)]
mod tests {
    use super::minimise;

    /// Rosenbrock's valley: residuals 10 (y - x^2) and 1 - x, least at (1, 1).
    #[test]
    fn the_end_of_a_bent_valley_is_found() {
        let residuals = |at: &[f64; 2]| [10.0 * (at[1] - at[0] * at[0]), 1.0 - at[0]];
        let mut at = [-1.2, 1.0];
        let iterations = minimise(
            &mut at,
            (100, 1e-12),
            |at| residuals(at).iter().map(|residual| residual * residual).sum(),
            |at| (residuals(at), [[-20.0 * at[0], 10.0], [-1.0, 0.0]]),
            |at, (residuals, slopes), damping| {
                let sum = |a: usize, b: usize| slopes.iter().map(|slope| slope[a] * slope[b]).sum::<f64>();
                let pull =
                    |a: usize| slopes.iter().zip(residuals).map(|(slope, residual)| slope[a] * residual).sum::<f64>();
                let [[a, b], [c, d]] =
                    [[sum(0, 0) * (1.0 + damping), sum(0, 1)], [sum(1, 0), sum(1, 1) * (1.0 + damping)]];
                let (determinant, [p, q]) = (a * d - b * c, [pull(0), pull(1)]);
                Some([at[0] - (d * p - b * q) / determinant, at[1] - (a * q - c * p) / determinant])
            },
        );
        assert!((at[0] - 1.0).abs() < 1e-6 && (at[1] - 1.0).abs() < 1e-6, "{at:?} after {iterations}");
        assert!(iterations < 100);
    }
}
