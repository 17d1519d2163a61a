//! The pendulum's dataset: its motion against closed forms, its frames against geometry, its torques against its states.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use ndarray::{Array3, Axis};
use paig::datasets::files::Split;
use paig::generators::render::Bar;
use paig::generators::simulate::{SceneState, World};
use paig::generators::source_images::SourceImages;
use paig::generators::variant::{Changes, Variant};
use paig::generators::{Counts, generate_clips};
use paig::tasks::scene::Motion;
use paig::tasks::{self, find};

const SIDE: usize = 64;
/// Pixels in the unit of length: the frame shows 2.2 to each side of the hub.
const UNIT: f64 = SIDE as f64 / 4.4;

fn variant(changes: &Changes) -> Variant {
    Variant::new(&find("pendulum").unwrap(), 3).unwrap().with(changes).unwrap()
}

/// One time unit to a frame, in many substeps.
fn fine(changes: &Changes) -> World {
    World { dt: 1.0, substeps: 100_000, ..variant(changes).world() }
}

fn state(angle: f64, speed: f64, action: f64) -> SceneState {
    SceneState { positions: vec![angle], velocities: vec![speed], action }
}

fn run(world: &World, state: &mut SceneState, time: f64) {
    let steps = (time / world.dt * world.substeps as f64).round() as usize;
    (0..steps).for_each(|_| world.substep(state));
}

#[test]
fn energy_changes_by_the_work_of_the_torque() {
    let (g, m, length, a) = (7.0, 2.0, 0.5, 1.5);
    let changes = Changes { g: Some(g), m: Some(m), length: Some(length), a: Some(a), ..Changes::default() };
    // A rod about its end: moment of inertia m l^2 / 3, centre of mass at l / 2.
    let energy = |state: &SceneState| {
        m * (length * state.velocities[0]).powi(2) / 6.0 + m * g * length / 2.0 * state.positions[0].cos()
    };
    for torque in [-1.7, 0.0, 2.0] {
        let start = state(0.8, -1.2, torque);
        let mut end = start.clone();
        run(&fine(&changes), &mut end, 0.7);
        let work = a * torque * (end.positions[0] - start.positions[0]);
        let gained = energy(&end) - energy(&start);
        // Euler steps of 1e-5 at angular speeds of about 10: relative errors of about 1e-4.
        assert!((gained - work).abs() < 1e-3, "gained {gained}, work {work}");
    }
}

#[test]
fn small_swings_have_the_rods_period() {
    let (g, length) = (10.0_f64, 1.0);
    let period = TAU * (2.0 * length / (3.0 * g)).sqrt();
    let swing = 0.01;
    let mut state = state(PI + swing, 0.0, 0.0);
    // A quarter past a whole period the pendulum hangs down; a period that were 0.02 % off would show 0.0016 swings.
    run(&fine(&Changes::default()), &mut state, 1.25 * period);
    assert!((state.positions[0] - PI).abs() < 1e-3 * swing, "{}", state.positions[0] - PI);
}

#[test]
fn upright_tips_over_clockwise_to_the_right() {
    let mut state = state(0.1, 0.0, 0.0);
    run(&fine(&Changes::default()), &mut state, 0.5);
    assert!(state.positions[0] > 0.1 && state.velocities[0] > 0.0);
    let mut frame = vec![0; SIDE * SIDE * 3];
    let bar = Bar::new(SIDE, 1.0);
    bar.draw(FRAC_PI_2, &mut bar.canvas(), &mut frame);
    let green = |x: usize, y: usize| frame[(y * SIDE + x) * 3 + 1];
    // Half a unit is 7 px.
    assert!(
        green(32 + 7, 32) < 100 && [(32 - 7, 32), (32, 32 - 7), (32, 32 + 7)].iter().all(|&(x, y)| green(x, y) == 255)
    );
}

#[test]
fn bars_lie_where_their_angle_says() {
    let (width, hub) = (0.2, 0.05);
    for length in [1.0, 1.6] {
        let bar = Bar::new(SIDE, length);
        let mut canvas = bar.canvas();
        let mut frame = Array3::zeros((SIDE, SIDE, 3));
        for step in 0..40 {
            let angle = step as f64 * 0.37 - 5.0;
            bar.draw(angle, &mut canvas, frame.as_slice_mut().unwrap());
            // What is red but not white: the bar's 0.8 - 0.3 of full brightness, none on the hub.
            let (mut redness, mut centre) = (0.0, [0.0; 2]);
            for ((row, column), rgb) in
                frame.lanes(Axis(2)).into_iter().enumerate().map(|(i, rgb)| ((i / SIDE, i % SIDE), rgb))
            {
                let red = (f64::from(rgb[0]) - f64::from(rgb[1])) / (0.5 * 255.0);
                redness += red;
                centre[0] += red * (column as f64 + 0.5 - SIDE as f64 / 2.0);
                centre[1] += red * (row as f64 + 0.5 - SIDE as f64 / 2.0);
            }
            // A rectangle with half a disc at each end, less the hub.
            let (bar_area, hub_area) = (length * width + PI * width * width / 4.0, PI * hub * hub);
            let area = (bar_area - hub_area) * UNIT * UNIT;
            let along = bar_area * length / 2.0 / (bar_area - hub_area) * UNIT;
            // Grey levels are cut off, by half a level on the average: 0.4 % of the bar's red.
            assert!((redness / area - 1.0).abs() < 0.02, "{redness} for {area}");
            for (centre, expected) in centre.iter().zip([along * angle.sin(), -along * angle.cos()]) {
                assert!(
                    (centre / redness - expected).abs() < 0.1,
                    "angle {angle}: {} for {expected}",
                    centre / redness
                );
            }
            // The hub darkens the middle; far away all is white.
            assert!(frame[[31, 31, 0]] < 150, "{}", frame[[31, 31, 0]]);
            assert!(frame[[0, 0, 0]] == 255 && frame[[63, 63, 2]] == 255);
        }
        assert!(canvas.iter().all(|&value| value == 0.0));
    }
}

#[test]
fn clips_obey_the_equation_with_the_torques_of_the_file() {
    let counts = Counts { train: 60, valid: 2, test: 2 };
    let variant = variant(&Changes::default());
    let (dataset, states) = generate_clips(&variant, &SourceImages::original().unwrap(), 30, counts, &|_| {}).unwrap();
    let torques = dataset.actions(Split::Train).unwrap();
    assert_eq!((torques.dim(), states.train.positions.dim()), ((60, 30), (60, 30, 1)));
    assert!(torques.iter().all(|u| u.abs() <= 2.0));
    // Uniform on -2..2: mean 0, mean square 4 / 3; 1800 draws, so 5 standard errors are 0.14 each.
    let mean = torques.mean().unwrap();
    let square = torques.mapv(|u| u * u).mean().unwrap();
    assert!(mean.abs() < 0.14 && (square - 4.0 / 3.0).abs() < 0.14, "{mean} {square}");
    let (g, h) = (10.0, 0.05 / 10.0);
    let (mut widest, mut fastest) = (0.0_f64, 0.0_f64);
    for clip in 0..60 {
        let at = |array: &Array3<f32>, frame: usize| f64::from(array[[clip, frame, 0]]);
        let (mut angle, mut speed) = (at(&states.train.positions, 0), at(&states.train.velocities, 0));
        assert!(angle.abs() <= FRAC_PI_2 && speed.abs() <= 2.0);
        for frame in 0..30 {
            let (true_angle, true_speed) = (at(&states.train.positions, frame), at(&states.train.velocities, frame));
            // The initial state is rounded to float32; where the pendulum tips, that grows by exp(sqrt(15) 1.5) = 300.
            assert!(
                (angle - true_angle).abs() < 1e-4 && (speed - true_speed).abs() < 1e-3,
                "clip {clip}, frame {frame}"
            );
            (widest, fastest) = (widest.max(angle.abs()), fastest.max(speed.abs()));
            for _ in 0..10 {
                speed += (1.5 * g * angle.sin() + 3.0 * f64::from(torques[[clip, frame]])) * h;
                angle += speed * h;
            }
        }
    }
    assert!(widest > PI && fastest > 7.0 && fastest <= 8.0, "{widest} {fastest}");
}

#[test]
fn only_the_pendulum_has_actions() {
    for task in tasks::all() {
        let pendulum = matches!(task.scene.unwrap().motion, Motion::Pendulum { .. });
        assert_eq!(task.system.cell.actions, pendulum, "{}", task.name);
    }
    let changes = Changes { torque: Some(0.5), spin: Some(1.0), length: Some(1.5), ..Changes::default() };
    let [(frames, name), _] = variant(&changes).files();
    let expected = "pendulum/color_pendulum_sl14_g10_m1_l1.5_a1_u0.5_dt005_spin1.npz";
    assert_eq!((frames, name.to_str().unwrap()), (14, expected));
}
