//! The built-in equations as text.
//!
//! Plain numbers compute a text a hundred times as fast as tensors of one state do, and by any method; so what looks at one
//! long motion, such as a measurement, reads them here.

use super::EquationTable;
use crate::network::cells::{BOUNCING, CellKind, DAMPED_SPRING, FALLING, FALLING_BOUNCING, GRAVITY, PENDULUM, SPRING};

const TEXTS: [(&CellKind, &str); 7] = [
    (
        &BOUNCING,
        r#"
acceleration = "vec(0, 0)"
walls = true
"#,
    ),
    (
        &SPRING,
        r#"
acceleration = "others(-k * (norm(p - q) - 2*l) * (p - q) / (norm(p - q) + 1e-4))"
parameters.k.unit = [0, -2]
parameters.l.unit = [1, 0]
"#,
    ),
    (
        &DAMPED_SPRING,
        r#"
acceleration = "others(-k * (norm(p - q) - 2*l) * (p - q) / (norm(p - q) + 1e-4)) - c * v"
parameters.c.unit = [0, -1]
parameters.k.unit = [0, -2]
parameters.l.unit = [1, 0]
"#,
    ),
    (
        &GRAVITY,
        r#"
acceleration = "others(-g * m^2 * (p - q) / min(max(norm(p - q), 1), 170)^3)"
parameters.g.unit = [3, -2]
parameters.m = { unit = [0, 0], fixed = 1.0 }
"#,
    ),
    (
        &PENDULUM,
        r#"
state = "angle"
acceleration = "1.5 * g * sin(p) + 3 * a * u"
parameters.a = {}
parameters.g.unit = [0, -2]
"#,
    ),
    (
        &FALLING,
        r#"
acceleration = "vec(0, g)"
parameters.g.unit = [1, -2]
"#,
    ),
    (
        &FALLING_BOUNCING,
        r#"
acceleration = "vec(0, g)"
walls = true
parameters.g.unit = [1, -2]
"#,
    ),
];

/// A built-in equation as text; none of other ones.
pub fn written(kind: &CellKind) -> Option<EquationTable> {
    let text = TEXTS.iter().find(|(built_in, _)| *built_in == kind).map(|(_, text)| *text)?;
    Some(toml::from_str(text).expect("the texts of built-in equations are tables"))
}
