//! Balls in a uniform field of gravity g, pixels per squared time unit, downwards; with or without walls.
//!
//! The systems of the original's grayscale datasets; its release has no cell for them.

use super::built_in::BuiltIn;
use super::text::PlainForms;

/// Free fall.
pub const FALLING: BuiltIn = BuiltIn {
    name: "falling",
    scope: "falling_ode_cell",
    objects: None,
    parameters: &["g"],
    text: r#"
acceleration = "vec(0, g)"
parameters.g.unit = [1, -2]
"#,
    plain: PlainForms::NONE,
};

/// The same, bouncing off all four walls without loss.
pub const FALLING_BOUNCING: BuiltIn = BuiltIn {
    name: "falling_bouncing",
    scope: "falling_bouncing_ode_cell",
    objects: None,
    parameters: &["g"],
    text: r#"
acceleration = "vec(0, g)"
walls = true
parameters.g.unit = [1, -2]
"#,
    plain: PlainForms::NONE,
};
