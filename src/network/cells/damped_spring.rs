//! The spring in a medium that resists: `v1' = -F - c v1`, `v2' = F - c v2`, with the spring's F.
//!
//! Not in the original.

use super::built_in::BuiltIn;
use super::plain::{Euler, PlainCell};
use super::spring::SpringLaw;
use super::text::PlainForms;

pub const DAMPED_SPRING: BuiltIn = BuiltIn {
    name: "damped_spring",
    scope: "damped_spring_ode_cell",
    objects: Some(2),
    parameters: &["k", "l", "c"],
    text: r#"
acceleration = ["-pull - c * v1", "pull - c * v2"]
where.d = "p1 - p2"
where.n = "sqrt(max(dot(d, d), 1e-36))"
where.pull = "k * (n - 2*l) * d / (n + 1e-4)"
parameters.k.unit = [0, -2]
parameters.l.unit = [1, 0]
parameters.c.unit = [0, -1]
"#,
    plain: PlainForms { fit: Some(fit), plan: None },
};

fn fit(values: &[f64]) -> Box<dyn PlainCell<f64>> {
    Box::new(Euler::new(SpringLaw { k: values[0], l: values[1], resistance: values[2] }))
}
