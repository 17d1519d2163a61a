//! Equations of text: the built-in cells written so give the same numbers and gradients, and mistakes are told with their
//! place.

use paig::network::cells::text::{EquationTable, SingleEquation};
use paig::network::cells::{Actions, Build, CellKind, DAMPED_SPRING, GRAVITY, PENDULUM, SPRING, State, Walls};
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::support::random::named_generator;
use paig::tasks::Task;
use paig::training::config::Config;
use paig::training::layers::Overrides;
use rand::Rng;
use tch::{Device, Kind, Tensor};

/// The spring as the sum over the others, and the same in a medium that resists.
const SPRING_OF_OTHERS: &str = r#"
acceleration = "others(-k * (norm(p - q) - 2*l) * (p - q) / (norm(p - q) + 1e-4))"
parameters.k.unit = [0, -2]
parameters.l.unit = [1, 0]
"#;
const DAMPED_SPRING_OF_OTHERS: &str = r#"
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

fn table(toml: &str) -> EquationTable {
    toml::from_str(toml).unwrap()
}

fn read(toml: &str, objects: usize) -> CellKind {
    CellKind::of_text(&table(toml), objects).unwrap_or_else(|error| panic!("{error:#}"))
}

/// What is wrong with a text.
fn complaint(toml: &str, objects: usize) -> String {
    match toml::from_str::<EquationTable>(toml) {
        Ok(table) => format!("{:#}", CellKind::of_text(&table, objects).expect_err("an error")),
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

/// What a built-in equation and a text of the same are compared on.
struct Pair {
    built_in: fn() -> CellKind,
    /// Where none is given, the one that comes with the equation.
    text: Option<&'static str>,
    objects: usize,
    logs: &'static [f64],
    /// Lowest and highest coordinate, largest speed.
    within: (f64, f64, f64),
    /// The text's parameters are sorted by name: where each of the built-in's is among them.
    order: &'static [usize],
}

impl Pair {
    fn as_text(&self) -> CellKind {
        let table = self.text.map(table).or_else(|| (self.built_in)().table()).unwrap();
        CellKind::of_text(&table, self.objects).unwrap()
    }
}

const PAIRS: [Pair; 5] = [
    Pair {
        built_in: || SPRING.kind(2),
        text: Some(SPRING_OF_OTHERS),
        objects: 2,
        logs: &[1.4, 1.8],
        within: (4.0, 28.0, 8.0),
        order: &[0, 1],
    },
    Pair {
        built_in: || SPRING.kind(2),
        text: Some(SPRINGS_ONE_BY_ONE),
        objects: 2,
        logs: &[1.4, 1.8],
        within: (4.0, 28.0, 8.0),
        order: &[0, 1],
    },
    Pair {
        built_in: || DAMPED_SPRING.kind(2),
        text: Some(DAMPED_SPRING_OF_OTHERS),
        objects: 2,
        logs: &[1.4, 1.8, -1.2],
        within: (4.0, 28.0, 8.0),
        order: &[1, 2, 0],
    },
    Pair {
        built_in: || GRAVITY.clone(),
        text: None,
        objects: 3,
        logs: &[2.0, 0.1],
        within: (0.0, 90.0, 2.0),
        order: &[0, 1],
    },
    // Its parameters are computed in every substep; those of a text of a file once.
    Pair {
        built_in: || PENDULUM.kind(1),
        text: None,
        objects: 1,
        logs: &[2.3, -0.1],
        within: (-2.0, 2.0, 2.0),
        order: &[1, 0],
    },
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
        let (kind, built_in) = (pair.as_text(), (pair.built_in)());
        assert_eq!(kind.coordinates, built_in.coordinates);
        assert_eq!((kind.walls, kind.actions), (built_in.walls, built_in.actions), "{}", built_in.name);
        for (place, parameter) in pair.order.iter().zip(&*built_in.parameters) {
            let own = &kind.parameters[*place];
            assert_eq!((&own.name, &own.variable), (&parameter.name, &parameter.variable));
            assert_eq!(own.fixed, parameter.fixed);
            assert_eq!(own.length_power, parameter.length_power, "{} of {}", own.name, built_in.name);
        }
        // Rounding is 6e-8 in float32 and 1e-16 in float64; five frames of substeps and their derivatives gather some
        // tens of them.
        for (number, tolerance) in [(Kind::Float, 1e-5), (Kind::Double, 1e-12)] {
            let same_order: Vec<usize> = (0..pair.logs.len()).collect();
            let (expected, expected_gradients) = rolled_out(pair, &built_in, &same_order, number);
            let (found, gradients) = rolled_out(pair, &kind, pair.order, number);
            let name = &*built_in.name;
            let forward = if number == Kind::Float { 1e-6 } else { 1e-14 };
            assert_close(&found, &expected, forward, &format!("{name}, states"));
            for (place, (found, expected)) in gradients.iter().zip(&expected_gradients).enumerate() {
                assert_close(found, expected, tolerance, &format!("{name}, gradient {place}"));
            }
        }
    }
}

#[test]
fn mistakes_are_told_with_their_place() {
    for (text, expected) in [
        ("-kk * p", "acceleration: column 2: unknown name \"kk\"; known are p, v, u, t, pi, k, l\n  -kk * p\n   ^^"),
        ("k * q", "column 5: q and w are the other object's"),
        ("k * (p - 2", "column 11: found the end, expected"),
        ("k * p3", "column 5: there is no object 3; they are p1 to p2"),
        ("k * p0", "column 5: there is no object 0"),
        ("k * lenght(p)", "column 5: unknown function \"lenght\"; known are abs, atan2,"),
        ("k * norm(p, l) * p", "column 5: norm takes 1 argument, not 2"),
        ("k * vec(l)", "column 5: vec takes 2 arguments, not 1"),
        ("k * p + l", "column 9: a vector and a scalar cannot be added"),
        ("k * p * p", "column 9: two vectors are multiplied by dot(a, b)"),
        ("p / p", "column 5: this is a vector; nothing can be divided by one"),
        ("k * p ^ 2", "column 9: a power is of scalars"),
        ("sin(p)", "column 5: this is a vector, a scalar is needed"),
        ("abs(p)", "; the size of a vector is norm"),
        ("k * norm(l) * p", "column 10: this is a scalar, a vector is needed; the size of a scalar is abs"),
        ("k * l", "column 1: the acceleration must be a vector, but this is a scalar"),
        ("k * p.z", "column 5: there is no part \"z\"; a vector has .x and .y"),
        ("k * l.x * p", "column 5: this is a scalar, a vector is needed"),
        ("k * other.l * p", "column 5: there is an other object only inside others(..)"),
        ("others(k * other.l * (p - q))", "objects have no parameter \"l\" of their own (each = true)"),
        ("others(others(k * (p - q)))", "column 8: others(..) cannot stand inside others(..)"),
        ("k * other", "column 5: the other object's parameter is written other.name"),
        ("k * p / (1 - 1)", "column 10: this is 0; nothing can be divided by it"),
        ("k * p * ln(1 - 2)", "column 12: this is NaN, not a finite number"),
        // Units.
        ("k * p + v", "column 9: units [1, -2] and [1, -1] (powers of length and time) cannot be put together"),
        (
            "k * p * l",
            "column 1: the acceleration must have the unit [1, -2] (powers of length and time), but has [2, -2]",
        ),
        ("k * p * exp(norm(p))", "column 13: this has the unit [1, 0]"),
        ("k * p * l ^ norm(p)", "column 13: the exponent has the unit [1, 0]"),
        ("k * p * l ^ (k / k)", "needs a number as its exponent"),
        ("k * vec(l, k)", "column 5: units [1, 0] and [0, -2]"),
        ("k * vec(min(l, 3), atan2(p.x, k))", "column 20: units [1, 0] and [0, -2]"),
    ] {
        let found = about(text);
        assert!(found.contains(expected), "{text}: {found}");
    }
    let of = |body: &str| complaint(body, 2);
    for (toml, expected) in [
        ("acceleration = \"-k * p\"\nparameters.k = {}\nparameters.c = {}", "no acceleration names c"),
        ("acceleration = \"-k * p\"\nparameters.k = {}\nwhere.d = \"p\"", "where: no acceleration names d"),
        ("acceleration = \"d\"\nwhere.d = \"2 * d\"", "where d, column 5: d is defined by itself"),
        ("acceleration = \"d\"\nwhere.d = \"e\"\nwhere.e = \"zz\"", "where e, column 1: unknown name"),
        ("acceleration = \"d\"\nwhere.d = \"2 *\"", "where.d: column 4: found the end"),
        ("acceleration = \"d\"\nwhere.d = \"p\"\nparameters.d = {}", "where.d: a parameter is called so, too"),
        ("acceleration = [\"p\"]", "the list has 1 texts, but there are 2 objects"),
        ("acceleration = [\"-k * p\", \"-k\"]\nparameters.k = {}", "acceleration of object 2: column 1"),
        ("acceleration = 3", "a text, or a list with a text for each object"),
        (
            "acceleration = \"-k * p\"\nparameters.k.low = 2.0\nparameters.k.high = 1.0",
            "parameters.k: low = 2 must be less",
        ),
        ("acceleration = \"-k * p\"\nparameters.k.start = -2.0", "parameters.k: start = -2: must be a positive number"),
        ("acceleration = \"-k * p\"\nparameters.k = { high = 3.0, fixed = 4.0 }", "must be a number between 0 and 3"),
        ("acceleration = \"-k * p\"\nparameters.k = { start = 1.0, fixed = 1.0 }", "start and fixed are both given"),
        (
            "acceleration = \"-k * p\"\nparameters.k = { unit = [0, -2], unit_name = \"m\" }",
            "unit and unit_name are both given",
        ),
        ("acceleration = \"-k * p\"\nparameters.k.unit_name = \"\"", "unit_name = \"\": 1 to 16 characters"),
        ("acceleration = \"-k * p\"\nparameters.k.unit = [0.5, 1]", "expected i32"),
        ("acceleration = \"-k * p\"\nparameters.k.units = [1, 1]", "unknown field `units`"),
        ("acceleration = \"-v2 * p\"\nparameters.v2 = {}", "parameters.v2: the name means something else"),
        ("acceleration = \"-K * p\"\nparameters.K = {}", "parameters.K: the name must be a lower-case letter"),
        ("acceleration = \"-k * p\"\nparameters.k.each = true\nparameters.k2 = {}", "two are called k2"),
        ("acceleration = \"-t * p\"\nparameters.t = {}", "parameters.t: the name means something else"),
        ("acceleration = \"any * u * t * p\"\nparameters.any.fixed = 1.0", "names both u and t"),
        ("acceleration = \"vec(0, 0)\"\nrestitution = 0.5", "set walls = true"),
        ("acceleration = \"vec(0, 0)\"\nwalls = true\nrestitution = 1.5", "restitution = 1.5: must be 0 to 1"),
        ("acceleration = \"vec(0, 0)\"\nwalls = true\nrestitution = \"e\"", "there is no such parameter"),
        (
            "acceleration = \"vec(0, 0)\"\nwalls = true\nrestitution = \"e\"\nparameters.e.unit = [0, 0]",
            "restitution = \"e\": must be 0 to 1; say low = 0 and high = 1 of e",
        ),
        (
            "acceleration = \"vec(0, 0)\"\nwalls = true\nrestitution = \"e\"\nparameters.e = { low = -1.0, high = 1.0 }",
            "restitution = \"e\": must be 0 to 1",
        ),
        ("acceleration = \"0\"\nstate = \"angle\"\nwalls = true", "there are walls for positions, not for angles"),
        ("acceleration = \"0\"\nstate = \"angle\"\nwalls.left = 3.0", "there are walls for positions, not for angles"),
        ("acceleration = \"vec(0, 0)\"\nwalls = {}", "walls: none of left, right, top and bottom is given"),
        ("acceleration = \"vec(0, 0)\"\nwalls.floor = 3.0", "places in pixels for some of left, right, top and bottom"),
        ("acceleration = \"vec(0, 0)\"\nwalls.top = \"roof\"", "walls.top = \"roof\": there is no such parameter"),
        (
            "acceleration = \"vec(0, 0)\"\nwalls.top = \"roof\"\nparameters.roof.unit = [1, -1]",
            "walls.top = \"roof\": has the unit [1, -1], but is a place, in pixels",
        ),
        ("acceleration = \"vec(0, 0)\"\nwalls = { left = 20.0, right = 10.0 }", "20 and 10 leave no room"),
        ("acceleration = \"vec(0, 0)\"\nsubsteps = 0", "substeps = 0: must be 1 to"),
        ("acceleration = \"vec(0, 0)\"\nintegrator = \"leapfrog\"", "unknown variant `leapfrog`"),
    ] {
        let found = of(toml);
        assert!(found.contains(expected), "{toml}: {found}");
    }
    let alone = complaint("acceleration = \"others(p - q)\"", 1);
    assert!(alone.contains("there are no others"), "{alone}");
    // In a text of several lines the line is named.
    let found = complaint("acceleration = \"\"\"\n  -p\n  + zz\n\"\"\"", 2);
    assert!(
        found.contains("line 2, column 5: unknown name \"zz\"; known are p, v, u, t, pi\n    + zz\n      ^^"),
        "{found}"
    );
}

/// Deep and long texts end in a message, whatever they are made of.
#[test]
fn no_text_exhausts_stack_or_memory() {
    let any = "parameters.any.fixed = 1.0\nwhere.d0 = \"any * p\"";
    let deep = |i: usize| format!("where.d{i} = \"{}d{}{}\"\n", "1 * (".repeat(30), i - 1, ")".repeat(30));
    let deep: String = (1..100).map(deep).collect();
    let found = complaint(&format!("acceleration = \"d99\"\n{any}\n{deep}"), 2);
    assert!(found.contains("more than 200 expressions in each other"), "{found}");
    // Each definition doubles the one before; it is computed once.
    let doubled: String = (1..80).map(|i| format!("where.d{i} = \"d{} + d{}\"\n", i - 1, i - 1)).collect();
    let doubled = table(&format!("acceleration = \"d79\"\n{any}\n{doubled}"));
    assert!(CellKind::of_text(&doubled, 2).is_ok());
    let factors = (0..20).map(|n| format!("(any * dot(p, q) + {n})")).collect::<Vec<_>>().join(" * ");
    let list = vec![format!("d0 + others({factors} * (p - q))"); 32];
    let found = complaint(&format!("acceleration = {list:?}\n{any}"), 32);
    assert!(found.contains("more than 10000 operations"), "{found}");
}

#[test]
fn the_same_text_is_the_same_equation_and_others_are_told_apart() {
    let spring = |objects| read(SPRING_OF_OTHERS, objects);
    let first = spring(2);
    assert_eq!(first, spring(2));
    for other in [spring(3), read(SPRINGS_ONE_BY_ONE, 2), SPRING.kind(2)] {
        assert_ne!(first, other);
        // Nor is another equation the same under its name.
        assert_ne!(first, CellKind { name: first.name.clone(), ..other });
    }
}

#[test]
fn lists_sums_and_parameters_of_each_object_agree() {
    let all = read(
        "acceleration = \"others(-k * other.m * (p - q) + k * w + vec(b, 0)) + others(k * v) / m\"\n\
         parameters.k = {}\nparameters.b = {}\nparameters.m.each = true",
        3,
    );
    assert_eq!(
        all.parameters.iter().map(|parameter| &*parameter.name).collect::<Vec<_>>(),
        ["b", "k", "m1", "m2", "m3"]
    );
    let texts = [
        ["-k * m2 * (p1 - p2) + k * v2 - k * m3 * (p1 - p3) + k * v3 + 2 * vec(b, 0) + 2 * k * v1 / m1"],
        ["others(-k * other.m * (p - q) + k * w + vec(b, 0)) + others(k * v) / m"],
        ["-k * m1 * (p3 - p1) + k * v1 - k * m2 * (p3 - p2) + k * v2 + 2 * vec(b, 0) + 2 * k * v3 / m3"],
    ];
    let list = read(
        &format!(
            "acceleration = {:?}\nparameters.k = {{}}\nparameters.b = {{}}\nparameters.m.each = true",
            texts.concat()
        ),
        3,
    );
    let first = State {
        pos: uniform("positions", &[8, 6], 0.0, 30.0, Kind::Double),
        vel: uniform("velocities", &[8, 6], -5.0, 5.0, Kind::Double),
    };
    let unconstrained = uniform("raw", &[5], -1.0, 1.0, Kind::Double);
    let unconstrained: Vec<_> = (0..5).map(|i| unconstrained.get(i)).collect();
    let [one, other] =
        [all, list].map(|kind| kind.cell(&unconstrained, Walls::new(32, 2.0)).step(&first, None, 0.2).joined());
    assert_close(&one, &other, 1e-14, "one text for all, and one for each");
}

/// What the functions compute, on numbers that are known.
#[test]
fn functions_have_their_meaning() {
    let (p, v) = ([3.0, 4.0], [-2.0, 0.5]);
    for (text, expected) in [
        ("vec(norm(p), dot(p, v))", [5.0, -4.0]),
        ("vec(cross(p, v), p.y - v.x)", [3.0 * 0.5 + 4.0 * 2.0, 6.0]),
        ("perp(p)", [-4.0, 3.0]),
        ("unit(p) + 0 * unit(p - p)", [0.6, 0.8]),
        ("vec(sqrt(p.y), square(p.x))", [2.0, 9.0]),
        ("vec(exp(v.y), ln(p.x))", [0.5f64.exp(), 3f64.ln()]),
        ("vec(sin(pi / 2), cos(pi))", [1.0, -1.0]),
        ("vec(sin(v.y), cos(v.y))", [0.5f64.sin(), 0.5f64.cos()]),
        ("vec(tan(v.y), tanh(v.y))", [0.5f64.tan(), 0.5f64.tanh()]),
        ("vec(atan2(p.y, v.x), abs(v.x))", [4f64.atan2(-2.0), 2.0]),
        ("vec(sign(v.x), min(p.x, p.y))", [-1.0, 3.0]),
        ("vec(max(p.x, 3.5), min(2, 1 + 0))", [3.5, 1.0]),
        ("vec(max(p.x, p.y), 2^3^2)", [4.0, 512.0]),
        ("vec(-p.x^2, 2^-1)", [-9.0, 0.5]),
        ("vec(p.x^p.y, 2^p.x)", [81.0, 8.0]),
        ("vec(1 / p.y, 1 - p.y)", [0.25, -3.0]),
        ("vec(1e1, p.x / 2) / 2", [5.0, 0.75]),
    ] {
        // Units are another matter.
        let kind = read(&format!("acceleration = \"any * ({})\"\nparameters.any.fixed = 1.0", with_any(text)), 1);
        let first = State { pos: Tensor::from_slice(&p).unsqueeze(0), vel: Tensor::from_slice(&v).unsqueeze(0) };
        let end = kind.cell(&[Tensor::from(0.0)], Walls::new(32, 0.0)).substep(&first, None, 1.0);
        let found = Vec::<f64>::try_from((end.vel - first.vel).flatten(0, 1)).unwrap();
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{text}: {found} instead of {expected}");
        }
    }
}

/// With positions and velocities of an unknown unit.
fn with_any(text: &str) -> String {
    text.replace("p.", "(any*p).").replace("v.", "(any*v).").replace("p)", "any*p)").replace("v)", "any*v)")
}

/// Errors of a swing after a fixed time fall with the step as the method's order says.
#[test]
fn integrators_have_their_order() {
    for (integrator, order) in [("euler", 1), ("verlet", 2), ("rk4", 4)] {
        let error = |substeps: usize| {
            let kind = read(
                &format!(
                    "acceleration = \"-k * p - 0.5 * c * v\"\nintegrator = {integrator:?}\nsubsteps = {substeps}\n\
                     parameters.k.unit = [0, -2]\nparameters.c.unit = [0, -1]"
                ),
                1,
            );
            let unconstrained = [0.2f64.ln(), 3f64.ln()].map(Tensor::from);
            let first = State::from_joined(&Tensor::from_slice(&[1.0, -0.5, 0.3, 0.8]).unsqueeze(0));
            let end = kind
                .cell(&unconstrained, Walls::new(32, 0.0))
                .roll_out(&first, &Actions::none(), 0.5, 4)
                .pop()
                .unwrap();
            // A damped oscillation, of decay c / 4 and frequency sqrt(k - decay^2).
            let (decay, t) = (0.05f64, 2.0f64);
            let frequency = (3.0 - decay * decay).sqrt();
            let at = |p: f64, v: f64| {
                (-decay * t).exp() * (p * (frequency * t).cos() + (v + decay * p) / frequency * (frequency * t).sin())
            };
            let expected = Tensor::from_slice(&[at(1.0, 0.3), at(-0.5, 0.8)]).unsqueeze(0);
            (end.pos - expected).abs().max().double_value(&[])
        };
        let fall = error(8) / error(16);
        assert!(
            (fall.log2() - f64::from(order)).abs() < 0.3,
            "{integrator}: halving the step divides the error by {fall}"
        );
    }
}

/// A push that comes and goes in time, from any time on, also after the last one that the dataset holds.
#[test]
fn the_time_goes_on_within_a_frame_and_beyond_the_dataset() {
    let (dt, start) = (0.5, State::from_joined(&Tensor::from_slice(&[1.0, -0.5, 0.3, 0.8]).unsqueeze(0)));
    let position = |integrator: &str, substeps: usize, begin: Option<f64>| {
        let kind = read(
            &format!(
                "acceleration = \"a * cos(beat * t) * vec(1, 2)\"\nintegrator = {integrator:?}\nsubsteps = {substeps}\n\
                 parameters.a.unit = [1, -2]\nparameters.beat.unit = [0, -1]"
            ),
            1,
        );
        assert!(kind.tells_time() && kind.actions && !kind.can_be_driven());
        // Two times of five are known.
        let times = begin.map(|begin| Tensor::from_slice(&[begin, begin + dt]).unsqueeze(0));
        let unconstrained = [3f64.ln(), 2f64.ln()].map(Tensor::from);
        let states = kind.cell(&unconstrained, Walls::new(32, 0.0)).roll_out(&start, &Actions::new(times), dt, 5);
        Vec::<f64>::try_from(states[4].pos.flatten(0, 1)).unwrap()
    };
    // x'' = a cos(b t): x = x0 + (v0 - a / b sin(b t0)) T + a / b^2 (cos(b t0) - cos(b (t0 + T))).
    let (a, b, passed) = (3.0f64, 2.0f64, 2.5f64);
    for begin in [None, Some(0.0), Some(0.7), Some(12.3)] {
        let t0: f64 = begin.unwrap_or(0.0);
        let driven = |times: f64| {
            times * (a / (b * b) * ((b * t0).cos() - (b * (t0 + passed)).cos()) - a / b * (b * t0).sin() * passed)
        };
        let expected = [1.0 + 0.3 * passed + driven(1.0), -0.5 + 0.8 * passed + driven(2.0)];
        let off = |integrator: &str, substeps: usize| {
            let found = position(integrator, substeps, begin);
            found.iter().zip(expected).map(|(found, expected)| (found - expected).abs()).fold(0.0, f64::max)
        };
        // Ten steps of 0.05 in 0.5: (b h)^4 / 180 of some 10 pixels.
        assert!(off("rk4", 10) < 1e-4, "{begin:?}: {}", off("rk4", 10));
        for (integrator, order) in [("euler", 1), ("verlet", 2)] {
            let fall = off(integrator, 8) / off(integrator, 16);
            assert!((fall.log2() - f64::from(order)).abs() < 0.3, "{integrator} from {begin:?}: {fall}");
        }
    }
}

#[test]
fn restitution_is_what_a_wall_leaves_and_is_taken_back_in_reverse() {
    let learned = read(
        "acceleration = \"0 * p * a\"\nwalls = true\nrestitution = \"e\"\nparameters.a.fixed = 1.0\n\
         parameters.e = { unit = [0, 0], high = 1.0 }",
        1,
    );
    let fixed = read("acceleration = \"vec(0, 0)\"\nwalls = true\nrestitution = 0.75", 1);
    let first = State::from_joined(&Tensor::from_slice(&[29.0, 5.0, 8.0, 1.0]).unsqueeze(0));
    let both = [(learned, vec![Tensor::from(0.0), Tensor::from(3f64.ln())], vec![1.0, 0.75]), (fixed, vec![], vec![])];
    for (kind, unconstrained, values) in both {
        let cell = kind.cell(&unconstrained, Walls::new(32, 2.0));
        let next = cell.substep(&first, None, 0.5);
        // 33 would be 3 beyond the wall at 30.
        assert_close(&next.joined(), &Tensor::from_slice(&[27.75, 5.5, -6.0, 1.0]).unsqueeze(0), 1e-12, &kind.name);
        let last = State::from_joined(&Tensor::from_slice(&[29.0, 5.5, -6.0, 1.0]).unsqueeze(0));
        let back = cell.substep(&last, None, -0.5);
        // Two units of way behind the wall took place at the greater speed.
        assert_close(
            &back.joined(),
            &Tensor::from_slice(&[30.0 - 2.0 / 0.75, 5.0, 8.0, 1.0]).unsqueeze(0),
            1e-12,
            &kind.name,
        );
        // In plain numbers as in tensors.
        let Build::Text(equation) = &kind.build else { panic!("{} is a text", kind.name) };
        let (mut pos, mut vel) = ([29.0, 5.5], [-6.0, 1.0]);
        SingleEquation::new(equation, &values, Walls::new(32, 2.0)).substep(&mut pos, &mut vel, 0.0, -0.5);
        let plain = Tensor::from_slice(&[pos, vel].concat()).unsqueeze(0);
        assert_close(&plain, &back.joined(), 1e-12, "in plain numbers");
    }
}

/// A floor that is a parameter turns a ball back, and nothing else does; the path depends on it as difference quotients say.
#[test]
fn a_wall_stands_where_the_equation_says() {
    let floor = |force: &str| {
        let parameters = "parameters.g = { fixed = 6.0 }\nparameters.floor = { unit = [1, 0], high = 32.0 }";
        let walls = "walls.bottom = \"floor\"\nrestitution = 0.75\nsubsteps = 1";
        read(&format!("acceleration = \"vec(0, {force})\"\n{walls}\n{parameters}"), 1)
    };
    let unconstrained = |kind: &CellKind, place: f64| {
        kind.parameters
            .iter()
            .map(|it| Tensor::from(it.bounds.unconstrained(it.fixed.unwrap_or(place))))
            .collect::<Vec<_>>()
    };
    let first = State::from_joined(&Tensor::from_slice(&[29.0, 19.0, 8.0, 4.0]).unsqueeze(0));
    let coasts = floor("0 * g");
    let next = coasts.cell(&unconstrained(&coasts, 20.0), Walls::new(32, 2.0)).substep(&first, None, 0.5);
    // To the right it leaves the frame; downwards it would be 1 beyond the floor.
    assert_close(&next.joined(), &Tensor::from_slice(&[33.0, 19.25, 8.0, -3.0]).unsqueeze(0), 1e-12, "next");

    let falls = floor("g");
    let end = |unconstrained: &[Tensor]| {
        let states = falls.cell(unconstrained, Walls::new(32, 2.0)).roll_out(&first, &Actions::none(), 0.1, 12);
        states.last().unwrap().joined().select(0, 0)
    };
    let at = unconstrained(&falls, 20.0);
    let place = falls.parameters.iter().position(|it| it.name == "floor").unwrap();
    let learned: Vec<_> = at.iter().map(|unconstrained| unconstrained.detach().set_requires_grad(true)).collect();
    for number in [1, 3] {
        let by =
            Tensor::run_backward(&[end(&learned).get(number)], &[&learned[place]], true, false)[0].double_value(&[]);
        let moved = |step: f64| {
            let mut unconstrained: Vec<_> = at.iter().map(Tensor::shallow_clone).collect();
            unconstrained[place] = &unconstrained[place] + step;
            end(&unconstrained).double_value(&[number])
        };
        let quotient = (moved(1e-6) - moved(-1e-6)) / 2e-6;
        assert!((by - quotient).abs() < 1e-4 * quotient.abs().max(0.1), "number {number}: {by}, quotient {quotient}");
        assert!(quotient.abs() > 0.1, "the path does not depend on the floor: the test would show nothing");
    }
}

/// A charge whose parameters may be negative.
const CHARGE: &str = r#"
name = "a_charge"

[system]
side = 32
channels = 1
objects = 1
input_steps = 4
pred_steps = 6
dt = 0.3

[system.equation]
acceleration = "vec(e, 0) + b * perp(v)"
integrator = "rk4"

[system.equation.parameters]
e = { unit = [1, -2], low = -10.0, high = 10.0, start = -1.0 }
b = { unit = [0, -1], low = -5.0 }

[data]
train_frames = 12
test_frames = 12

[truth]
e = 0.6
b = -1.5

[success.parameters]
b = 3.0
"#;

#[test]
fn a_run_keeps_its_text_and_its_parameters_their_bounds() {
    let task = Task::from_toml(CHARGE).unwrap();
    assert_eq!(task.truth_of("b"), Some(-1.5));
    let overrides = Overrides { set: vec!["start.b=-0.5".into()], ..Overrides::default() };
    let config = Config::load_task(task.clone(), None, &overrides).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("config.toml");
    std::fs::write(&path, config.to_toml()).unwrap();
    let again = Config::read(&path).unwrap();
    assert_eq!(again, config);
    assert_eq!(again.task.system.cell, task.system.cell);
    assert_eq!(again.differences(&config), [""; 0]);

    let value =
        |model: &PhysicsNet, name: &str| model.parameter_values().into_iter().find(|(own, _)| *own == name).unwrap().1;
    let model = PhysicsNet::new(&task.system, &config.model, Device::Cpu, 1).unwrap();
    // Without a start the unconstrained parameter is 0: one above the bound.
    assert!((value(&model, "e") + 1.0).abs() < 1e-5 && (value(&model, "b") + 4.0).abs() < 1e-5);
    for parameter in model.learned() {
        model.set_value(parameter, -0.25).unwrap();
        assert!((value(&model, &parameter.kind.name) + 0.25).abs() < 1e-5);
        assert!(model.set_value(parameter, -11.0).unwrap_err().to_string().contains("must be a number"));
    }
    for (set, expected) in [
        ("start.b=-7.0", "must be a number above -5"),
        ("model.fixed.e=12.0", "must be a number between -10 and 10"),
        ("start.zz=1.0", "no such parameter"),
        ("task.system.equation.parameters.e.low=0.0", "start = -1: must be a number between 0 and 10"),
    ] {
        let overrides = Overrides { set: vec![set.into()], ..Overrides::default() };
        let error = format!("{:#}", Config::load_task(task.clone(), None, &overrides).unwrap_err());
        assert!(error.contains(expected), "{set}: {error}");
    }
    let wrong = CHARGE.replace("b = -1.5", "b = -5.5");
    assert!(
        format!("{:#}", Task::from_toml(&wrong).unwrap_err()).contains("truth.b = -5.5: must be a number above -5")
    );
    let options = ModelOptions { fixed: [("b".to_string(), -2.0)].into(), ..ModelOptions::original() };
    let model = PhysicsNet::new(&task.system, &options, Device::Cpu, 1).unwrap();
    assert_eq!(model.parameter_values().len(), 1);
}
