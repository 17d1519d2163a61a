//! Three bodies of equal mass that attract each other.
//!
//! For each pair `F = g m^2 / n^2` along d, n = |d|. Only g m^2 enters, so one of the two must be fixed: m at 1 as in the
//! original, or g, for the second column of the paper's table 1. Original: `gravity_ode_cell`; paper: section 4.1.

use std::borrow::Cow;

use tch::Tensor;

use super::cell::{Cell, scalars};
use super::integrands::euler;
use super::kind::{Build, CellKind};
use super::parameter::PhysicalParameter;
use super::plain::{AccelerationLaw, Euler, PlainCell, columns, columns_mut};
use super::state::{Coordinates, State};

const PARAMETERS: &[PhysicalParameter] = &[
    PhysicalParameter::learned("g", "log_g", 3).with_time(-2),
    // A rescaling of the coordinates is all g's.
    PhysicalParameter::learned("m", "log_m", 0).with_time(0).fixed_at(1.0),
];

pub static GRAVITY: CellKind = CellKind {
    name: Cow::Borrowed("gravity"),
    scope: "gravity_ode_cell",
    objects: Some(3),
    coordinates: Coordinates::Position,
    walls: false,
    actions: false,
    parameters: Cow::Borrowed(PARAMETERS),
    build: Build::Rust(|logs, _walls| {
        let [log_g, log_m] = scalars(logs);
        Box::new(Gravity { log_g, log_m })
    }),
    text: Some(
        r#"
acceleration = "others(-g * m^2 * (p - q) / min(max(norm(p - q), 1), 170)^3)"
parameters.g.unit = [3, -2]
parameters.m = { unit = [0, 0], fixed = 1.0 }
"#,
    ),
};

/// Bounds of the squared distance under the root, and of the distance in the force, pixels.
const SQUARED_DISTANCE: (f64, f64) = (0.1, 1e5);
const DISTANCE: (f64, f64) = (1.0, 170.0);

#[derive(Debug)]
struct Gravity {
    log_g: Tensor,
    log_m: Tensor,
}

/// `d / |d|^3`, bounded, for d = a - b.
fn attraction(a: Tensor, b: Tensor) -> Tensor {
    let d = a - b;
    let squared = d.square().sum_dim_intlist([1i64].as_slice(), true, None);
    let n = squared.clamp(SQUARED_DISTANCE.0, SQUARED_DISTANCE.1).sqrt().clamp(DISTANCE.0, DISTANCE.1);
    d / n.pow_tensor_scalar(3)
}

impl Cell for Gravity {
    fn substep(&self, state: &State, _action: Option<&Tensor>, h: f64) -> State {
        let [p0, p1, p2] = [0, 1, 2].map(|object| state.position(object));
        let f01 = attraction(p0.shallow_clone(), p1.shallow_clone());
        let f12 = attraction(p1, p2.shallow_clone());
        let f20 = attraction(p2, p0);
        let pull = Tensor::cat(&[&f20 - &f01, &f01 - &f12, f12 - f20], 1);
        let strength = self.log_g.exp() * (&self.log_m * 2.0).exp();
        euler(state, &(strength * pull), h)
    }

    fn plain_double(&self) -> Option<Box<dyn PlainCell<f64>>> {
        let [g, m] = [&self.log_g, &self.log_m].map(|log| log.double_value(&[]).exp());
        Some(Box::new(Euler::new(GravityLaw { strength: g * m * m })))
    }
}

/// The same in plain numbers.
#[derive(Debug)]
struct GravityLaw {
    /// g m^2.
    strength: f64,
}

impl AccelerationLaw for GravityLaw {
    fn accelerate(&self, positions: &[f64], _velocities: &[f64], _action: &[f64], into: &mut [f64]) {
        let at: [&[f64]; 6] = columns(positions);
        let into: [&mut [f64]; 6] = columns_mut(into);
        for i in 0..at[0].len() {
            let pull = |a: usize, b: usize| {
                let d = [0, 1].map(|axis| at[2 * a + axis][i] - at[2 * b + axis][i]);
                let squared = d[0] * d[0] + d[1] * d[1];
                let n = squared.clamp(SQUARED_DISTANCE.0, SQUARED_DISTANCE.1).sqrt().clamp(DISTANCE.0, DISTANCE.1);
                d.map(|d| self.strength * d / (n * n * n))
            };
            let (f01, f12, f20) = (pull(0, 1), pull(1, 2), pull(2, 0));
            for axis in [0, 1] {
                into[axis][i] = f20[axis] - f01[axis];
                into[2 + axis][i] = f01[axis] - f12[axis];
                into[4 + axis][i] = f12[axis] - f20[axis];
            }
        }
    }
}
