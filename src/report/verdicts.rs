//! Where the paper's errors come from: what ablations say to two explanations, by rules on their numbers.

use super::statistics::Spread;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    Confirmed,
    Refuted,
    Undecided,
}

impl Verdict {
    pub(super) fn word(self) -> &'static str {
        match self {
            Verdict::Confirmed => "confirmed",
            Verdict::Refuted => "refuted",
            Verdict::Undecided => "undecided",
        }
    }
}

/// The part of an expected excess within which a number counts as equal, and below which an error explains nothing.
const TOLERANCE: f64 = 0.25;

pub(super) const SHIFT_RULE: &str = "confirmed if the raw value over the truth lies within a quarter of the expected \
    excess of the expected factor and, with the exact shift, as near to 1; refuted if it lies as near to 1 without the \
    exact shift, too; undecided otherwise; medians";

/// Whether the decoder's scale makes the error of a parameter. `raw`: the model's own value over the truth with the
/// original's shift; `expected`: what the scale alone would make of it; `exact`: value over truth with the exact shift.
pub(super) fn shift(raw: f64, expected: f64, exact: f64) -> Verdict {
    let near = |ratio: f64, to: f64| (ratio - to).abs() <= TOLERANCE * (expected - 1.0).abs();
    if near(raw, expected) && near(exact, 1.0) {
        Verdict::Confirmed
    } else if near(raw, 1.0) {
        Verdict::Refuted
    } else {
        Verdict::Undecided
    }
}

pub(super) const REFINEMENT_RULE: &str = "confirmed if without the refinement every seed's velocity error and every \
    seed's parameter error are larger than every seed's with it, and the parameter's error has the sign of the \
    paper's; refuted if the median parameter error is no larger without it or below a quarter of the paper's, or if it \
    is larger in every seed with the other sign; undecided otherwise, and where a run without it has lost its objects \
    (L_rec above the original's yardstick), which says nothing of the parameter";

/// What a group of runs says of the velocity and of a parameter.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effect {
    /// Error of the initial velocity.
    pub velocity: Spread,
    /// Error of the parameter in per cent: with its sign, and its size.
    pub error: Spread,
    pub error_size: Spread,
}

/// Whether a badly estimated velocity makes the error of a parameter, `paper` per cent in the paper, where `lost` of the
/// runs without the refinement do not show their objects any more.
pub(super) fn refinement(with: &Effect, without: &Effect, lost: usize, paper: f64) -> Verdict {
    let all_larger = |without: &Spread, with: &Spread| without.min > with.max;
    let worse = all_larger(&without.error_size, &with.error_size);
    let same_sign = without.error.median.signum() == paper.signum();
    let size = without.error_size.median;
    if lost > 0 {
        Verdict::Undecided
    } else if size <= with.error_size.median || size < TOLERANCE * paper.abs() || worse && !same_sign {
        Verdict::Refuted
    } else if worse && all_larger(&without.velocity, &with.velocity) {
        Verdict::Confirmed
    } else {
        Verdict::Undecided
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_explains_an_excess_or_not() {
        let expected = 32.0 / 31.0;
        assert_eq!(shift(1.032, expected, 1.0003), Verdict::Confirmed);
        assert_eq!(shift(1.026, expected, 0.995), Verdict::Confirmed);
        // The excess is there, but with the exact shift as well.
        assert_eq!(shift(1.032, expected, 1.03), Verdict::Undecided);
        assert_eq!(shift(1.001, expected, 1.0), Verdict::Refuted);
        assert_eq!(shift(1.016, expected, 1.0), Verdict::Undecided);
        assert_eq!(shift(1.5, expected, 1.0), Verdict::Undecided);
    }

    #[test]
    fn the_velocity_explains_an_error_or_not() {
        let spread = |values: [f64; 3]| Spread::of(values.into_iter()).unwrap();
        let effect = |velocity, error: [f64; 3]| Effect {
            velocity: spread(velocity),
            error: spread(error),
            error_size: spread(error.map(f64::abs)),
        };
        let refinement = |with: &Effect, without: &Effect, paper| refinement(with, without, 0, paper);
        let with = effect([0.20, 0.21, 0.24], [-0.2, -0.1, -0.3]);
        let slow = [0.9, 1.0, 1.1];
        assert_eq!(refinement(&with, &effect(slow, [4.0, 6.0, 5.0]), 6.5), Verdict::Confirmed);
        assert_eq!(refinement(&with, &effect(slow, [-4.0, -6.0, -5.0]), 6.5), Verdict::Refuted);
        assert_eq!(refinement(&with, &effect(slow, [0.1, 0.1, 0.0]), 6.5), Verdict::Refuted);
        // No objects, no parameter.
        assert_eq!(super::refinement(&with, &effect(slow, [4.0, 6.0, 5.0]), 1, 6.5), Verdict::Undecided);
        // Larger, but far too small.
        assert_eq!(refinement(&with, &effect(slow, [1.4, 1.2, 1.7]), 6.5), Verdict::Refuted);
        // One seed is as good as with the refinement.
        assert_eq!(refinement(&with, &effect(slow, [4.0, 6.0, 0.1]), 6.5), Verdict::Undecided);
        // A larger error, but not from the velocity.
        assert_eq!(refinement(&with, &effect([0.2, 0.2, 0.2], [4.0, 6.0, 5.0]), 6.5), Verdict::Undecided);
    }
}
