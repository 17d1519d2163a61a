//! Two bodies of unit mass joined by a spring.
//!
//! With d = p1 - p2 and n = |d|, `F = k (n - 2 l) d / n`, `v1' = -F`, `v2' = F`; l is half the rest length. The 1e-4 keeps
//! the direction finite where the bodies meet, the 1e-36 the gradient of the root. Original: `spring_ode_cell`; paper:
//! section 4.1.

use super::built_in::BuiltIn;
use super::plain::{AccelerationLaw, Euler, PlainCell, columns, columns_mut};
use super::text::PlainForms;

pub const SPRING: BuiltIn = BuiltIn {
    name: "spring",
    scope: "spring_ode_cell",
    objects: Some(2),
    parameters: &["k", "l"],
    text: r#"
acceleration = ["-pull", "pull"]
where.d = "p1 - p2"
where.n = "sqrt(max(dot(d, d), 1e-36))"
where.pull = "k * (n - 2*l) * d / (n + 1e-4)"
parameters.k.unit = [0, -2]
parameters.l.unit = [1, 0]
"#,
    plain: PlainForms { fit: Some(fit), plan: None },
};

fn fit(values: &[f64]) -> Box<dyn PlainCell<f64>> {
    Box::new(Euler::new(SpringLaw { k: values[0], l: values[1], resistance: 0.0 }))
}

/// The spring, and a medium that resists, in plain numbers.
#[derive(Debug)]
pub(super) struct SpringLaw {
    pub k: f64,
    pub l: f64,
    /// Deceleration for a velocity of 1.
    pub resistance: f64,
}

impl AccelerationLaw for SpringLaw {
    fn accelerate(&self, positions: &[f64], velocities: &[f64], _action: &[f64], into: &mut [f64]) {
        let [x0, y0, x1, y1] = columns(positions);
        let [a0, b0, a1, b1] = columns_mut(into);
        for i in 0..x0.len() {
            let (x, y) = (x0[i] - x1[i], y0[i] - y1[i]);
            let n = (x * x + y * y).sqrt();
            let force = self.k * (n - 2.0 * self.l) / (n + 1e-4);
            (a0[i], b0[i], a1[i], b1[i]) = (-force * x, -force * y, force * x, force * y);
        }
        if self.resistance != 0.0 {
            into.iter_mut().zip(velocities).for_each(|(faster, velocity)| *faster -= self.resistance * velocity);
        }
    }
}
