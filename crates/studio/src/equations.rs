//! Words for the equations that come with the program: the page offers them under their names in the gallery.

use anyhow::{Context, Result, ensure};
use serde::Serialize;

/// In place of a name: the program chooses.
pub const AUTO: &str = "auto";

/// An equation by its words.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct EquationInfo {
    /// What `--equation` takes.
    pub key: &'static str,
    pub title: &'static str,
    /// The formula, for people.
    pub formula: &'static str,
    pub summary: &'static str,
    /// Objects that it is about; any number if 0.
    pub objects: usize,
}

macro_rules! equations {
    ($($key:literal, $objects:literal, $title:literal, $formula:literal, $summary:literal;)+) => {
        &[$(EquationInfo { key: $key, objects: $objects, title: $title, formula: $formula, summary: $summary }),+]
    };
}

/// The choice by the program first, then the equations, the common ones first.
pub const EQUATIONS: &[EquationInfo] = equations![
    "auto", 0, "Choose for me", "the best of all below",
        "Fits every equation to the same positions, takes the one that predicts best, and names a missing term.";
    "falling", 0, "Fall or throw", "a = g", "Gravity alone: a ball that drops or is thrown. Finds g.";
    "fall_quadratic_drag", 1, "Fall with air drag", "a = g − c |v| v",
        "Gravity and drag that grows with the square of the speed: light or fast things in air.";
    "fall_linear_drag", 1, "Fall in a thick liquid", "a = g − c v",
        "Gravity and drag that grows with the speed: slow things in oil or honey.";
    "bounce_on_a_floor", 1, "Bouncing ball", "a = g, v → −e v at the floor",
        "A ball that falls on a floor. Finds g, the floor and the coefficient of restitution e.";
    "bounce_on_an_incline", 1, "Ball bouncing on an incline", "a = g, vₙ → −e vₙ at the slope",
        "A ball that bounces on an incline. Finds g, the slope and the coefficient of restitution e.";
    "damped_pendulum", 1, "Pendulum with friction", "θ″ = −(g/l) sin θ − c θ′",
        "A weight on a string or rod. Finds g, the pivot and the damping; any amplitude.";
    "free_pendulum", 1, "Pendulum", "θ″ = −(g/l) sin θ", "The same without friction.";
    "swing", 1, "Pendulum, its length", "θ″ = −(g/l) sin θ − c θ′ with g = 9.81 m/s²",
        "Gravity is taken as known, so the length in metres needs no scale. Finds the length, the damping and the camera's tilt.";
    "slack_pendulum", 1, "Ball on a slack string", "a = g, |p − p₀| ≤ l",
        "A ball on a string that goes slack: free flight inside, a swing where it is taut. Finds g, the pivot and the length.";
    "driven_pendulum", 1, "Driven pendulum", "θ″ = −(g/l) sin θ − c θ′ + A cos ωt",
        "A pendulum that is pushed in a fixed rhythm. Finds the push and its rhythm, too.";
    "mass_on_a_spring", 1, "Weight on a spring", "a = −k (p − p₀) − c v",
        "A weight that swings about a rest position. Finds k over the mass, the rest position and the damping.";
    "sliding_block", 1, "Sliding with dry friction", "a = −f v / |v|",
        "A block that slides on a table and is slowed by a constant force. Finds f.";
    "constant_acceleration", 1, "Constant acceleration", "a = (aₓ, a_y)",
        "A constant force in any direction: a cart on a slope.";
    "cart_on_a_spring", 1, "Cart thrown back by a spring", "a = a₀ − k max(x − x₀, 0)",
        "A cart on a slope along x that a spring at its end throws back. Finds the acceleration and the spring's k over the mass.";
    "lossy_bounce", 1, "Bounce between walls", "a = g, v → −e v at each wall",
        "A ball that loses speed at every edge of the crop. Finds g and e.";
    "charge_in_a_field", 1, "Charge in two fields", "a = E + B v⊥",
        "A charge in an electric field and in a magnetic one across the picture.";
    "torricelli", 1, "Draining vessel", "h′ = −√(s h)", "A float on water that runs out through a hole.";
    "spring", 2, "Two balls on a spring", "a = ∓k (|r| − l) r/|r|",
        "Two balls joined by a spring. Finds the spring's constant and rest length.";
    "damped_spring", 2, "Two balls on a spring, friction", "a = ∓k (|r| − l) r/|r| − c v", "The same with friction.";
    "double_pendulum", 2, "Double pendulum", "two coupled pendulums",
        "Two weights, one hanging from the other. Finds g and the pivot.";
    "unequal_masses", 2, "Two unequal masses on a spring", "a₁ = −F, a₂ = F/m", "Finds the ratio of the masses, too.";
    "balls_in_a_bowl", 2, "Balls that collide", "a = −k (p − p₀), collisions with restitution e",
        "Two balls in a flat bowl that collide. Finds e and the ratio of the masses.";
    "colliding_pendulums", 2, "Pendulums that collide", "θ″ = −(g/l) sin θ − c θ′, collisions with restitution e",
        "Two balls on strings of one length that strike each other. Finds the length, the pivots and e.";
    "spring_chain", 3, "Chain of springs", "a₁ = −F₁, a₂ = F₁ − F₂, a₃ = F₂", "Three balls in a row, joined by two springs.";
    "gravity", 3, "Bodies that attract each other", "aᵢ = Σ m rᵢⱼ / |rᵢⱼ|³", "Three equal bodies under their own gravity.";
    "gravity_masses", 3, "Bodies of unequal mass", "aᵢ = Σ mⱼ rᵢⱼ / |rᵢⱼ|³", "The same, and finds the masses.";
    "charges", 3, "Charges", "aᵢ = Σ qᵢqⱼ rᵢⱼ / |rᵢⱼ|³", "Three charges of either sign, of equal mass.";
];

/// The equation of this key.
///
/// # Errors
/// There is none.
pub fn equation(key: &str) -> Result<&'static EquationInfo> {
    EQUATIONS.iter().find(|it| it.key == key).with_context(|| format!("equation {key:?} is not among those offered"))
}

/// The same, where it is one to be trained with.
///
/// # Errors
/// There is none, or none is chosen yet.
pub fn definite(key: &str) -> Result<&'static EquationInfo> {
    ensure!(key != AUTO, "training needs an equation: choose one, or press Find it first");
    equation(key)
}

#[cfg(test)]
mod tests {
    use paig::network::cells::Equations;
    use paig::tasks::equation_file::EquationFile;
    use paig::tasks::gallery::GALLERY;

    use super::*;

    #[test]
    fn offered_equations_are_named_and_take_so_many_objects() {
        for equation in EQUATIONS.iter().filter(|it| it.key != AUTO) {
            let file = EquationFile::named(equation.key).unwrap();
            let objects = equation.objects.max(1);
            assert_eq!(file.objects.unwrap_or(objects), objects, "{}", equation.key);
            file.equation.kind(objects, &Equations::default()).unwrap();
        }
    }

    /// Those that repeat another one begin with `text_`.
    #[test]
    fn all_of_the_gallery_are_offered() {
        for entry in GALLERY.iter().filter(|entry| !entry.name.starts_with("text_")) {
            equation(entry.name).unwrap();
        }
        assert!(definite(AUTO).is_err() && definite("falling").is_ok());
    }
}
