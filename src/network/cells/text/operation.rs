//! What can be computed in an acceleration, and on which operands.

use super::units::Unit;

/// On one operand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Unary {
    Negative,
    /// Of a vector its coordinate 0 or 1.
    Part(u8),
    Norm,
    /// A quarter turn from x to y.
    Perp,
    Sqrt,
    Exp,
    Ln,
    Sin,
    Cos,
    Tan,
    Tanh,
    Abs,
    Sign,
    Square,
    /// What each object has, once for each of its others.
    ForOthers,
    /// The sum over each object's others.
    OverOthers,
}

/// On two operands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Binary {
    Plus,
    Minus,
    Times,
    Over,
    Power,
    Dot,
    Cross,
    Vec,
    Atan2,
    Min,
    Max,
}

/// What a name before a parenthesis stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Function {
    Unary(Unary),
    Binary(Binary),
    /// A vector over its norm.
    Direction,
    Others,
}

/// All functions by name.
pub(super) const FUNCTIONS: [(&str, Function); 20] = [
    ("abs", Function::Unary(Unary::Abs)),
    ("atan2", Function::Binary(Binary::Atan2)),
    ("cos", Function::Unary(Unary::Cos)),
    ("cross", Function::Binary(Binary::Cross)),
    ("dot", Function::Binary(Binary::Dot)),
    ("exp", Function::Unary(Unary::Exp)),
    ("ln", Function::Unary(Unary::Ln)),
    ("max", Function::Binary(Binary::Max)),
    ("min", Function::Binary(Binary::Min)),
    ("norm", Function::Unary(Unary::Norm)),
    ("others", Function::Others),
    ("perp", Function::Unary(Unary::Perp)),
    ("sign", Function::Unary(Unary::Sign)),
    ("sin", Function::Unary(Unary::Sin)),
    ("sqrt", Function::Unary(Unary::Sqrt)),
    ("square", Function::Unary(Unary::Square)),
    ("tan", Function::Unary(Unary::Tan)),
    ("tanh", Function::Unary(Unary::Tanh)),
    ("unit", Function::Direction),
    ("vec", Function::Binary(Binary::Vec)),
];

impl Function {
    pub(super) fn named(name: &str) -> Option<Function> {
        FUNCTIONS.iter().find(|(known, _)| *known == name).map(|(_, function)| *function)
    }

    /// How many arguments it takes.
    pub(super) fn arguments(self) -> usize {
        if matches!(self, Function::Binary(_)) { 2 } else { 1 }
    }
}

/// What the checks know of an expression.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ExpressionFacts {
    /// Otherwise it is a scalar.
    pub vector: bool,
    pub unit: Unit,
    /// The value of a plain number.
    pub number: Option<f64>,
}

impl ExpressionFacts {
    fn rank(self) -> &'static str {
        if self.vector { "a vector" } else { "a scalar" }
    }

    fn scalar(unit: Unit) -> (bool, Unit) {
        (false, unit)
    }
}

impl Unary {
    /// Whether the result is a vector, and its unit.
    ///
    /// # Errors
    /// An operand of another rank or unit.
    pub(super) fn check(self, of: ExpressionFacts) -> Result<(bool, Unit), String> {
        let unit = of.unit;
        match self {
            Unary::Part(_) | Unary::Norm | Unary::Perp if !of.vector => {
                let hint = if self == Unary::Norm { "; the size of a scalar is abs" } else { "" };
                return Err(format!("this is a scalar, a vector is needed{hint}"));
            }
            Unary::Sqrt
            | Unary::Exp
            | Unary::Ln
            | Unary::Sin
            | Unary::Cos
            | Unary::Tan
            | Unary::Tanh
            | Unary::Abs
            | Unary::Sign
            | Unary::Square
                if of.vector =>
            {
                let hint = match self {
                    Unary::Abs => "; the size of a vector is norm",
                    Unary::Sign => "; the direction of a vector is unit",
                    Unary::Square => "; the square of a vector is dot(a, a)",
                    _ => "",
                };
                return Err(format!("this is a vector, a scalar is needed{hint}"));
            }
            _ => {}
        }
        match self {
            Unary::Exp | Unary::Ln | Unary::Sin | Unary::Cos | Unary::Tan | Unary::Tanh => {
                if !unit.is_none() {
                    return Err(format!(
                        "this has the unit {unit} (powers of length and time); a plain number is needed"
                    ));
                }
                Ok(ExpressionFacts::scalar(Unit::NONE))
            }
            Unary::Negative | Unary::Perp | Unary::ForOthers | Unary::OverOthers => Ok((of.vector, unit)),
            Unary::Part(_) | Unary::Norm | Unary::Abs => Ok(ExpressionFacts::scalar(unit)),
            Unary::Sqrt => Ok(ExpressionFacts::scalar(unit.raised(0.5))),
            Unary::Square => Ok(ExpressionFacts::scalar(unit.raised(2.0))),
            Unary::Sign => Ok(ExpressionFacts::scalar(Unit::NONE)),
        }
    }
}

impl Binary {
    /// Whether the result is a vector, and its unit.
    ///
    /// # Errors
    /// Operands that do not go together.
    pub(super) fn check(self, a: ExpressionFacts, b: ExpressionFacts) -> Result<(bool, Unit), String> {
        match self {
            Binary::Plus | Binary::Minus => {
                if a.vector != b.vector {
                    return Err(format!("{} and {} cannot be added or subtracted", a.rank(), b.rank()));
                }
                Ok((a.vector, same_unit(a, b)?))
            }
            Binary::Times => {
                if a.vector && b.vector {
                    return Err("two vectors are multiplied by dot(a, b) or cross(a, b)".into());
                }
                Ok((a.vector || b.vector, a.unit.times(b.unit)))
            }
            Binary::Over => {
                if b.vector {
                    return Err("this is a vector; nothing can be divided by one".into());
                }
                if b.number == Some(0.0) {
                    return Err("this is 0; nothing can be divided by it".into());
                }
                Ok((a.vector, a.unit.over(b.unit)))
            }
            Binary::Power => power(a, b),
            Binary::Dot | Binary::Cross => {
                if !(a.vector && b.vector) {
                    return Err(format!("two vectors are needed, not {} and {}", a.rank(), b.rank()));
                }
                Ok(ExpressionFacts::scalar(a.unit.times(b.unit)))
            }
            Binary::Vec | Binary::Atan2 | Binary::Min | Binary::Max => {
                if a.vector || b.vector {
                    return Err(format!("two scalars are needed, not {} and {}", a.rank(), b.rank()));
                }
                let unit = same_unit(a, b)?;
                Ok((self == Binary::Vec, if self == Binary::Atan2 { Unit::NONE } else { unit }))
            }
        }
    }
}

fn same_unit(a: ExpressionFacts, b: ExpressionFacts) -> Result<Unit, String> {
    a.unit
        .plus(b.unit)
        .ok_or_else(|| format!("units {} and {} (powers of length and time) cannot be put together", a.unit, b.unit))
}

fn power(base: ExpressionFacts, exponent: ExpressionFacts) -> Result<(bool, Unit), String> {
    if base.vector || exponent.vector {
        return Err("a power is of scalars; the square of a vector is dot(a, a)".into());
    }
    if !exponent.unit.is_none() {
        return Err(format!("the exponent has the unit {} (powers of length and time)", exponent.unit));
    }
    match exponent.number {
        Some(number) => Ok(ExpressionFacts::scalar(base.unit.raised(number))),
        None if base.unit.is_none() => Ok(ExpressionFacts::scalar(base.unit)),
        None => Err(format!(
            "what has a unit, here {} (powers of length and time), needs a number as its exponent; divide it by a \
             quantity of its unit first",
            base.unit
        )),
    }
}
