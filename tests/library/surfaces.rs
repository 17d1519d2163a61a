//! Surfaces and strings of an equation: closed forms of bounces, rest, sliding and slack strings, conservation laws, agreement of
//! plain numbers and tensors, mistakes.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_3};
use std::sync::Arc;

use paig::network::cells::text::{Equation, EquationTable, SingleEquation};
use paig::network::cells::{Actions, CellKind, State, Walls};
use tch::{Kind, Tensor};

const WALLS: Walls = Walls { near: -1e9, far: 1e9 };
const G: f64 = 10.0;
/// Frames of a second.
const FRAMES: usize = 20;

fn table(text: &str) -> EquationTable {
    toml::from_str(&format!("integrator = \"rk4\"\n{text}")).unwrap()
}

/// A fall with these constraints, `substeps` a frame.
fn fall(constraints: &str, substeps: usize) -> EquationTable {
    table(&format!("acceleration = \"vec(0, {G:?})\"\nsubsteps = {substeps}\n{constraints}"))
}

/// States frame by frame of an equation without parameters, the first included.
fn states(table: &EquationTable, begin: &[f64], frames: usize) -> Vec<Vec<f64>> {
    let equation = Arc::new(Equation::read(table, begin.len() / 4).unwrap());
    let mut single = SingleEquation::new(&equation, &[], WALLS);
    let mut state = begin.to_vec();
    let mut all = vec![state.clone()];
    for _ in 0..frames {
        single.advance(&mut state, 0.0, 1.0 / FRAMES as f64);
        all.push(state.clone());
    }
    all
}

/// Coordinates along a line of this angle and normal to it.
fn turned(angle: f64, [x, y]: [f64; 2]) -> [f64; 2] {
    [x * angle.cos() + y * angle.sin(), x * angle.sin() - y * angle.cos()]
}

fn close(found: &[f64], expected: &[f64], tolerance: f64, what: &str) {
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() < tolerance, "{what}: {found:?}, expected {expected:?}");
    }
}

/// Height and its rate a time after a drop from `height`, with the share `e` of the speed left by each bounce.
fn bounced(mut time: f64, height: f64, fall: f64, e: f64) -> [f64; 2] {
    let first = (2.0 * height / fall).sqrt();
    if time <= first {
        return [height - fall * time * time / 2.0, -fall * time];
    }
    time -= first;
    let mut speed = e * fall * first;
    while time > 2.0 * speed / fall {
        time -= 2.0 * speed / fall;
        speed *= e;
    }
    [speed * time - fall * time * time / 2.0, speed - fall * time]
}

/// Under a constant acceleration the time of impact is exact, whatever the number of substeps; an impact keeps the share e of the
/// normal velocity and all of the tangential one.
#[test]
fn a_ball_bounces_on_an_incline_by_the_closed_form() {
    let (angle, e, height) = (0.4_f64, 0.8, 8.0);
    let line = format!("surfaces = [{{ line = [3.0, 5.0], angle = {angle}, distance = 2.0, restitution = {e} }}]");
    let foot = [3.0, 5.0];
    let above = turned(angle, foot);
    let begin = [foot[0] + (height + 2.0) * angle.sin(), foot[1] - (height + 2.0) * angle.cos(), 0.0, 0.0];
    for substeps in [1, 3, 40] {
        for (frame, state) in states(&fall(&line, substeps), &begin, 90).iter().enumerate() {
            let time = frame as f64 / FRAMES as f64;
            let [along, across] = turned(angle, [state[0], state[1]]);
            let [slides, rises] = turned(angle, [state[2], state[3]]);
            let expected = bounced(time, height, G * angle.cos(), e);
            let slope = G * angle.sin();
            let found = [across - above[1] - 2.0, rises, along - above[0], slides];
            let expected = [expected[0], expected[1], slope * time * time / 2.0, slope * time];
            // Rounding of float64, which bounces amplify.
            close(&found, &expected, 1e-8, &format!("{substeps} substeps, frame {frame}"));
        }
    }
}

/// Infinitely many bounces end in a finite time; the ball then slides on the line, and stays there.
#[test]
fn bounces_end_in_a_slide_along_the_line() {
    let (angle, e, height) = (0.3_f64, 0.5, 1.0);
    for integrator in ["euler", "verlet", "rk4"] {
        let line = format!("surfaces = [{{ line = [0.0, 0.0], angle = {angle}, restitution = {e} }}]");
        let text = format!("acceleration = \"vec(0, {G:?})\"\nsubsteps = 20\nintegrator = \"{integrator}\"\n{line}");
        let begin = [height * angle.sin(), -height * angle.cos(), 0.0, 0.0];
        let fall = G * angle.cos();
        let first = (2.0 * height / fall).sqrt();
        let ended = first * (1.0 + 2.0 * e / (1.0 - e));
        let all = states(&toml::from_str(&text).unwrap(), &begin, 100);
        for (frame, state) in all.iter().enumerate() {
            let time = frame as f64 / FRAMES as f64;
            let [along, across] = turned(angle, [state[0], state[1]]);
            assert!(across > -1e-12, "{integrator}, frame {frame}: {across} beyond the line");
            if time > ended + 0.05 {
                let found = [across, turned(angle, [state[2], state[3]])[1]];
                close(&found, &[0.0, 0.0], 1e-9, &format!("{integrator}, frame {frame}"));
            }
            let slid = G * angle.sin() * time * time / 2.0;
            // Euler's method adds a part of a substep: G sin(angle) t h / 2.
            let tolerance = if integrator == "euler" { 0.02 * (1.0 + time) } else { 1e-9 };
            close(&[along], &[slid], tolerance, integrator);
        }
    }
}

/// A ball at rest on a floor stays at rest, bit by bit, for any restitution.
#[test]
fn a_ball_on_a_floor_stays() {
    for (integrator, e) in [("euler", 0.0), ("verlet", 0.7), ("rk4", 1.0)] {
        let text = format!(
            "acceleration = \"vec(0, 10)\"\nintegrator = \"{integrator}\"\n\
             surfaces = [{{ line = [0.0, 20.0], distance = 3.0, restitution = {e} }}]"
        );
        let begin = [5.0, 17.0, 0.0, 0.0];
        for state in states(&toml::from_str(&text).unwrap(), &begin, 50) {
            assert_eq!(state, begin, "{integrator}");
        }
    }
}

/// Dry friction holds a ball where tan(angle) is below the coefficient, slows it where it is not, and takes the share of an impact.
#[test]
fn friction_obeys_coulomb() {
    let (angle, mu) = (0.3_f64, 0.2);
    let sliding = G * (angle.sin() - mu * angle.cos());
    for integrator in ["euler", "rk4"] {
        let on = |mu: f64| {
            let text = format!(
                "acceleration = \"vec(0, {G:?})\"\nintegrator = \"{integrator}\"\nsubsteps = 10\n\
                 surfaces = [{{ line = [0.0, 0.0], angle = {angle}, friction = {mu} }}]"
            );
            states(&toml::from_str(&text).unwrap(), &[0.0; 4], 20).pop().unwrap()
        };
        close(&on(0.5), &[0.0; 4], 1e-12, "held");
        let [along, across] = turned(angle, [on(mu)[0], on(mu)[1]]);
        // Euler's method adds a part of a substep.
        close(&[along, across], &[sliding / 2.0, 0.0], if integrator == "euler" { 0.01 } else { 1e-9 }, integrator);
    }
    let thrown = states(
        &fall("surfaces = [{ line = [0.0, 0.0], restitution = 0.5, friction = 0.2 }]", 4),
        &[0.0, -0.2, 9.0, 4.0],
        1,
    );
    // v = 4.4721 down at the floor: 0.2 times 1.5 of it is taken of 9.
    let down = (16.0 + 2.0 * G * 0.2_f64).sqrt();
    close(&thrown[1][2..3], &[9.0 - 0.2 * 1.5 * down], 1e-9, "impact");
}

/// A pendulum on a string with v^2 = 3.5 g l at its lowest point goes slack at cos(theta) = -1/2, flies, is caught at its lowest
/// point, and keeps the tangential part sqrt(g l / 8) of its speed there.
#[test]
fn a_string_goes_slack_at_the_known_angle_and_catches_again() {
    let length = 2.0;
    let equation = fall(&format!("strings = [{{ at = [0.0, 0.0], length = {length:?} }}]"), 40);
    let all = states(&equation, &[0.0, length, (3.5 * G * length).sqrt(), 0.0], 4 * FRAMES);
    let gap = |state: &Vec<f64>| length - state[0].hypot(state[1]);
    // One frame is a coarse clock: the exact angle is that of the energy at the first slack state.
    let slack = all.iter().position(|state| gap(state) > 1e-6).unwrap();
    let energy = |state: &Vec<f64>| (state[2].powi(2) + state[3].powi(2)) / 2.0 - G * state[1];
    let begin = energy(&all[0]);
    for state in &all[..slack] {
        assert!((energy(state) / begin - 1.0).abs() < 1e-6, "the taut string takes no energy");
    }
    let angle = |state: &Vec<f64>| state[0].atan2(state[1]).to_degrees();
    assert!(
        angle(&all[slack - 1]) < 120.0 && angle(&all[slack]) > 119.0,
        "{} {}",
        angle(&all[slack - 1]),
        angle(&all[slack])
    );
    // The parabola from 120 degrees on, traced back from any state on it, and forward to the lowest point.
    let flying = &all[slack];
    let [u, w] = [flying[2], flying[3]];
    // On the way back to where the speed along y was that of the release.
    let release = (G * length * 3.0 / 8.0).sqrt();
    let since = (w + release) / G;
    let from = [flying[0] - u * since, flying[1] - w * since + G * since * since / 2.0];
    // Release is found to a substep: h = 1/800 of a speed of about 3.
    close(&from, &[length * 3.0_f64.sqrt() / 2.0, -length / 2.0], 4e-3, "release");
    let caught = all[slack..].iter().position(|state| gap(state) < 1e-9).unwrap() + slack;
    let flight = 6.0_f64.sqrt() * (length / G).sqrt();
    let took = (caught - slack) as f64 / FRAMES as f64;
    assert!((took - flight).abs() < 2.0 / FRAMES as f64, "flies for {took}, expected {flight}");
    // v_t^2 / 2 = g l (1 - cos) = g l / 16.
    let highest = all[caught..].iter().map(|state| state[1]).fold(f64::INFINITY, f64::min);
    assert!((highest / length - 0.9375).abs() < 2e-3, "swings to cos = {}", highest / length);
    assert!(all[caught..].iter().all(|state| gap(state).abs() < 1e-9), "stays taut");
}

/// A frictionless slide in a bowl is a pendulum; on a bump a ball leaves at cos = 2/3; elastic bounces in a bowl keep the energy.
#[test]
fn circles_hold_from_inside_and_outside() {
    let radius = 5.0;
    let bowl = format!("surfaces = [{{ bowl = [0.0, 0.0], distance = {radius:?}, restitution = 0.0 }}]");
    let begin = [radius * 0.8, radius * 0.6, 0.0, 0.0];
    let all = states(&fall(&bowl, 10), &begin, 60);
    let energy = |state: &[f64]| (state[2].powi(2) + state[3].powi(2)) / 2.0 - G * state[1];
    for state in &all {
        // Fourth order in omega h = 0.007.
        assert!((energy(state) - energy(&begin)).abs() < 1e-5, "{state:?}");
        assert!((state[0].hypot(state[1]) - radius).abs() < 1e-8, "{state:?}");
    }
    assert!((all.iter().map(|state| state[0]).fold(0.0, f64::min) + 0.8 * radius).abs() < 0.02, "to the other side");

    let elastic = format!("surfaces = [{{ bowl = [0.0, 0.0], distance = {radius:?} }}]");
    for state in states(&fall(&elastic, 40), &[1.0, 0.0, 0.0, 0.0], 100) {
        assert!(state[0].hypot(state[1]) < radius + 1e-9, "{state:?}");
        // Of the kinetic energy of 40; each of some 10 impacts is found to the square of a substep.
        assert!((energy(&state) - 0.0).abs() < 0.05, "{state:?}, {}", energy(&state));
    }

    let bump = format!("surfaces = [{{ bump = [0.0, 0.0], distance = {radius:?}, restitution = 0.0 }}]");
    let all = states(&fall(&bump, 40), &[0.0, -radius, 0.05, 0.0], 80);
    let gap = |state: &Vec<f64>| state[0].hypot(state[1]) - radius;
    let on: Vec<_> = all.iter().filter(|state| gap(state).abs() < 1e-9).collect();
    let left = all.iter().find(|state| gap(state) > 1e-6).unwrap();
    let cosine = |state: &Vec<f64>| -state[1] / radius;
    assert!(cosine(on.last().unwrap()) > 2.0 / 3.0 - 0.01 && cosine(left) < 2.0 / 3.0 + 0.01, "{on:?} {left:?}");
    // The horizontal speed stays that of the release: v^2 = g r cos, cos = 2/3.
    let speed = (G * radius * 2.0 / 3.0).sqrt() * 2.0 / 3.0;
    assert!((left[2] / speed - 1.0).abs() < 2e-3, "{} {speed}", left[2]);
}

/// A string between unequal masses keeps the momentum when it becomes taut, takes the relative speed along itself, and is then a rod.
#[test]
fn a_string_between_two_objects_keeps_the_momentum() {
    let text = "acceleration = \"vec(0, 3)\"\nsubsteps = 10\nstrings = [{ between = [1, 2], length = 4.0, masses = [1.0, 3.0] }]";
    let begin = [0.0, 0.0, 3.0, 0.0, -2.0, 1.0, 1.0, 0.0];
    let all = states(&table(text), &begin, 60);
    for (frame, state) in all.iter().enumerate() {
        let time = frame as f64 / FRAMES as f64;
        let momentum = [0, 1].map(|axis| state[4 + axis] + 3.0 * state[6 + axis]);
        close(&momentum, &[1.0, 1.0 + 4.0 * 3.0 * time], 1e-9, "momentum");
        let apart = [state[2] - state[0], state[3] - state[1]];
        assert!(apart[0].hypot(apart[1]) < 4.0 + 1e-9, "frame {frame}: {apart:?}");
    }
    let last = all.last().unwrap();
    let rate = (last[2] - last[0]) * (last[6] - last[4]) + (last[3] - last[1]) * (last[7] - last[5]);
    assert!(rate.abs() < 1e-9, "the rod turns without growing: {rate}");
}

/// Where a string is fastened it has no direction: what passes there flies on.
#[test]
fn the_middle_of_a_string_is_free() {
    let text = "acceleration = \"vec(0, 0)\"\nstrings = [{ at = [0.0, 0.0], length = 10.0 }]";
    for (frame, state) in states(&table(text), &[-3.0, 0.0, 12.0, 0.0], 10).iter().enumerate() {
        close(state, &[-3.0 + 0.6 * frame as f64, 0.0, 12.0, 0.0], 1e-9, "straight on");
    }
}

/// Friction between discs turns their velocities by the tangent's impulse, of the normal one's size times the coefficient.
#[test]
fn discs_with_friction_keep_the_momentum() {
    let text = "acceleration = \"vec(0, 0)\"\n\
                contacts = { distance = 4.0, restitution = 0.5, friction = 0.1, masses = [1.0, 3.0] }";
    let begin = [-10.0, 2.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0];
    let end = states(&table(text), &begin, 60).pop().unwrap();
    let momentum = [0, 1].map(|axis| end[4 + axis] + 3.0 * end[6 + axis]);
    close(&momentum, &[5.0, 0.0], 1e-9, "momentum");
    // Along the normal (sqrt 3 / 2, -1 / 2) at contact the first loses 3/4 of 1.5 times its speed, across it a tenth of that.
    let (normal, tangent) = ([FRAC_PI_3.sin(), -0.5], [0.5, FRAC_PI_3.sin()]);
    let lost = 0.75 * 1.5 * 5.0 * normal[0];
    let expected = [0, 1].map(|axis| begin[4 + axis] - lost * normal[axis] - 0.1 * lost * tangent[axis]);
    close(&end[4..6], &expected, 1e-9, "the first");
}

/// Equations with parameters, their values, and states away from grazing impacts and from rest: tensors give the path of plain
/// numbers, and gradients are those of differences.
#[test]
fn tensors_give_the_same_path_with_gradients() {
    let parameters = "parameters.a = { low = -1.0, high = 1.0 }\nparameters.d = { unit = [1, 0] }\n\
                      parameters.e = { unit = [0, 0], low = 0.0, high = 1.0 }\nparameters.g = { unit = [1, -2] }\n\
                      parameters.y = { unit = [1, 0] }\n";
    let cases = [
        // An incline.
        (
            "surfaces = [{ line = [16.0, \"y\"], angle = \"a\", distance = \"d\", restitution = \"e\", friction = 0.1 }]",
            [0.3, 2.0, 0.7, 9.0, 24.0],
            [12.0, 12.0, 3.0, 1.0],
        ),
        // A bowl, first struck and then slid along.
        (
            "surfaces = [{ bowl = [\"a\", \"y\"], distance = \"d\", restitution = \"e\" }]",
            [0.3, 6.0, 0.01, 9.0, 8.0],
            [2.0, 7.0, 0.5, 0.5],
        ),
        // A bump.
        (
            "surfaces = [{ bump = [\"a\", \"y\"], distance = \"d\", restitution = \"e\" }]",
            [0.3, 6.0, 0.6, 9.0, 20.0],
            [2.0, 7.0, 0.5, 0.5],
        ),
        // A string that becomes taut and swings.
        (
            "strings = [{ at = [\"a\", \"y\"], length = \"d\", restitution = \"e\" }]",
            [0.3, 6.0, 0.01, 9.0, 2.0],
            [4.0, 3.0, 0.0, 0.0],
        ),
    ];
    for (constraint, values, state) in cases {
        let text = format!("acceleration = \"vec(0, g)\"\nsubsteps = 5\n{constraint}\n{parameters}");
        let kind = CellKind::of_text(&table(&text), 1).unwrap();
        let unconstrained: Vec<f64> =
            kind.parameters.iter().zip(values).map(|(it, value)| it.bounds.unconstrained(value)).collect();
        let numbers: Vec<f64> = unconstrained.iter().chain(&state).copied().collect();
        let end = |numbers: &[Tensor]| {
            let pair = |first: usize| Tensor::stack(&numbers[first..first + 2], 0).unsqueeze(0);
            let initial = State { pos: pair(5), vel: pair(7) };
            kind.cell(&numbers[..5], WALLS).roll_out(&initial, &Actions::none(), 0.2, 11).pop().unwrap()
        };
        let tensors: Vec<Tensor> = numbers.iter().map(|number| Tensor::from(*number).set_requires_grad(true)).collect();
        let found = end(&tensors);
        let equation = Arc::new(Equation::read(&kind.table().unwrap(), 1).unwrap());
        let mut plain = state.to_vec();
        let mut single = SingleEquation::new(&equation, &values, WALLS);
        (0..11).for_each(|_| single.advance(&mut plain, 0.0, 0.2));
        let rolled = Vec::<f64>::try_from(Tensor::cat(&[&found.pos, &found.vel], 1).detach().view(-1)).unwrap();
        // Sums of another order over 55 substeps.
        close(&rolled, &plain, 1e-8, constraint);
        let sum = |state: &State| (&state.pos * Tensor::from_slice(&[1.0, 2.0])).sum(Kind::Double);
        sum(&found).backward();
        for (place, tensor) in tensors.iter().enumerate() {
            let probed = |by: f64| {
                let probe = |(i, number): (usize, &f64)| Tensor::from(number + if i == place { by } else { 0.0 });
                sum(&end(&numbers.iter().enumerate().map(probe).collect::<Vec<_>>())).double_value(&[])
            };
            let difference = (probed(1e-6) - probed(-1e-6)) / 2e-6;
            let gradient = tensor.grad().double_value(&[]);
            // Central differences: rounding over the probe, and the third derivative.
            assert!(
                (gradient - difference).abs() < 1e-4 * (1.0 + difference.abs()),
                "{constraint}, {place}: {gradient} {difference}"
            );
        }
        assert!(tensors[..5].iter().all(|tensor| tensor.grad().double_value(&[]) != 0.0), "{constraint}: all show");
    }
}

/// A wall at the left by its angle is one by its name.
#[test]
fn a_line_upright_is_a_wall() {
    let wall = fall("walls = { left = 4.0 }\nrestitution = 0.5", 5);
    let line = fall(
        &format!("surfaces = [{{ line = [0.0, 0.0], angle = {FRAC_PI_2}, distance = 4.0, restitution = 0.5 }}]"),
        5,
    );
    let begin = [9.0, 0.0, -8.0, 0.0];
    let [wall, line] = [wall, line].map(|table| states(&table, &begin, 40).pop().unwrap());
    close(&line, &wall, 1e-9, "the same path");
}

#[test]
fn mistakes_are_named() {
    let parameters = "parameters.d = { unit = [1, 0] }\nparameters.e = { unit = [0, 0], low = 0.0, high = 1.0 }\n\
                      parameters.m = { unit = [0, 0], low = -1.0 }";
    for (text, objects, expected) in [
        ("surfaces = [{ angle = 0.1 }]", 1, "surfaces[1]: expected one of line, bowl and bump"),
        ("surfaces = [{ line = [0, 1], bowl = [1, 1] }]", 1, "surfaces[1]: expected one of line, bowl and bump"),
        ("surfaces = [{ bowl = [0.0, 1.0] }]", 1, "surfaces[1]: a circle needs a distance"),
        ("surfaces = [{ bowl = [0.0, 1.0], distance = 2.0, angle = 0.1 }]", 1, "surfaces[1].angle: a circle has none"),
        ("surfaces = [{ bump = [0.0, 1.0], distance = -2.0 }]", 1, "surfaces[1].distance: must be more than 0"),
        ("surfaces = [{ line = [0.0, \"q\"] }]", 1, "surfaces[1].line = \"q\": there is no such parameter"),
        ("surfaces = [{ line = [0.0, \"e\"] }]", 1, "surfaces[1].line = \"e\": has the unit [0, 0], but is a position"),
        ("surfaces = [{ line = [0.0, 1.0], angle = \"d\" }]", 1, "but is an angle in radians"),
        ("surfaces = [{ line = [0.0, nan] }]", 1, "surfaces[1].line: expected a finite number"),
        ("surfaces = [{ line = [0.0, 1.0], restitution = 2.0 }]", 1, "surfaces[1].restitution = 2: must be 0 to 1"),
        ("surfaces = [{ line = [0.0, 1.0], friction = \"m\" }]", 1, "surfaces[1].friction: must be 0 or more"),
        ("surfaces = [{ line = [0.0, 1.0], object = 2 }]", 1, "surfaces[1].object = 2: expected 1 to 1"),
        ("strings = [{ length = 3.0 }]", 1, "strings[1]: expected one of at"),
        ("strings = [{ at = [0.0, 0.0], length = 0.0 }]", 1, "strings[1].length: must be more than 0"),
        (
            "strings = [{ at = [0.0, 0.0], length = 1.0, masses = [1.0, 1.0] }]",
            1,
            "strings[1].masses: only a string between",
        ),
        ("strings = [{ between = [1, 2], length = 3.0 }]", 1, "strings[1].between = 2: expected 1 to 1"),
        ("strings = [{ between = [2, 2], length = 3.0 }]", 2, "strings[1].between: expected two objects"),
        ("strings = [{ between = [1, 2], length = 3.0, masses = [0.0, 1.0] }]", 2, "strings[1].masses: each must be"),
        ("contacts = { distance = 1.0, friction = -0.1 }", 2, "contacts.friction: must be 0 or more"),
        (
            "state = \"angle\"\nstrings = [{ at = [0.0, 0.0], length = 1.0 }]",
            1,
            "strings: there are strings for positions",
        ),
    ] {
        let acceleration = if text.contains("angle\"\n") { "0" } else { "vec(0, 0)" };
        let table = table(&format!("acceleration = \"{acceleration}\"\n{text}\n{parameters}"));
        let error = CellKind::of_text(&table, objects).err().map(|it| format!("{it:#}"));
        assert!(error.as_ref().is_some_and(|error| error.contains(expected)), "{text}: {error:?}");
    }
}
