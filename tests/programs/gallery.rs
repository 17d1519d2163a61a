//! The gallery: every task of `configs/gallery` is read, keeps what its motion conserves, and is found by the fit; and a
//! run with an equation of text goes through all programs.

use std::collections::BTreeMap;
use std::fs;

use crate::programs::{paig, run};
use crate::project::project;
use crate::random::numbers;
use paig::generators::source_images::SourceImages;
use paig::generators::variant::Variant;
use paig::generators::{Counts, generate_clips};
use paig::network::cells::{Actions, CellKind, Coordinates, PhysicalParameter, State};
use paig::tasks::Task;
use paig::tasks::scene::Motion;
use paig::training::identify::Identify;
use paig::training::identify::fit::{Fit, FitStart, Trust, fit};
use rand::Rng;
use tch::{Device, Kind, Tensor};

const CLIPS: i64 = 100;
const FRAMES: usize = 12;
/// Standard deviation of the observed positions, pixels, and of angles, radians.
const NOISE: f64 = 0.1;
const ANGLE_NOISE: f64 = 0.01;
const DOUBLE: (Kind, Device) = (Kind::Double, Device::Cpu);

fn gallery() -> BTreeMap<String, Task> {
    let folder = project("configs/gallery");
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let read = |path: std::path::PathBuf| {
        let task = paig::tasks::find(path.to_str().unwrap()).unwrap_or_else(|error| panic!("{error:#}"));
        assert_eq!(path.file_stem().unwrap().to_str().unwrap(), task.name);
        (task.name.clone(), task)
    };
    files.map(read).collect()
}

/// Numbers of variance 1 that are the same in every run.
fn normal(purpose: &str, n: usize) -> Tensor {
    numbers(11, purpose, &[CLIPS, n as i64], |random| (0..12).map(|_| random.random::<f64>() - 0.5).sum::<f64>())
}

/// The times of the frames of all clips, each of which begins at another.
fn times(dt: f64) -> Tensor {
    let (clip, frame) = (Tensor::arange(CLIPS, DOUBLE), Tensor::arange(FRAMES as i64, DOUBLE));
    (clip.unsqueeze(1) * 0.37 + frame) * dt
}

/// Raw numbers of all parameters at their truth or where they are fixed.
fn true_unconstrained(task: &Task) -> Vec<f64> {
    let unconstrained = |parameter: &PhysicalParameter| {
        let value = task.truth_of(&parameter.name).or(parameter.fixed).unwrap();
        parameter.bounds.unconstrained(value)
    };
    task.system.cell.parameters.iter().map(unconstrained).collect()
}

/// States of a roll-out with the true parameters, the first one included.
fn rolled_out(task: &Task, first: State, actions: &Actions, frames: usize) -> Vec<State> {
    let unconstrained: Vec<_> =
        true_unconstrained(task).iter().map(|unconstrained| Tensor::from(*unconstrained)).collect();
    let states = task.system.build_cell(&unconstrained).roll_out(&first, actions, task.system.dt, frames - 1);
    std::iter::once(first).chain(states).collect()
}

fn scattered(pos: (&[f64], f64), vel: (&[f64], f64)) -> State {
    State {
        pos: Tensor::from_slice(pos.0) + normal("positions", pos.0.len()) * pos.1,
        vel: Tensor::from_slice(vel.0) + normal("velocities", vel.0.len()) * vel.1,
    }
}

/// The fit of a task's equation to noisy positions, from where the task starts.
fn fitted(task: &Task, states: &[State], actions: &Actions) -> Fit {
    let seen = Tensor::stack(&states.iter().map(|state| &state.pos).collect::<Vec<_>>(), 1);
    let coordinates = seen.size()[2] as usize;
    let noise = if task.system.cell.coordinates == Coordinates::Angle { ANGLE_NOISE } else { NOISE };
    let noise = normal("noise", FRAMES * coordinates).reshape([CLIPS, FRAMES as i64, coordinates as i64]) * noise;
    let parameters = &task.system.cell.parameters;
    let unconstrained =
        parameters.iter().map(|p| p.fixed.or(p.start).map_or(0.0, |value| p.bounds.unconstrained(value)));
    // Where a pendulum hangs and where its ball is seen beside its middle cannot be told apart.
    let start = FitStart {
        unconstrained: unconstrained.collect(),
        learned: parameters.iter().map(|parameter| parameter.fixed.is_none()).collect(),
        free_offsets: false,
        states: None,
    };
    let settings = Identify { clips: CLIPS as usize, ..Identify::usual(FRAMES) };
    fit(&settings, &task.system, &(seen + noise), actions, &start, &Trust::default()).unwrap()
}

/// States around which the clips of a task begin: positions and velocities, each with its spread.
type FirstStates = (&'static [f64], f64, &'static [f64], f64);

/// States of a ball on a rod: on a circle of radius 20 about the true pivot, moving along it.
fn on_a_rod(x: f64, y: f64) -> State {
    let (angle, spin) = (normal("angle", 1) * 0.8, normal("spin", 1) * 1.5);
    let across = Tensor::cat(&[angle.cos(), -angle.sin()], 1);
    let along = Tensor::cat(&[angle.sin(), angle.cos()], 1);
    State { pos: along * 20.0 + Tensor::from_slice(&[x, y]), vel: across * spin * 20.0 }
}

#[test]
fn every_equation_of_the_gallery_is_found_from_noisy_positions() {
    let pair: FirstStates = (&[21.0, 16.0, 9.0, 16.0], 1.5, &[0.0; 4], 3.0);
    let three: FirstStates = (&[16.0, 7.0, 24.0, 21.0, 8.0, 21.0], 1.5, &[1.5, 0.0, -0.7, 1.2, -0.7, -1.2], 0.5);
    let thrown: FirstStates = (&[16.0, 16.0], 3.0, &[0.0; 2], 5.0);
    let around: BTreeMap<&str, FirstStates> = BTreeMap::from([
        ("text_spring", pair),
        ("text_damped_spring", pair),
        ("unequal_masses", pair),
        ("spring_chain", (&[8.0, 12.0, 16.0, 20.0, 24.0, 12.0], 1.5, &[0.0; 6], 3.0)),
        ("gravity_masses", three),
        ("charges", three),
        ("charge_in_a_field", thrown),
        ("constant_acceleration", thrown),
        ("mass_on_a_spring", thrown),
        ("fall_linear_drag", thrown),
        ("fall_quadratic_drag", thrown),
        ("balls_in_a_bowl", (&[9.0, 15.0, 23.0, 17.0], 1.5, &[0.0; 4], 3.0)),
        ("cart_on_a_spring", (&[10.0, 16.0], 2.0, &[0.0; 2], 2.0)),
        ("colliding_pendulums", (&[5.0, 13.0, 19.0, 16.0], 0.7, &[0.0; 4], 0.0)),
        ("lossy_bounce", thrown),
        ("bounce_on_a_floor", (&[16.0, 13.0], 3.0, &[0.0; 2], 4.0)),
        ("bounce_on_an_incline", (&[23.0, 18.0], 3.0, &[-4.0, 0.0], 2.0)),
        ("slack_pendulum", (&[21.0, 10.0], 2.0, &[0.0; 2], 2.0)),
        ("sliding_block", (&[16.0, 16.0], 3.0, &[0.0; 2], 6.0)),
        ("text_pendulum", (&[0.0], 0.9, &[0.0], 1.2)),
        ("double_pendulum", (&[30.0, 34.0, 36.0, 50.0], 0.0, &[0.0; 4], 0.0)),
        ("torricelli", (&[16.0, 10.0], 2.0, &[0.0; 2], 0.0)),
    ]);
    for (name, task) in gallery() {
        let mut first = match (name.as_str(), around.get(name.as_str())) {
            ("free_pendulum" | "damped_pendulum" | "driven_pendulum", _) => on_a_rod(32.0, 12.0),
            ("swing", _) => on_a_rod(16.0, -6.0),
            (_, Some((pos, spread, vel, speed))) => scattered((pos, *spread), (vel, *speed)),
            _ => panic!("{name}: nothing is said of its first states"),
        };
        if name == "torricelli" {
            // The float sinks with the water.
            let sinks = (first.pos.narrow(1, 1, 1) * -0.4 + 12.0).sqrt();
            first.vel = Tensor::cat(&[sinks.zeros_like(), sinks], 1);
        }
        if name == "double_pendulum" {
            let upper = on_a_rod(32.0, 16.0);
            let lower = on_a_rod(0.0, 0.0);
            // The second rod is 12 long and stands another way.
            let (arm, turn) = (lower.pos.flip([0]) * 0.6, lower.vel.flip([0]) * 0.6);
            first = State {
                pos: Tensor::cat(&[&upper.pos, &(&upper.pos + arm)], 1),
                vel: Tensor::cat(&[&upper.vel, &(&upper.vel + turn)], 1),
            };
        }
        let held =
            |cell: &CellKind| if cell.tells_time() { times(task.system.dt) } else { normal("torque", FRAMES) * 1.2 };
        let actions = Actions::new(task.system.cell.actions.then(|| held(&task.system.cell)));
        let states = rolled_out(&task, first, &actions, FRAMES);
        let fit = fitted(&task, &states, &actions);
        let found: Vec<_> = task
            .system
            .cell
            .parameters
            .iter()
            .zip(&fit.unconstrained)
            .map(|(p, unconstrained)| (p, p.bounds.value(*unconstrained)))
            .collect();
        println!(
            "{name}: {:?}, residual {:.4}",
            found.iter().map(|(p, value)| (&p.name, value)).collect::<Vec<_>>(),
            fit.residual
        );
        for (place, (parameter, value)) in found.iter().enumerate() {
            let truth = task.truth_of(&parameter.name).or(parameter.fixed).unwrap();
            // Within a few of its own standard deviations, and these are small.
            let off = (fit.unconstrained[place] - parameter.bounds.unconstrained(truth)).abs();
            assert!(
                off <= 5.0 * fit.deviations[place] + 1e-3,
                "{name}: {} = {value}, true {truth}, {off} off",
                parameter.name
            );
            assert!(
                fit.deviations[place] < 0.2,
                "{name}: {} is found to within {}",
                parameter.name,
                fit.deviations[place]
            );
        }
    }
}

/// The rods of the pendulums that are written in positions keep their lengths, and what moves without friction its energy.
#[test]
fn pendulums_by_positions_keep_their_rods_and_their_energy() {
    let tasks = gallery();
    let pick = |x: &Tensor, object: i64| x.narrow(1, 2 * object, 2);
    let dot = |a: &Tensor, b: &Tensor| (a * b).sum_dim_intlist([1i64].as_slice(), false, None);
    let changed = |a: &Tensor, b: &Tensor| (a / b - 1.0).abs().max().double_value(&[]);
    for name in ["free_pendulum", "damped_pendulum"] {
        let states = rolled_out(&tasks[name], on_a_rod(32.0, 12.0), &Actions::none(), 40);
        let pivot = Tensor::from_slice(&[32.0, 12.0]);
        let rod = |state: &State| dot(&(&state.pos - &pivot), &(&state.pos - &pivot));
        let change = changed(&rod(states.last().unwrap()), &rod(&states[0]));
        // Fourth order: (g / length) h^2 is 2e-3, squared, over 200 steps.
        assert!(change < 1e-2, "{name}: the rod's squared length changed by {change}");
        let energy = |state: &State| dot(&state.vel, &state.vel) / 2.0 - state.pos.select(1, 1) * 120.0;
        let changes = energy(states.last().unwrap()) - energy(&states[0]);
        let change = changes.max().double_value(&[]);
        if name == "free_pendulum" {
            let change = changes.abs().max().double_value(&[]);
            assert!(change < 5.0, "the energy changed by {change} of some 2000");
        } else {
            assert!(change < 0.0, "friction takes energy, but it grew by {change}");
        }
    }
    let (upper, lower) = (on_a_rod(32.0, 16.0), on_a_rod(0.0, 0.0));
    let first = State {
        pos: Tensor::cat(&[&upper.pos, &(&upper.pos + lower.pos.flip([0]) * 0.6)], 1),
        vel: Tensor::cat(&[&upper.vel, &(&upper.vel + lower.vel.flip([0]) * 0.6)], 1),
    };
    let states = rolled_out(&tasks["double_pendulum"], first, &Actions::none(), 12);
    let [begin, end] = [&states[0], states.last().unwrap()];
    let arm = |state: &State| pick(&state.pos, 1) - pick(&state.pos, 0);
    let rod = |state: &State| pick(&state.pos, 0) - Tensor::from_slice(&[32.0, 16.0]);
    for (what, of) in [("first", &rod as &dyn Fn(&State) -> Tensor), ("second", &arm)] {
        let change = changed(&dot(&of(end), &of(end)), &dot(&of(begin), &of(begin)));
        assert!(change < 1e-2, "the {what} rod's squared length changed by {change}");
    }
    let energy = |state: &State| {
        let of = |object: i64, mass: f64| {
            let (pos, vel) = (pick(&state.pos, object), pick(&state.vel, object));
            (dot(&vel, &vel) / 2.0 - pos.select(1, 1) * 120.0) * mass
        };
        of(0, 1.0) + of(1, 0.5)
    };
    let change = (energy(end) - energy(begin)).abs().max().double_value(&[]);
    assert!(change < 20.0, "the energy changed by {change} of some 4000");
}

/// Where a scene moves by the equation, its clips obey it.
#[test]
fn clips_of_the_gallery_move_by_their_equations() {
    let mut checked = 0;
    for (name, task) in gallery() {
        if task.scene.as_ref().is_none_or(|scene| scene.motion != Motion::Equation {}) {
            continue;
        }
        let variant = Variant::new(&task, 5).unwrap();
        let counts = Counts { train: 4, valid: 1, test: 1 };
        let images = SourceImages::original().unwrap();
        let (_, states) = generate_clips(&variant, &images, FRAMES, counts, &|_| {}).unwrap();
        assert_eq!(
            states.truth,
            Some(task.truth.iter().map(|parameter| parameter.value).collect::<Vec<_>>()),
            "{name}"
        );
        let tensor = |array: &ndarray::Array3<f32>| {
            let shape: Vec<i64> = array.shape().iter().map(|&n| n as i64).collect();
            Tensor::from_slice(array.as_slice().unwrap()).to_kind(tch::Kind::Double).reshape(shape)
        };
        let (pos, vel) = (tensor(&states.train.positions), tensor(&states.train.velocities));
        let first = State { pos: pos.select(1, 0), vel: vel.select(1, 0) };
        for (frame, state) in (0..).zip(rolled_out(&task, first, &Actions::none(), FRAMES)) {
            let error = (pos.select(1, frame) - state.pos).abs().max().double_value(&[]);
            // The clips are integrated by a better method: Euler's error is of the order of h times the speed's change.
            assert!(error < 0.7, "{name}, frame {frame}: {error} px off");
        }
        checked += 1;
    }
    assert!(checked >= 10, "only {checked} tasks move by their equation");
}

#[test]
fn every_task_of_the_gallery_stands_in_the_guide() {
    let guide = fs::read_to_string(project("docs/equations.md")).unwrap();
    for (name, task) in gallery() {
        assert!(guide.contains(&format!("gallery/{name}.toml")), "{name}: {}", task.summary());
    }
    assert!(gallery().len() >= 12);
}

/// What makes a training take seconds.
const SHORT: [&str; 10] = [
    "discover.frames=6",
    "discover.max_steps=4",
    "discover.guide.full_until=2",
    "discover.guide.zero_from=4",
    "identify.clips=4",
    "identify.max_iterations=2",
    "join.batch=2",
    "join.max_steps=2",
    "join.validation_clips=2",
    "output.examples=1",
];

#[test]
fn a_program_shows_the_place_of_a_mistake() {
    let folder = tempfile::tempdir().unwrap();
    let task = project("configs/gallery/text_spring.toml");
    let wrong = fs::read_to_string(task).unwrap().replace("norm(p - q)", "norm(p - w)");
    fs::write(folder.path().join("wrong.toml"), wrong).unwrap();
    let output = paig("train").current_dir(folder.path()).args(["--task", "wrong.toml"]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let expected = "acceleration: column 23: units [1, 0] and [1, -1] (powers of length and time) cannot be put together\n  \
                    others(-k * (norm(p - w) - 2*l) * unit(p - q))\n                        ^\n";
    assert!(said.starts_with("error: task file wrong.toml") && said.ends_with(expected), "{said}");
}

#[test]
fn a_run_with_an_equation_of_text_goes_through_all_programs() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let file = project("configs/gallery/text_damped_spring.toml");
    fs::copy(file, folder.join("task.toml")).unwrap();
    run(folder, "generate", &["--task", "task.toml", "--train", "12", "--valid", "4", "--test", "3"]);
    let set = SHORT.iter().flat_map(|assignment| ["--set", assignment]);
    let arguments = ["--task", "task.toml", "--threads", "1", "--set", "start.k=2.0"];
    run(folder, "train", &arguments.into_iter().chain(set).collect::<Vec<_>>());

    // From here on the run's folder stands alone.
    fs::remove_file(folder.join("task.toml")).unwrap();
    let of_run = "runs/text_damped_spring/fast/seed=0";
    let config = fs::read_to_string(folder.join(of_run).join("config.toml")).unwrap();
    assert!(config.contains("norm(p - q)"), "{config}");
    run(folder, "evaluate", &[of_run]);
    run(folder, "predict", &[of_run, "--frames", "15", "--out", "prediction"]);
    run(folder, "report", &["runs", "--out", "report"]);
    assert!(fs::read_to_string(folder.join("report/report.md")).unwrap().contains("text_damped_spring"));
    let summary = fs::read_to_string(folder.join(of_run).join("summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
    assert_eq!(summary["parameters"]["c"]["truth"], 0.3);
    fs::remove_file(folder.join(of_run).join("summary.json")).unwrap();
    run(folder, "train", &["--resume", "--out", of_run]);
    assert!(folder.join(of_run).join("summary.json").exists());
}
