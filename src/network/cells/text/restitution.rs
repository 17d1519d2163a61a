//! What is left of a speed at a wall.

/// What is left of the speed towards a wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Restitution {
    All,
    Number(f64),
    Parameter(usize),
}
