//! Balls on straight lines that bounce off the walls and pass through each other; nothing is learned.
//!
//! Original: `bouncing_ode_cell`.

use super::built_in::BuiltIn;
use super::text::PlainForms;

pub const BOUNCING: BuiltIn = BuiltIn {
    name: "bouncing",
    scope: "bouncing_ode_cell",
    objects: None,
    parameters: &[],
    text: r#"
acceleration = "vec(0, 0)"
walls = true
"#,
    plain: PlainForms::NONE,
};
