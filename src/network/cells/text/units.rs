//! Units as powers of a length and of a time.

use std::fmt::{self, Display, Formatter};

/// Powers that differ by less are equal: roots are computed in floating point.
const EQUAL: f64 = 1e-9;

/// The unit of an expression.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Unit {
    /// Not known, because a parameter without a unit takes part: fits everything.
    Any,
    /// Of numbers that stand in the text: fits everything in a sum, counts as no unit in a product.
    Literal,
    /// Powers of length and of time.
    Of([f64; 2]),
}

impl Unit {
    pub(super) const NONE: Unit = Unit::Of([0.0; 2]);

    /// That of a sum, if there can be one.
    pub(super) fn plus(self, other: Unit) -> Option<Unit> {
        match (self, other) {
            (Unit::Of(a), Unit::Of(b)) => a.iter().zip(b).all(|(a, b)| (a - b).abs() < EQUAL).then_some(self),
            (Unit::Of(_), _) | (Unit::Any, Unit::Literal) => Some(self),
            (_, other) => Some(other),
        }
    }

    pub(super) fn times(self, other: Unit) -> Unit {
        match (self, other) {
            (Unit::Any, _) | (_, Unit::Any) => Unit::Any,
            (Unit::Of(a), Unit::Of(b)) => Unit::Of([a[0] + b[0], a[1] + b[1]]),
            (Unit::Literal, other) => other,
            (unit, Unit::Literal) => unit,
        }
    }

    pub(super) fn over(self, other: Unit) -> Unit {
        self.times(other.raised(-1.0))
    }

    pub(super) fn raised(self, power: f64) -> Unit {
        match self {
            Unit::Of(powers) => Unit::Of(powers.map(|own| own * power)),
            other => other,
        }
    }

    /// Whether it can be that of a plain number.
    pub(super) fn is_none(self) -> bool {
        self.plus(Unit::NONE).is_some()
    }
}

impl Display for Unit {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        match self {
            Unit::Any => write!(f, "an unknown unit"),
            Unit::Literal => write!(f, "a number"),
            // A rounding error of a root must not show as -0.
            Unit::Of(powers) => {
                let [length, time] = powers.map(|power| (power * 1e6).round() / 1e6 + 0.0);
                write!(f, "[{length}, {time}]")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_follow_the_arithmetic() {
        let [length, rate] = [Unit::Of([1.0, 0.0]), Unit::Of([0.0, -1.0])];
        let velocity = length.times(rate);
        assert_eq!(velocity.to_string(), "[1, -1]");
        assert_eq!(velocity.raised(2.0).over(length).to_string(), "[1, -2]");
        assert_eq!(velocity.plus(length), None);
        assert_eq!(velocity.raised(0.5).raised(2.0).plus(velocity), Some(velocity));
        assert!(velocity.over(velocity).is_none() && !velocity.is_none());
        // A number fits into any sum, and is nothing in a product.
        assert_eq!(Unit::Literal.plus(length), Some(length));
        assert_eq!(Unit::Literal.times(length), length);
        assert_eq!(Unit::Literal.over(length), Unit::Of([-1.0, 0.0]));
        assert_eq!(Unit::Literal.times(Unit::Literal), Unit::Literal);
        // What is not known stays so in a product, and is found in a sum.
        assert_eq!(Unit::Any.times(length), Unit::Any);
        assert_eq!(Unit::Any.plus(length), Some(length));
        assert_eq!(Unit::Any.plus(Unit::Literal), Some(Unit::Any));
        assert_eq!(Unit::Literal.plus(Unit::Any), Some(Unit::Any));
    }
}
