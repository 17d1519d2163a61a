//! The physics cells against closed forms, conservation laws and finite differences, in float64.

use std::fs;
use std::path::Path;

use paig::network::cells::{
    Actions, BOUNCING, Cell, CellKind, DAMPED_SPRING, FALLING, FALLING_BOUNCING, GRAVITY, PENDULUM, SPRING, State,
    Walls, plain,
};
use paig::support::random::named_generator;
use paig::tasks;
use tch::{Device, Kind, Tensor};

fn scalar(value: f64) -> Tensor {
    Tensor::from(value).to_kind(Kind::Double)
}

fn row(values: &[f64]) -> Tensor {
    Tensor::from_slice(values).unsqueeze(0)
}

fn state(pos: &[f64], vel: &[f64]) -> State {
    State { pos: row(pos), vel: row(vel) }
}

/// In a frame of 32 x 32, for balls of radius 2.
fn build(kind: &CellKind, logs: &[Tensor]) -> Box<dyn Cell> {
    kind.cell(logs, Walls::new(32, 2.0))
}

fn spring(k: f64, l: f64) -> Box<dyn Cell> {
    build(&SPRING.kind(2), &[scalar(k.ln()), scalar(l.ln())])
}

fn gravity(g: f64) -> Box<dyn Cell> {
    build(&GRAVITY, &[scalar(g.ln()), scalar(0.0)])
}

fn values(x: &Tensor) -> Vec<f64> {
    Vec::try_from(x.flatten(0, -1)).unwrap()
}

/// Two unit masses on a spring of constant k oscillate along their separation with frequency sqrt(2 k) about 2 l.
#[test]
fn spring_follows_the_harmonic_solution_for_small_steps() {
    let (k, l, stretch) = (4.0, 6.0, 3.0);
    let cell = spring(k, l);
    let start = state(&[16.0 + l + stretch / 2.0, 10.0, 16.0 - l - stretch / 2.0, 10.0], &[0.5, 0.2, 0.5, 0.2]);
    let (steps, h) = (4000, 1e-3);
    let mut now = state(&values(&start.pos), &values(&start.vel));
    for _ in 0..steps {
        now = cell.substep(&now, None, h);
    }
    let t = steps as f64 * h;
    let half = l + stretch / 2.0 * ((2.0 * k).sqrt() * t).cos();
    let (x, y) = (16.0 + 0.5 * t, 10.0 + 0.2 * t);
    let expected = [x + half, y, x - half, y];
    // Semi-implicit Euler is of first order: amplitude * frequency * h = 1.5 * 2.8 * 1e-3.
    for (found, expected) in values(&now.pos).iter().zip(expected) {
        assert!((found - expected).abs() < 5e-3, "{found} instead of {expected}");
    }
}

#[test]
fn spring_at_rest_length_moves_freely() {
    let cell = spring(4.0, 6.0);
    let next = cell.step(&state(&[22.0, 16.0, 10.0, 16.0], &[1.0, -2.0, 1.0, -2.0]), None, 0.3);
    for (found, expected) in values(&next.pos).iter().zip([22.3, 15.4, 10.3, 15.4]) {
        assert!((found - expected).abs() < 1e-9, "{found} instead of {expected}");
    }
}

/// Where both bodies are in one place, as where the encoder puts both in one corner of the frame, the spring's repulsion has the
/// derivative 2 k l / 1e-4 by their distance: a gradient grows by the same factor with each substep, 251 for k = 2.465 and
/// l = 0.7023 at a time step of 0.06, and exceeds float32 within four frames. Values stay finite.
#[test]
fn gradients_through_coincident_bodies_grow_as_the_linearised_spring() {
    let (k, l, dt) = (2.465, 0.7023, 0.3);
    let gradients = |kind: Kind, frames: usize| {
        let tensor = |value: f64| Tensor::from(value).to_kind(kind);
        let place = row(&[32.0, 32.0, 32.0, 32.0]).to_kind(kind).set_requires_grad(true);
        let start = State { vel: place.zeros_like(), pos: place.shallow_clone() };
        let cell = build(&SPRING.kind(2), &[tensor(f64::ln(k)), tensor(f64::ln(l))]);
        let last = cell.roll_out(&start, &Actions::none(), dt, frames).pop().unwrap();
        assert_eq!(values(&last.pos.to_kind(Kind::Double)), [32.0; 4]);
        last.pos.select(1, 0).sum(kind).backward();
        values(&place.grad().to_kind(Kind::Double))
    };
    // Of the distance r: v' = v + 4 k l / 1e-4 h r, r' = r + h v'; the middle stays.
    let h = dt / 5.0;
    let stiffness = 4.0 * k * l / 1e-4;
    let distance = |frames: usize| {
        let (mut r, mut v) = (1.0, 0.0);
        for _ in 0..5 * frames {
            v += stiffness * h * r;
            r += h * v;
        }
        r
    };
    for frames in [1, 3, 9] {
        let found = gradients(Kind::Double, frames);
        let expected = [0.5 + distance(frames) / 2.0, 0.0, 0.5 - distance(frames) / 2.0, 0.0];
        for (found, expected) in found.iter().zip(expected) {
            // Some ten roundings in each of 45 substeps.
            assert!((found - expected).abs() <= 1e-12 * distance(frames), "{frames} frames: {found}, {expected}");
        }
    }
    assert!((distance(3) / distance(2)).powf(0.2) > 251.0 && distance(9) > 1e107);
    let finite = |frames| gradients(Kind::Float, frames).iter().all(|gradient| gradient.is_finite());
    assert_eq!([1, 2, 3, 4].map(finite), [true, true, true, false]);
}

fn momentum(state: &State) -> [f64; 2] {
    let v = values(&state.vel);
    [0, 1].map(|axis| v.iter().skip(axis).step_by(2).sum())
}

/// Kinetic plus potential energy of three unit masses under `-g / distance` for each pair.
fn energy(state: &State, g: f64) -> f64 {
    let (p, v) = (values(&state.pos), values(&state.vel));
    let kinetic: f64 = v.iter().map(|v| v * v / 2.0).sum();
    let pairs = [(0, 1), (1, 2), (2, 0)];
    let potential: f64 =
        pairs.iter().map(|&(i, j)| -g / (p[2 * i] - p[2 * j]).hypot(p[2 * i + 1] - p[2 * j + 1])).sum();
    kinetic + potential
}

#[test]
fn gravity_conserves_momentum_exactly_and_energy_for_small_steps() {
    let g = 60.0;
    let cell = gravity(g);
    let start = state(&[18.0, 9.0, 26.0, 22.0, 10.0, 23.0], &[2.0, 0.3, -1.0, 1.5, -0.7, -1.9]);
    let (before, energy_before) = (momentum(&start), energy(&start, g));
    let mut now = state(&values(&start.pos), &values(&start.vel));
    for _ in 0..4000 {
        now = cell.substep(&now, None, 1e-3);
    }
    for (found, expected) in momentum(&now).iter().zip(before) {
        assert!((found - expected).abs() < 1e-9, "momentum {found}, was {expected}");
    }
    // A symplectic step of first order: the energy stays within O(h) of itself.
    let change = (energy(&now, g) / energy_before - 1.0).abs();
    assert!(change < 2e-3, "energy changed by {change}");
}

/// Unfolds a path between walls at `near` and `far`.
fn reflected(start: f64, velocity: f64, t: f64, near: f64, far: f64) -> f64 {
    let width = far - near;
    let unfolded = (start - near + velocity * t).rem_euclid(2.0 * width);
    near + if unfolded > width { 2.0 * width - unfolded } else { unfolded }
}

#[test]
fn bouncing_follows_the_analytic_reflection() {
    let cell = build(&BOUNCING.kind(2), &[]);
    let (pos, vel) = ([5.0, 20.0, 28.0, 3.0], [-8.0, 3.1, 7.3, -2.2]);
    let mut now = state(&pos, &vel);
    for frame in 1..=40 {
        now = cell.step(&now, None, 0.3);
        for (i, found) in values(&now.pos).iter().enumerate() {
            // Reflection is exact, so the error is rounding alone.
            let expected = reflected(pos[i], vel[i], 0.3 * f64::from(frame), 2.0, 30.0);
            assert!((found - expected).abs() < 1e-9, "frame {frame}, coordinate {i}: {found} instead of {expected}");
        }
        for (found, start) in values(&now.vel).iter().zip(vel) {
            assert!((found.abs() - start.abs()).abs() < 1e-12, "speed {found}, was {start}");
        }
    }
}

/// Free fall is a parabola, to the first order of the step.
#[test]
fn falling_follows_the_parabola() {
    let g = 1.5;
    let cell = build(&FALLING.kind(1), &[scalar(f64::ln(g))]);
    let mut now = state(&[16.0, 20.0], &[1.0, -3.0]);
    for _ in 0..10 {
        now = cell.step(&now, None, 0.3);
    }
    let t = 3.0;
    // The velocity is updated first, so the ball is ahead by g t h / 2 with h = 0.3 / 5.
    let expected = [16.0 + t, 20.0 - 3.0 * t + g * t * t / 2.0 + g * t * 0.06 / 2.0, 1.0, -3.0 + g * t];
    for (found, expected) in values(&now.joined()).iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9, "{found} instead of {expected}");
    }
}

#[test]
fn a_falling_ball_that_bounces_keeps_its_energy() {
    let g = 1.5;
    let cell = build(&FALLING_BOUNCING.kind(1), &[scalar(f64::ln(g))]);
    let mut now = state(&[16.0, 12.0], &[2.0, 1.0]);
    let energy = |state: &State| {
        let (p, v) = (values(&state.pos), values(&state.vel));
        v.iter().map(|v| v * v / 2.0).sum::<f64>() - g * p[1]
    };
    let before = energy(&now);
    let mut bounces = 0;
    for _ in 0..20_000 {
        let next = cell.substep(&now, None, 1e-3);
        bounces += i32::from(values(&next.vel)[1] < 0.0 && values(&now.vel)[1] > 0.0);
        now = next;
    }
    assert!(bounces >= 2, "only {bounces} bounces: the test would show nothing");
    // Each step and each bounce errs by the order of g h times the speed, 1.5e-3 * 8.
    let change = energy(&now) - before;
    assert!(change.abs() < 0.05, "energy changed by {change}");
}

/// The impact of a ball that starts a little higher may fall into the next substep; its path may not jump for that.
#[test]
fn a_path_does_not_jump_as_its_impact_moves_to_the_next_substep() {
    let cell = build(&FALLING_BOUNCING.kind(1), &[scalar(f64::ln(3.0))]);
    let heights = 4000;
    let start = Tensor::linspace(20.0, 28.0, heights, (Kind::Double, Device::Cpu));
    let fill = |value: f64| start.full_like(value);
    let mut now = State {
        pos: Tensor::stack(&[fill(16.0), start.shallow_clone()], 1),
        vel: Tensor::stack(&[fill(0.0), fill(4.0)], 1),
    };
    for _ in 0..10 {
        now = cell.step(&now, None, 0.3);
    }
    let heights = now.pos.select(1, 1);
    let change = (heights.slice(0, 1, None, 1) - heights.slice(0, 0, -1, 1)).abs().max().double_value(&[]);
    // Starts differ by 0.002 px, and speeds at the wall by a little more; a lost substep of force would be 0.36 px per time
    // unit, nearly 1 px at the end.
    assert!(change < 0.05, "neighbours end {change} px from each other");
}

/// With friction c the separation of two unit masses on a spring is a damped oscillation.
#[test]
fn the_damped_spring_follows_the_damped_oscillation() {
    let (k, l, c, stretch) = (4.0f64, 6.0f64, 0.3f64, 3.0);
    let cell = build(&DAMPED_SPRING.kind(2), &[k, l, c].map(|value| scalar(value.ln())));
    let mut now = state(&[16.0 + l + stretch / 2.0, 10.0, 16.0 - l - stretch / 2.0, 10.0], &[0.0; 4]);
    let (steps, h) = (4000, 1e-3);
    for _ in 0..steps {
        now = cell.substep(&now, None, h);
    }
    let t = f64::from(steps) * h;
    let (decay, frequency) = (c / 2.0, (2.0 * k - c * c / 4.0).sqrt());
    let wave = (frequency * t).cos() + decay / frequency * (frequency * t).sin();
    let half = l + stretch / 2.0 * (-decay * t).exp() * wave;
    // First order: amplitude * frequency * h.
    for (found, expected) in values(&now.pos).iter().zip([16.0 + half, 10.0, 16.0 - half, 10.0]) {
        assert!((found - expected).abs() < 5e-3, "{found} instead of {expected}");
    }
}

fn pendulum(g: f64, a: f64) -> Box<dyn Cell> {
    build(&PENDULUM.kind(1), &[scalar(g.ln()), scalar(a.ln())])
}

/// About its lowest point a rod of length 1 swings with period 2 pi sqrt(2 / (3 g)).
#[test]
fn the_pendulum_has_the_small_angle_period() {
    let (g, amplitude) = (10.0f64, 0.01);
    let cell = pendulum(g, 1.0);
    let period = 2.0 * std::f64::consts::PI * (2.0 / (3.0 * g)).sqrt();
    let steps = 20_000;
    let mut now = state(&[std::f64::consts::PI + amplitude], &[0.0]);
    for _ in 0..steps {
        now = cell.substep(&now, None, period / f64::from(steps));
    }
    let found = [values(&now.pos)[0] - std::f64::consts::PI, values(&now.vel)[0]];
    // The period is longer by amplitude^2 / 16, and the step is of first order: both far below 1e-3 of the amplitude.
    assert!(
        (found[0] / amplitude - 1.0).abs() < 1e-3,
        "after a period the angle is {} of what it was",
        found[0] / amplitude
    );
    assert!(found[1].abs() < 1e-2 * amplitude * (1.5 * g).sqrt(), "and the rate {}", found[1]);
}

/// The torque's work is the change of energy: `theta'^2 / 6 + g cos(theta) / 2` with `dE = a u dtheta`.
#[test]
fn the_pendulum_gains_the_work_of_its_torque() {
    let (g, a, torque) = (10.0, 0.8, 1.7);
    let cell = pendulum(g, a);
    let action = row(&[torque]);
    let mut now = state(&[0.4], &[-1.0]);
    let energy = |state: &State| values(&state.vel)[0].powi(2) / 6.0 + g / 2.0 * values(&state.pos)[0].cos();
    let (angle, before) = (values(&now.pos)[0], energy(&now));
    for _ in 0..10_000 {
        now = cell.substep(&now, Some(&action), 1e-4);
    }
    let work = a * torque * (values(&now.pos)[0] - angle);
    // First order: g h times the angle turned.
    assert!((energy(&now) - before - work).abs() < 5e-3, "{} gained, {work} done", energy(&now) - before);
}

/// A cell steps through its actions one frame after the other, and on without any when they end.
#[test]
fn actions_act_in_their_own_frame() {
    let cell = pendulum(10.0, 1.0);
    let start = state(&[0.4], &[-1.0]);
    let actions = Actions::new(Some(row(&[1.0, -2.0])));
    let states = cell.roll_out(&start, &actions, 0.05, 3);
    let first = cell.step(&start, Some(&row(&[1.0])), 0.05);
    let second = cell.step(&first, Some(&row(&[-2.0])), 0.05);
    let third = cell.step(&second, None, 0.05);
    for (found, expected) in states.iter().zip([first, second, third]) {
        assert_eq!(values(&found.joined()), values(&expected.joined()));
    }
}

/// d loss / d x by autograd and by central differences, for a loss on the states after three frames.
fn check_gradient(kind: &CellKind, logs: &[f64], pos: &[f64], vel: &[f64]) {
    let count = (logs.len(), pos.len());
    let actions = Actions::new(kind.actions.then(|| row(&[0.7, -1.1, 1.9])));
    let loss = |x: &Tensor| {
        let logs: Vec<_> = (0..count.0).map(|i| x.get(i as i64)).collect();
        let states = x.narrow(0, count.0 as i64, 2 * count.1 as i64).unsqueeze(0);
        let end = build(kind, &logs).roll_out(&State::from_joined(&states), &actions, 0.3, 3).pop().unwrap();
        let weights = Tensor::linspace(-1.0, 1.5, count.1 as i64, (Kind::Double, Device::Cpu));
        (end.pos * &weights).sum(Kind::Double) + (end.vel * weights.square()).sum(Kind::Double)
    };
    let all = [logs, pos, vel].concat();
    let x = Tensor::from_slice(&all).set_requires_grad(true);
    let gradient = values(&Tensor::run_backward(&[loss(&x)], &[&x], false, false)[0]);
    for (i, analytic) in gradient.iter().enumerate() {
        let shifted = |by: f64| {
            let mut moved = all.clone();
            moved[i] += by;
            loss(&Tensor::from_slice(&moved)).double_value(&[])
        };
        let h = 1e-5;
        let numeric = (shifted(h) - shifted(-h)) / (2.0 * h);
        // Truncation h^2 and rounding 1e-15 / h leave some 1e-9 of the largest derivative.
        assert!((analytic - numeric).abs() < 1e-6 * (1.0 + numeric.abs()), "input {i}: {analytic} against {numeric}");
    }
}

#[test]
fn gradients_agree_with_finite_differences() {
    let pair = ([20.0, 13.0, 11.0, 17.0], [1.0, -2.0, 0.5, 3.0]);
    check_gradient(&SPRING.kind(2), &[1.2, 1.7], &pair.0, &pair.1);
    check_gradient(&DAMPED_SPRING.kind(2), &[1.2, 1.7, -0.5], &pair.0, &pair.1);
    check_gradient(&BOUNCING.kind(2), &[], &[5.0, 20.0, 28.0, 3.0], &[-8.0, 3.1, 7.3, -2.2]);
    check_gradient(&FALLING.kind(1), &[0.3], &[12.0, 9.0], &[2.0, -4.0]);
    check_gradient(&FALLING_BOUNCING.kind(1), &[0.3], &[4.0, 27.0], &[-8.0, 4.0]);
    check_gradient(&PENDULUM.kind(1), &[2.3, -0.2], &[0.6], &[-1.4]);
    let bodies = [18.0, 9.0, 26.0, 22.0, 10.0, 23.0];
    check_gradient(&GRAVITY, &[4.0, 0.1], &bodies, &[2.0, 0.3, -1.0, 1.5, -0.7, -1.9]);
}

/// The fit's roll-out in plain numbers is that of the tensors, for every equation that has one: those that are built in, and
/// all texts of the gallery, with what acts or the time, between walls, past the end of what is known.
#[test]
fn roll_outs_in_plain_numbers_are_those_of_tensors() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let gallery = fs::read_dir(folder.join("gallery")).unwrap().map(|entry| entry.unwrap().path());
    let texts = gallery.chain([folder.join("control/puck.toml")]);
    let texts = texts.map(|path| tasks::find(path.to_str().unwrap()).unwrap_or_else(|error| panic!("{error:#}")));
    let built_in = ["spring_color", "damped_spring", "3bp_color", "pendulum", "falling"];
    let tasks: Vec<_> = built_in.iter().map(|name| tasks::builtin(name).unwrap()).chain(texts).collect();
    assert!(tasks.len() >= 25, "only {} equations", tasks.len());
    let (batch, known, frames) = (7, 5, 9);
    for task in &tasks {
        let (system, kind) = (&task.system, &task.system.cell);
        let values = kind.parameters.iter().map(|it| task.truth_of(&it.name).or(it.fixed).unwrap_or(1.0));
        let unconstrained: Vec<_> =
            values.zip(&*kind.parameters).map(|(value, it)| scalar(it.bounds.unconstrained(value))).collect();
        let cell = system.build_cell(&unconstrained);
        let mut in_plain = cell.plain_double().unwrap_or_else(|| panic!("{} has no plain form", task.name));
        let coordinates = kind.coordinates.per_object() * system.objects;
        let mut random = named_generator(3, &task.name);
        let mut numbers = |count: usize, low: f64, high: f64| -> Vec<f64> {
            (0..count).map(|_| rand::Rng::random_range(&mut random, low..high)).collect()
        };
        let across = if kind.coordinates.per_object() == 1 { [-3.0, 3.0] } else { [4.0, 28.0] };
        let pos = Tensor::from_slice(&numbers(batch * coordinates, across[0], across[1])).reshape([batch as i64, -1]);
        let vel = Tensor::from_slice(&numbers(batch * coordinates, -4.0, 4.0)).reshape([batch as i64, -1]);
        let held = Tensor::from_slice(&numbers(batch * known, -1.0, 1.0)).reshape([batch as i64, -1]);
        let first = State { pos, vel };
        let options = if kind.actions { vec![Some(held), None] } else { vec![None] };
        for held in options.into_iter().filter(|held| held.is_some() || !kind.can_be_driven()) {
            let actions = Actions::new(held);
            let tensors = cell.roll_out(&first, &actions, system.dt, frames - 1);
            let positions: Vec<_> = std::iter::once(&first.pos).chain(tensors.iter().map(|state| &state.pos)).collect();
            let expected = Tensor::cat(&positions, 1);
            let tells_time = kind.tells_time();
            let found = plain::roll_out(in_plain.as_mut(), &first.joined(), &actions, tells_time, system.dt, frames);
            assert_eq!(found.size(), expected.size());
            // Float64, but for how far apart chance encounters lead: relative to the size of what is there.
            let error = ((&found - &expected).abs() / (expected.abs() + 1.0)).max().double_value(&[]);
            assert!(error < 1e-9, "{}: {error}", task.name);
        }
    }
}
