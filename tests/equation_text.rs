//! Equations of text: the built-in cells written so give the same numbers and gradients, and mistakes are told with their
//! place.

use std::time::Instant;

use paig::network::System;
use paig::network::cells::text::{self, EquationTable};
use paig::network::cells::{
    Actions, BOUNCING, CellKind, DAMPED_SPRING, FALLING, FALLING_BOUNCING, GRAVITY, PENDULUM, SPRING, State, Walls,
};
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::support::random::named_generator;
use paig::tasks::Task;
use rand::Rng;
use tch::{Device, Kind, Tensor};

const SPRING_TEXT: &str = r#"
acceleration = "others(-k * (norm(p - q) - 2*l) * (p - q) / (norm(p - q) + 1e-4))"
parameters.k.unit = [0, -2]
parameters.l.unit = [1, 0]
"#;

const DAMPED_SPRING_TEXT: &str = r#"
acceleration = "others(-k * (norm(p - q) - 2*l) * (p - q) / (norm(p - q) + 1e-4)) - c * v"
parameters.c.unit = [0, -1]
parameters.k.unit = [0, -2]
parameters.l.unit = [1, 0]
"#;

/// The same for each ball by itself.
const SPRINGS_ONE_BY_ONE: &str = r#"
acceleration = [
    "-k * (norm(p1 - p2) - 2*l) * (p1 - p2) / (norm(p1 - p2) + 1e-4)",
    "others(-k * (norm(p - q) - 2*l) * (p - q) / (norm(p - q) + 1e-4))",
]
parameters.k.unit = [0, -2]
parameters.l.unit = [1, 0]
"#;

const GRAVITY_TEXT: &str = r#"
acceleration = "others(-g * m^2 * (p - q) / min(max(norm(p - q), 1), 170)^3)"
parameters.g.unit = [3, -2]
parameters.m = { unit = [0, 0], fixed = 1.0 }
"#;

const PENDULUM_TEXT: &str = r#"
state = "angle"
acceleration = "1.5 * g * sin(p) + 3 * a * u"
parameters.a = {}
parameters.g.unit = [0, -2]
"#;

const FALLING_TEXT: &str = r#"
acceleration = "vec(0, g)"
parameters.g.unit = [1, -2]
"#;

const FALLING_BOUNCING_TEXT: &str = r#"
acceleration = "vec(0, g)"
walls = true
parameters.g.unit = [1, -2]
"#;

const BOUNCING_TEXT: &str = r#"
acceleration = "vec(0, 0)"
walls = true
"#;

fn table(toml: &str) -> EquationTable {
    toml::from_str(toml).unwrap()
}

fn read(toml: &str, objects: usize) -> &'static CellKind {
    text::kind(&table(toml), objects).unwrap_or_else(|error| panic!("{error:#}"))
}

/// What is wrong with a text.
fn complaint(toml: &str, objects: usize) -> String {
    match toml::from_str::<EquationTable>(toml) {
        Ok(table) => format!("{:#}", text::kind(&table, objects).expect_err("an error")),
        Err(error) => error.to_string(),
    }
}

/// The complaint about an acceleration of two objects with parameters k, of unit [0, -2], and l, of [1, 0].
fn about(acceleration: &str) -> String {
    complaint(&format!("acceleration = {acceleration:?}\nparameters.k.unit = [0, -2]\nparameters.l.unit = [1, 0]"), 2)
}

/// Uniform between two numbers.
fn uniform(purpose: &str, shape: &[i64], low: f64, high: f64, kind: Kind) -> Tensor {
    let mut random = named_generator(3, purpose);
    let values: Vec<f64> = (0..shape.iter().product::<i64>()).map(|_| random.random_range(low..high)).collect();
    Tensor::from_slice(&values).reshape(shape).to_kind(kind)
}

/// What a built-in equation and its text are compared on.
struct Pair {
    built_in: &'static CellKind,
    text: &'static str,
    objects: usize,
    logs: &'static [f64],
    /// Lowest and highest coordinate, largest speed.
    within: (f64, f64, f64),
    /// The text's parameters are sorted by name: where each of the built-in's is among them.
    order: &'static [usize],
}

const PAIRS: [Pair; 8] = [
    Pair { built_in: &SPRING, text: SPRING_TEXT, objects: 2, logs: &[1.4, 1.8], within: (4.0, 28.0, 8.0), order: &[0, 1] },
    Pair {
        built_in: &SPRING,
        text: SPRINGS_ONE_BY_ONE,
        objects: 2,
        logs: &[1.4, 1.8],
        within: (4.0, 28.0, 8.0),
        order: &[0, 1],
    },
    Pair {
        built_in: &DAMPED_SPRING,
        text: DAMPED_SPRING_TEXT,
        objects: 2,
        logs: &[1.4, 1.8, -1.2],
        within: (4.0, 28.0, 8.0),
        order: &[1, 2, 0],
    },
    Pair { built_in: &GRAVITY, text: GRAVITY_TEXT, objects: 3, logs: &[2.0, 0.1], within: (0.0, 90.0, 2.0), order: &[0, 1] },
    Pair { built_in: &PENDULUM, text: PENDULUM_TEXT, objects: 1, logs: &[2.3, -0.1], within: (-2.0, 2.0, 2.0), order: &[1, 0] },
    Pair { built_in: &FALLING, text: FALLING_TEXT, objects: 3, logs: &[0.4], within: (4.0, 28.0, 8.0), order: &[0] },
    Pair {
        built_in: &FALLING_BOUNCING,
        text: FALLING_BOUNCING_TEXT,
        objects: 2,
        logs: &[0.4],
        within: (4.0, 28.0, 8.0),
        order: &[0],
    },
    Pair { built_in: &BOUNCING, text: BOUNCING_TEXT, objects: 2, logs: &[], within: (4.0, 28.0, 8.0), order: &[] },
];

/// A roll-out of five frames: all states, and the gradients of a loss to the first state and the log-parameters.
fn rolled_out(pair: &Pair, kind: &CellKind, order: &[usize], number: Kind) -> (Tensor, Vec<Tensor>) {
    let coordinates = (pair.objects * kind.coordinates.per_object()) as i64;
    let (low, high, speed) = pair.within;
    let pos = uniform("positions", &[64, coordinates], low, high, number).set_requires_grad(true);
    let vel = uniform("velocities", &[64, coordinates], -speed, speed, number).set_requires_grad(true);
    let logs: Vec<_> = pair.logs.iter().map(|log| Tensor::from(*log).to_kind(number).set_requires_grad(true)).collect();
    let mut ordered: Vec<_> = logs.iter().map(Tensor::shallow_clone).collect();
    for (log, place) in logs.iter().zip(order) {
        ordered[*place] = log.shallow_clone();
    }
    // The last frame has no action.
    let actions = Actions::new(kind.actions.then(|| uniform("actions", &[64, 4], -2.0, 2.0, number)));
    let first = State { pos: pos.shallow_clone(), vel: vel.shallow_clone() };
    let states = kind.cell(&ordered, Walls::new(32, 2.0)).roll_out(&first, &actions, 0.1, 5);
    let states = Tensor::stack(&states.iter().map(State::joined).collect::<Vec<_>>(), 0);
    let weights = uniform("weights", &states.size(), -1.0, 1.0, number);
    let leaves: Vec<_> = [pos, vel].into_iter().chain(logs).collect();
    let gradients = Tensor::run_backward(&[(&states * weights).sum(number)], &leaves, false, false);
    (states.detach(), gradients)
}

fn assert_close(found: &Tensor, expected: &Tensor, tolerance: f64, what: &str) {
    assert_eq!(found.size(), expected.size(), "{what}");
    let scale = expected.abs().max().double_value(&[]).max(1e-3);
    let error = (found - expected).abs().max().double_value(&[]) / scale;
    assert!(error <= tolerance, "{what}: off by {error} of the largest");
}

#[test]
fn built_in_equations_as_text_give_the_same_numbers_and_gradients() {
    for pair in &PAIRS {
        let kind = read(pair.text, pair.objects);
        assert_eq!(kind.coordinates, pair.built_in.coordinates);
        assert_eq!((kind.walls, kind.actions), (pair.built_in.walls, pair.built_in.actions), "{}", pair.built_in.name);
        for (place, parameter) in pair.order.iter().zip(pair.built_in.parameters) {
            let own = &kind.parameters[*place];
            assert_eq!((own.name, own.variable, own.fixed), (parameter.name, parameter.variable, parameter.fixed));
            // The built-in pendulum counts lengths in rods.
            assert_eq!(own.length_power, parameter.length_power, "{} of {}", own.name, pair.built_in.name);
        }
        // Rounding is 6e-8 in float32 and 1e-16 in float64; five frames of substeps and their derivatives gather some
        // tens of them.
        for (number, tolerance) in [(Kind::Float, 1e-5), (Kind::Double, 1e-12)] {
            let same_order: Vec<usize> = (0..pair.logs.len()).collect();
            let (expected, expected_gradients) = rolled_out(pair, pair.built_in, &same_order, number);
            let (found, gradients) = rolled_out(pair, kind, pair.order, number);
            let name = pair.built_in.name;
            let forward = if number == Kind::Float { 1e-6 } else { 1e-14 };
            assert_close(&found, &expected, forward, &format!("{name}, states"));
            for (place, (found, expected)) in gradients.iter().zip(&expected_gradients).enumerate() {
                assert_close(found, expected, tolerance, &format!("{name}, gradient {place}"));
            }
        }
    }
}
