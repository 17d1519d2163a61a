//! Two bodies of unit mass joined by a spring.
//!
//! With d = p0 - p1 and n = |d|, `F = k (n - 2 l) d / n`, `v0' = -F`, `v1' = F`; l is half the rest length.
//! Original: `spring_ode_cell`; paper: section 4.1.

use tch::Tensor;

use super::{Cell, PhysicalParameter, State};

pub(super) const PARAMETERS: &[PhysicalParameter] = &[
    PhysicalParameter { name: "k", variable: "log_k", length_power: 0 },
    PhysicalParameter { name: "l", variable: "log_l", length_power: 1 },
];

/// Keeps the direction finite when the bodies meet.
const SOFTENING: f64 = 1e-4;

#[derive(Debug)]
pub(super) struct Spring {
    pub log_k: Tensor,
    pub log_l: Tensor,
}

impl Cell for Spring {
    fn substep(&self, state: &State, h: f64) -> State {
        let d = state.position(0) - state.position(1);
        let n = d.square().sum_dim_intlist([1i64].as_slice(), true, None).sqrt();
        let force = self.log_k.exp() * (&n - self.log_l.exp() * 2.0) * d / (n + SOFTENING);
        let vel = &state.vel + Tensor::cat(&[-&force, force], 1) * h;
        State { pos: &state.pos + &vel * h, vel }
    }
}
