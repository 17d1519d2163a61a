//! Contacts between discs: closed forms of collisions, conservation laws, agreement of plain numbers and tensors, mistakes.

use std::sync::Arc;

use paig::network::cells::text::{Equation, EquationTable, SingleEquation};
use paig::network::cells::{Actions, CellKind, State, Walls};
use tch::{Kind, Tensor};

const WALLS: Walls = Walls { near: -1e9, far: 1e9 };

fn equation(acceleration: &str, contacts: &str, substeps: usize) -> EquationTable {
    let k = if acceleration.contains('k') { "parameters.k = { unit = [0, -2] }\n" } else { "" };
    let text = format!(
        "acceleration = \"{acceleration}\"\ncontacts = {contacts}\nintegrator = \"rk4\"\nsubsteps = {substeps}\n\
         parameters.d = {{ unit = [1, 0] }}\nparameters.e = {{ unit = [0, 0], low = 0.0, high = 1.0 }}\n\
         parameters.m = {{ unit = [0, 0] }}\n{k}"
    );
    toml::from_str(&text).unwrap()
}

/// Two discs, their contact at a distance of 4, restitution 0.8 and masses 1 and 3, `time` later; `state` are positions and then
/// velocities.
fn moved(acceleration: &str, state: &[f64], substeps: usize, time: f64) -> Vec<f64> {
    let table = equation(acceleration, "{ distance = \"d\", restitution = \"e\", masses = [1.0, \"m\"] }", substeps);
    let equation = Arc::new(Equation::read(&table, 2).unwrap());
    let mut state = state.to_vec();
    SingleEquation::new(&equation, &[4.0, 0.8, 3.0], WALLS).advance(&mut state, 0.0, time);
    state
}

/// Without forces the path is known: straight to the impact, and straight from it, whatever the number of substeps.
#[test]
fn free_discs_recoil_at_the_time_of_impact() {
    // The second rests at the origin; the first comes along x, 2 beside the middle: they touch where it is at x = -sqrt(12).
    let touch = -12.0_f64.sqrt();
    let begin = [-10.0, 2.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0];
    let normal = [-touch / 4.0, -0.5];
    // The closing speed along the normal, (1 + e) of it shared by the reduced mass.
    let impulse = 1.8 * 5.0 * normal[0] * (3.0 / 4.0);
    let (first, second) = ([5.0 - impulse * normal[0], -impulse * normal[1]], normal.map(|n| impulse * n / 3.0));
    let (impact, time) = ((touch + 10.0) / 5.0, 4.0);
    for substeps in [1, 7, 40] {
        let end = moved("vec(0, 0)", &begin, substeps, time);
        let rest = time - impact;
        let expected = [
            touch + rest * first[0],
            2.0 + rest * first[1],
            rest * second[0],
            rest * second[1],
            first[0],
            first[1],
            second[0],
            second[1],
        ];
        for (found, expected) in end.iter().zip(expected) {
            // Rounding of float64.
            assert!((found - expected).abs() < 1e-9, "{substeps} substeps: {end:?}, expected {expected:?}");
        }
    }
}

/// Under a common force momentum grows by the force alone, and a collision keeps the share e^2 of the energy of the relative motion
/// along the normal.
#[test]
fn collisions_keep_momentum_and_lose_energy() {
    let begin = [10.0, 10.0, 20.0, 11.0, 3.0, 0.5, -2.0, 0.0];
    let end = moved("vec(0, 2)", &begin, 50, 3.0);
    let momentum = |state: &[f64], axis: usize| state[4 + axis] + 3.0 * state[6 + axis];
    // Rounding of float64 over 50 substeps.
    assert!((momentum(&end, 0) - momentum(&begin, 0)).abs() < 1e-9, "{end:?}");
    assert!((momentum(&end, 1) - momentum(&begin, 1) - 4.0 * 2.0 * 3.0).abs() < 1e-9, "{end:?}");
    let relative = |state: &[f64]| (state[6] - state[4]).hypot(state[7] - state[5]);
    assert!(relative(&end) < relative(&begin) && relative(&end) > 0.8 * relative(&begin), "{end:?}");
    // They are apart: no disc passes through the other.
    assert!((end[2] - end[0]).hypot(end[3] - end[1]) > 4.0 && end[2] > end[0], "{end:?}");
}

#[test]
fn tensors_give_the_same_path_with_gradients() {
    let contacts = "{ distance = \"d\", restitution = \"e\", masses = [1.0, \"m\"] }";
    let kind = CellKind::of_text(&equation("-k * (p - vec(16, 16))", contacts, 10), 2).unwrap();
    let (pos, vel) = ([9.0, 15.0, 23.0, 17.0], [1.0, 0.0, 0.0, -1.0]);
    let values = [6.0, 0.8, 0.5, 2.0];
    let unconstrained: Vec<f64> =
        kind.parameters.iter().zip(values).map(|(it, value)| it.bounds.unconstrained(value)).collect();
    let end = |unconstrained: &[Tensor]| {
        let initial = State { pos: Tensor::from_slice(&pos).unsqueeze(0), vel: Tensor::from_slice(&vel).unsqueeze(0) };
        kind.cell(unconstrained, WALLS).roll_out(&initial, &Actions::none(), 0.4, 12).pop().unwrap()
    };
    let tensors: Vec<Tensor> =
        unconstrained.iter().map(|unconstrained| Tensor::from(*unconstrained).set_requires_grad(true)).collect();
    let found = end(&tensors);
    let table = kind.table().unwrap();
    let equation = Arc::new(Equation::read(&table, 2).unwrap());
    let mut state = [pos, vel].concat();
    let mut single = SingleEquation::new(&equation, &values, WALLS);
    (0..12).for_each(|_| single.advance(&mut state, 0.0, 0.4));
    let found_state = Vec::<f64>::try_from(Tensor::cat(&[&found.pos, &found.vel], 1).detach().view(-1)).unwrap();
    for (tensor, plain) in found_state.iter().zip(&state) {
        // Sums of another order over 120 substeps.
        assert!((tensor - plain).abs() < 1e-9, "{found_state:?} {state:?}");
    }
    let sum = |state: &State| (&state.pos * Tensor::from_slice(&[1.0, 2.0, -1.0, 0.5])).sum(Kind::Double);
    sum(&found).backward();
    for (place, tensor) in tensors.iter().enumerate() {
        let probed = |by: f64| {
            let unconstrained = unconstrained
                .iter()
                .enumerate()
                .map(|(i, unconstrained)| Tensor::from(unconstrained + if i == place { by } else { 0.0 }));
            sum(&end(&unconstrained.collect::<Vec<_>>())).double_value(&[])
        };
        let difference = (probed(1e-6) - probed(-1e-6)) / 2e-6;
        let gradient = tensor.grad().double_value(&[]);
        // Central differences: rounding over the probe, and the third derivative.
        assert!((gradient - difference).abs() < 1e-4 * (1.0 + difference.abs()), "{place}: {gradient} {difference}");
        assert!(gradient != 0.0, "parameter {place} shows in the path");
    }
}

#[test]
fn mistakes_are_named() {
    for (contacts, objects, expected) in [
        ("{ distance = \"d\" }", 1, "a single object"),
        ("{ distance = -1.0 }", 2, "must be more than 0"),
        ("{ distance = \"q\" }", 2, "there is no such parameter"),
        ("{ distance = \"e\" }", 2, "but is a length"),
        ("{ distance = \"d\", restitution = 1.5 }", 2, "contacts.restitution = 1.5: must be 0 to 1"),
        ("{ distance = \"d\", restitution = \"m\" }", 2, "low = 0 and high = 1 of m"),
        ("{ distance = \"d\", masses = [1.0] }", 2, "one for each of 2 objects, found 1"),
        ("{ distance = \"d\", masses = [1.0, 0.0] }", 2, "each must be more than 0"),
    ] {
        let error = CellKind::of_text(&equation("vec(0, 0)", contacts, 1), objects).err().map(|it| format!("{it:#}"));
        assert!(error.as_ref().is_some_and(|error| error.contains(expected)), "{contacts}: {error:?}");
    }
}
