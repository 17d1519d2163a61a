//! Three bodies of equal mass that attract each other.
//!
//! For each pair `F = g m^2 / n^2` along d, n = |d|; only g m^2 enters, so m is held at 1 and g is learned.
//! Original: `gravity_ode_cell`; paper: section 4.1.

use tch::Tensor;

use super::{Cell, PhysicalParameter, State};

pub(super) const PARAMETERS: &[PhysicalParameter] =
    &[PhysicalParameter { name: "g", variable: "log_g", length_power: 3 }];

/// Bounds of the squared distance under the root, and of the distance in the force, pixels.
const SQUARED_DISTANCE: (f64, f64) = (0.1, 1e5);
const DISTANCE: (f64, f64) = (1.0, 170.0);

#[derive(Debug)]
pub(super) struct Gravity {
    pub log_g: Tensor,
}

/// `d / |d|^3`, bounded, for d = a - b.
fn attraction(a: Tensor, b: Tensor) -> Tensor {
    let d = a - b;
    let squared = d.square().sum_dim_intlist([1i64].as_slice(), true, None);
    let n = squared.clamp(SQUARED_DISTANCE.0, SQUARED_DISTANCE.1).sqrt().clamp(DISTANCE.0, DISTANCE.1);
    d / n.pow_tensor_scalar(3)
}

impl Cell for Gravity {
    fn substep(&self, state: &State, h: f64) -> State {
        let [p0, p1, p2] = [0, 1, 2].map(|object| state.position(object));
        let f01 = attraction(p0.shallow_clone(), p1.shallow_clone());
        let f12 = attraction(p1, p2.shallow_clone());
        let f20 = attraction(p2, p0);
        let pull = Tensor::cat(&[&f01 - &f20, &f12 - &f01, f20 - f12], 1);
        let vel = &state.vel - self.log_g.exp() * pull * h;
        State { pos: &state.pos + &vel * h, vel }
    }
}
