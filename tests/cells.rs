//! The physics cells against closed forms, conservation laws and finite differences, in float64.

use paig::cells::{Cell, CellKind, State};
use tch::{Kind, Tensor};

fn scalar(value: f64) -> Tensor {
    Tensor::from(value).to_kind(Kind::Double)
}

fn row(values: &[f64]) -> Tensor {
    Tensor::from_slice(values).unsqueeze(0)
}

fn state(pos: &[f64], vel: &[f64]) -> State {
    State { pos: row(pos), vel: row(vel) }
}

fn spring(k: f64, l: f64) -> Box<dyn Cell> {
    CellKind::Spring.build(&[scalar(k.ln()), scalar(l.ln())], 32)
}

fn gravity(g: f64) -> Box<dyn Cell> {
    CellKind::Gravity.build(&[scalar(g.ln())], 36)
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
        now = cell.substep(&now, h);
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
    let next = cell.step(&state(&[22.0, 16.0, 10.0, 16.0], &[1.0, -2.0, 1.0, -2.0]), 0.3);
    for (found, expected) in values(&next.pos).iter().zip([22.3, 15.4, 10.3, 15.4]) {
        assert!((found - expected).abs() < 1e-9, "{found} instead of {expected}");
    }
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
        now = cell.substep(&now, 1e-3);
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
    let cell = CellKind::Bouncing.build(&[], 32);
    let (pos, vel) = ([5.0, 20.0, 28.0, 3.0], [-8.0, 3.1, 7.3, -2.2]);
    let mut now = state(&pos, &vel);
    for frame in 1..=40 {
        now = cell.step(&now, 0.3);
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

/// d loss / d x by autograd and by central differences, for a loss on the states after three frames.
fn check_gradient(build: impl Fn(&[Tensor]) -> Box<dyn Cell>, logs: &[f64], pos: &[f64], vel: &[f64]) {
    let count = (logs.len(), pos.len());
    let loss = |x: &Tensor| {
        let logs: Vec<_> = (0..count.0).map(|i| x.get(i as i64)).collect();
        let states = x.narrow(0, count.0 as i64, 2 * count.1 as i64).unsqueeze(0);
        let end = build(&logs).roll_out(&State::from_joined(&states), 0.3, 3).pop().unwrap();
        let weights = Tensor::linspace(-1.0, 1.5, count.1 as i64, (Kind::Double, tch::Device::Cpu));
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
    check_gradient(
        |logs| CellKind::Spring.build(logs, 32),
        &[1.2, 1.7],
        &[20.0, 13.0, 11.0, 17.0],
        &[1.0, -2.0, 0.5, 3.0],
    );
    check_gradient(
        |logs| CellKind::Gravity.build(logs, 36),
        &[4.0],
        &[18.0, 9.0, 26.0, 22.0, 10.0, 23.0],
        &[2.0, 0.3, -1.0, 1.5, -0.7, -1.9],
    );
    check_gradient(|logs| CellKind::Bouncing.build(logs, 32), &[], &[5.0, 20.0, 28.0, 3.0], &[-8.0, 3.1, 7.3, -2.2]);
}
