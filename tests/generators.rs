//! The generators: frames against stored skimage output, motion against closed forms, rules, and determinism.

use std::f64::consts::TAU;
use std::path::Path;

use ndarray::{Array3, Array4, Axis, s};
use ndarray_npy::NpzReader;
use paig::datasets::files::Split;
use paig::datasets::generators::{Counts, generate_clips};
use paig::datasets::render::{Balls, Digits, Scratch};
use paig::datasets::scene::Motion;
use paig::datasets::simulate::{State, World};
use paig::datasets::sprites::Sprites;
use paig::datasets::variant::{Changes, Variant};
use paig::tasks::{TASKS, find};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

const COUNTS: Counts = Counts { train: 40, valid: 3, test: 5 };

fn variant(key: &str) -> Variant {
    Variant::new(find(key).unwrap(), 0)
}

fn scene_positions(positions: &Array3<f64>, scene: usize) -> Vec<[f64; 2]> {
    positions.index_axis(Axis(0), scene).rows().into_iter().map(|row| [row[0], row[1]]).collect()
}

fn largest_difference(frame: &[u8], expected: &[u8]) -> u8 {
    assert_eq!(frame.len(), expected.len());
    frame.iter().zip(expected).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

/// Frames from tests/data/make_skimage_render.py. Returns the largest difference in grey levels.
fn compare_with_skimage(name: &str, mut draw: impl FnMut(&[[f64; 2]], &mut [u8])) -> u8 {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/skimage_render.npz");
    let mut npz = NpzReader::new(std::fs::File::open(path).unwrap()).unwrap();
    let positions: Array3<f64> = npz.by_name(&format!("{name}_positions")).unwrap();
    let frames: Array4<u8> = npz.by_name(&format!("{name}_frames")).unwrap();
    let mut frame = vec![0; frames.len() / frames.dim().0];
    let differences = (0..frames.dim().0).map(|scene| {
        draw(&scene_positions(&positions, scene), &mut frame);
        largest_difference(&frame, frames.index_axis(Axis(0), scene).as_slice().unwrap())
    });
    let largest = differences.max().unwrap();
    println!("{name}: largest difference to skimage {largest} grey levels");
    largest
}

#[test]
fn balls_equal_skimage_within_a_grey_level() {
    for side in [32, 36] {
        let balls = Balls::new(side, 2.0);
        let mut scratch = Scratch::default();
        let name = format!("balls_{side}");
        assert!(compare_with_skimage(&name, |positions, frame| balls.draw(positions, &mut scratch, frame)) <= 1);
        assert!(compare_with_skimage(&name, |positions, frame| balls.draw_whole(positions, frame)) <= 1);
    }
}

#[test]
fn digits_equal_skimage_within_two_grey_levels() {
    let digits = Digits::new(64, &Sprites::original().unwrap()).unwrap();
    let mut scratch = Scratch::default();
    assert!(compare_with_skimage("digits", |positions, frame| digits.draw(positions, &mut scratch, frame)) <= 2);
    assert!(compare_with_skimage("digits", |positions, frame| digits.draw_whole(positions, frame)) <= 2);
}

#[test]
fn quick_drawing_equals_drawing_the_whole_canvas() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut point = |side: f64| [rng.random_range(-1.0..side + 1.0), rng.random_range(-1.0..side + 1.0)];
    // 12 pixels are less than a ball's patch; 2.45 is no whole number of canvas pixels.
    for (side, radius) in [(32, 2.0), (36, 2.45), (12, 2.0)] {
        let balls = Balls::new(side, radius);
        let (mut quick, mut whole) = (vec![0; side * side * 3], vec![0; side * side * 3]);
        let mut scratch = Scratch::default();
        for _ in 0..100 {
            let positions = [point(side as f64), point(side as f64), point(side as f64)];
            balls.draw(&positions, &mut scratch, &mut quick);
            balls.draw_whole(&positions, &mut whole);
            assert_eq!(quick, whole, "side {side}, radius {radius}, {positions:?}");
        }
    }
    let digits = Digits::new(64, &Sprites::original().unwrap()).unwrap();
    let (mut quick, mut whole) = (vec![0; 64 * 64 * 3], vec![0; 64 * 64 * 3]);
    let mut scratch = Scratch::default();
    for _ in 0..15 {
        let positions = [point(64.0), point(64.0)];
        digits.draw(&positions, &mut scratch, &mut quick);
        digits.draw_whole(&positions, &mut whole);
        assert_eq!(quick, whole, "{positions:?}");
    }
}

#[test]
fn ball_colours_follow_the_order_of_objects() {
    let (dataset, states) = generate_clips(&variant("3bp_color"), &Sprites::original().unwrap(), 3, COUNTS).unwrap();
    for (clip, frames) in dataset.train.outer_iter().enumerate() {
        for body in 0..3 {
            let (x, y) = (states.train.positions[[clip, 2, 2 * body]], states.train.positions[[clip, 2, 2 * body + 1]]);
            let pixel = frames.slice(s![2, y as usize, x as usize, ..]);
            assert!(pixel[2 - body] > 200, "body {body} of clip {clip}: {pixel}");
        }
    }
}

/// A wide box without rules in the way, at many substeps.
fn free_world(motion: Motion) -> World {
    World {
        motion,
        speed: [0.0; 2],
        radius: 2.0,
        wall_margin: 2.0,
        side: 1000.0,
        dt: 1.0,
        substeps: 100_000,
        pane_frames: 0,
    }
}

fn run(world: &World, state: &mut State, time: f64) {
    let steps = (time / world.dt * world.substeps as f64).round() as usize;
    (0..steps).for_each(|_| world.substep(state));
}

#[test]
fn spring_follows_the_harmonic_solution() {
    let (k, equil) = (4.0, 6.0);
    let world = free_world(Motion::Spring { k, equil, half_pane: false });
    let (stretch, closing, drift) = (3.0, -1.5, [0.7, -0.2]);
    let direction = [0.6, 0.8];
    // Separation 2 equil + stretch, changing at the speed `closing`, centre of mass drifting.
    let at = |half: f64, centre: [f64; 2]| [centre[0] + half * direction[0], centre[1] + half * direction[1]];
    let half = (2.0 * equil + stretch) / 2.0;
    let mut state = State {
        positions: vec![at(half, [500.0; 2]), at(-half, [500.0; 2])],
        velocities: vec![at(closing / 2.0, drift), at(-closing / 2.0, drift)],
    };
    let (time, omega) = (2.7, (2.0 * k).sqrt());
    run(&world, &mut state, time);
    let separation = 2.0 * equil + stretch * (omega * time).cos() + closing / omega * (omega * time).sin();
    let centre = [500.0 + drift[0] * time, 500.0 + drift[1] * time];
    for (position, expected) in
        state.positions.iter().zip([at(separation / 2.0, centre), at(-separation / 2.0, centre)])
    {
        for axis in 0..2 {
            assert!((position[axis] - expected[axis]).abs() < 1e-3, "{position:?} for {expected:?}");
        }
    }
}

#[test]
fn three_bodies_circle_in_the_closed_form_period() {
    let (g, distance) = (60.0, 9.0);
    let world = free_world(Motion::ThreeBodies { g, m: 1.0 });
    // Equilateral triangle: each body is pulled to the centre with g / (sqrt(3) distance^2).
    let speed = (g / (3.0_f64.sqrt() * distance)).sqrt();
    let angles = [0.1, 0.1 + TAU / 3.0, 0.1 + 2.0 * TAU / 3.0];
    let start = State {
        positions: angles.iter().map(|a| [500.0 + distance * a.cos(), 500.0 + distance * a.sin()]).collect(),
        velocities: angles.iter().map(|a| [-speed * a.sin(), speed * a.cos()]).collect(),
    };
    let mut state = start.clone();
    run(&world, &mut state, TAU * distance / speed);
    for (end, begin) in state.positions.iter().zip(&start.positions) {
        assert!((end[0] - begin[0]).hypot(end[1] - begin[1]) < 0.01, "{end:?} for {begin:?}");
    }
}

#[test]
fn bouncing_balls_follow_the_triangle_wave() {
    let world = World { side: 32.0, ..free_world(Motion::Bouncing) };
    let mut state = State { positions: vec![[5.0, 20.0]; 2], velocities: vec![[-7.0, 3.0], [4.0, -11.0]] };
    let start = state.clone();
    let time = 9.5;
    run(&world, &mut state, time);
    for ball in 0..2 {
        for axis in 0..2 {
            let path = start.positions[ball][axis] - 2.0 + start.velocities[ball][axis] * time;
            let folded = path.rem_euclid(56.0);
            let expected = 2.0 + folded.min(56.0 - folded);
            assert!((state.positions[ball][axis] - expected).abs() < 1e-6);
        }
    }
}

/// Clips with every substep of a task's motion as a frame of its own, so that rules are checked at all of them.
fn clips_by_substep(key: &str, frames: usize) -> Vec<Vec<State>> {
    let world = variant(key).world();
    let fine = World {
        dt: world.dt / world.substeps as f64,
        substeps: 1,
        pane_frames: (world.pane_frames - 1) * world.substeps + 1,
        ..world
    };
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    (0..40).map(|_| fine.clip((frames - 1) * world.substeps + 1, &mut rng).unwrap()).collect()
}

#[test]
fn no_object_touches_a_wall() {
    for task in TASKS.iter().filter(|task| task.key != "bouncing_balls") {
        for clip in clips_by_substep(task.key, task.train_frames) {
            let far = task.side as f64 - 2.0;
            assert!(clip.iter().flat_map(|state| state.positions.iter().flatten()).all(|&x| x > 2.0 && x < far));
        }
    }
}

#[test]
fn half_pane_keeps_balls_left_during_input_and_prediction_only() {
    let clips = clips_by_substep("spring_color_half", 30);
    let right = |state: &State| state.positions.iter().any(|position| position[0] >= 14.0);
    assert!(clips.iter().all(|clip| !clip[..9 * 10 + 1].iter().any(right)));
    assert!(clips.iter().any(|clip| clip[9 * 10 + 1..].iter().any(right)));
}

#[test]
fn three_bodies_stay_apart() {
    for clip in clips_by_substep("3bp_color", 20) {
        for state in &clip {
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                let (p, q) = (state.positions[a], state.positions[b]);
                assert!((p[0] - q[0]).hypot(p[1] - q[1]) > 3.0);
            }
        }
    }
}

#[test]
fn clips_that_cannot_be_are_an_error() {
    let changes = Changes { vx: Some(30.0), vy: Some(30.0), k: Some(0.0), ..Changes::default() };
    let variant = variant("spring_color").with(&changes).unwrap();
    let error = variant.world().clip(30, &mut ChaCha8Rng::seed_from_u64(0)).unwrap_err().to_string();
    assert!(error.contains("lower the speed"), "{error}");
}

fn first_states(key: &str) -> Vec<State> {
    let world = variant(key).world();
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    (0..500).map(|_| world.clip(2, &mut rng).unwrap().remove(0)).collect()
}

fn speed(velocity: [f64; 2]) -> f64 {
    velocity[0].hypot(velocity[1])
}

#[test]
fn bouncing_balls_start_anywhere_at_full_speed() {
    let states = first_states("bouncing_balls");
    assert!(states.iter().all(|state| state.velocities.iter().all(|&v| (speed(v) - 8.0).abs() < 1e-9)));
    let coordinates: Vec<f64> = states.iter().flat_map(|state| state.positions.iter().flatten().copied()).collect();
    assert!(coordinates.iter().all(|x| (2.0..=30.0).contains(x)));
    // Uniform on 2..30: mean 16, standard deviation 28 / sqrt(12) = 8.08; 2000 draws.
    let mean = coordinates.iter().sum::<f64>() / coordinates.len() as f64;
    let spread = (coordinates.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / coordinates.len() as f64).sqrt();
    assert!((mean - 16.0).abs() < 0.8 && (spread - 8.08).abs() < 0.4, "mean {mean}, spread {spread}");
}

#[test]
fn springs_start_within_the_stated_ranges() {
    for (key, equil, side, border) in [("spring_color", 6.0, 32.0, 8.0), ("mnist_spring_color", 12.0, 64.0, 23.0)] {
        for state in first_states(key) {
            let (p, q) = (state.positions[0], state.positions[1]);
            let separation = (p[0] - q[0]).hypot(p[1] - q[1]);
            assert!((equil..3.0 * equil).contains(&separation), "{separation}");
            assert!((0..2).all(|axis| (border..side - border).contains(&((p[axis] + q[axis]) / 2.0))));
            assert!(state.velocities.iter().all(|&v| (speed(v) - 8.0).abs() < 1e-9));
        }
    }
}

#[test]
fn three_bodies_start_on_a_circle() {
    let mut senses = [0, 0];
    for state in first_states("3bp_color") {
        let polar: Vec<(f64, f64)> = state
            .positions
            .iter()
            .map(|p| ((p[0] - 18.0).hypot(p[1] - 18.0), (p[1] - 18.0).atan2(p[0] - 18.0)))
            .collect();
        assert!(polar.iter().all(|&(distance, _)| (distance - polar[0].0).abs() < 1e-9));
        assert!((6.75..11.25).contains(&polar[0].0));
        for body in 1..3 {
            let gap = (polar[body].1 - polar[0].1 - body as f64 * TAU / 3.0 + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
            assert!(gap.abs() <= 0.25, "{gap}");
        }
        // Tangential speed 2 in one sense, plus one drift for all.
        let residual = |turn: f64| {
            let drift = |body: usize| {
                let tangent = polar[body].1 + turn;
                let v = state.velocities[body];
                [v[0] - 2.0 * tangent.cos(), v[1] - 2.0 * tangent.sin()]
            };
            let first = drift(0);
            let common = (1..3).all(|body| (drift(body)[0] - first[0]).hypot(drift(body)[1] - first[1]) < 1e-9);
            common && first.iter().all(|d| d.abs() <= 0.5)
        };
        let sense = [residual(TAU / 4.0), residual(-TAU / 4.0)];
        assert_ne!(sense[0], sense[1]);
        senses[usize::from(sense[1])] += 1;
    }
    assert!(senses.iter().all(|&count| count > 150), "{senses:?}");
}

#[test]
fn clips_depend_on_seed_split_and_index_only() {
    let sprites = Sprites::original().unwrap();
    for key in ["spring_color", "mnist_spring_color"] {
        let with_threads = |threads: usize, counts: Counts, seed: u64| {
            let variant = Variant::new(find(key).unwrap(), seed);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| generate_clips(&variant, &sprites, 4, counts)).unwrap()
        };
        let (dataset, states) = with_threads(1, COUNTS, 0);
        let (same_dataset, same_states) = with_threads(3, COUNTS, 0);
        assert_eq!((&same_dataset, &same_states), (&dataset, &states));
        let (larger, _) = with_threads(3, Counts { train: 50, ..COUNTS }, 0);
        assert_eq!(larger.train.slice(s![..40, .., .., .., ..]), dataset.train);
        assert_ne!(with_threads(1, COUNTS, 1).0.train, dataset.train);
        let first = |split: Split| dataset.split(split).index_axis(Axis(0), 0).to_owned();
        assert_ne!(first(Split::Train), first(Split::Valid));
        assert_ne!(first(Split::Valid), first(Split::Test));
    }
}

#[test]
fn states_are_those_of_the_frames() {
    let (dataset, states) =
        generate_clips(&variant("spring_color"), &Sprites::original().unwrap(), 12, COUNTS).unwrap();
    for (clip, frames) in dataset.train.outer_iter().enumerate() {
        for (index, frame) in frames.outer_iter().enumerate() {
            for ball in 0..2 {
                // Centre of the ball's light, pixel centres at half-integers; canvas pixels are cut off to 0.1.
                let plane = frame.index_axis(Axis(2), 2 - ball);
                let (mut light, mut centre) = (0.0, [0.0; 2]);
                for ((row, column), &value) in plane.indexed_iter() {
                    light += f64::from(value);
                    centre[0] += f64::from(value) * (column as f64 + 0.5);
                    centre[1] += f64::from(value) * (row as f64 + 0.5);
                }
                for (axis, centre) in centre.iter().enumerate() {
                    let truth = f64::from(states.train.positions[[clip, index, 2 * ball + axis]]);
                    let off = centre / light - truth;
                    // At a border the mirrored blur pulls the light inwards.
                    let slack = if (5.0..27.0).contains(&truth) { 0.12 } else { 0.3 };
                    assert!(off.abs() < slack, "clip {clip}, frame {index}, ball {ball}: {off}");
                }
            }
        }
    }
}

#[test]
fn file_names_are_the_authors_unless_numbers_change() {
    for task in TASKS {
        let variant = Variant::new(task, 3);
        assert_eq!(variant.file(task.train_frames), Path::new(task.train_file));
        assert_eq!(variant.file(task.test_frames), Path::new(task.test_file));
    }
    let changes = Changes {
        k: Some(2.5),
        vx: Some(4.0),
        dt: Some(0.15),
        size: Some(40),
        substeps: Some(20),
        ..Changes::default()
    };
    let variant = variant("spring_color").with(&changes).unwrap();
    let expected = "spring_color/color_spring_vx4_vy8_sl12_r2_k2.5_e6_dt015_size40_substeps20.npz";
    assert_eq!(variant.file(12), Path::new(expected));
}

#[test]
fn numbers_a_task_lacks_are_refused() {
    let k = Changes { k: Some(1.0), ..Changes::default() };
    let g = Changes { g: Some(1.0), ..Changes::default() };
    let radius = Changes { radius: Some(3.0), ..Changes::default() };
    for (key, changes, flag) in [
        ("bouncing_balls", k, "--k"),
        ("3bp_color", k, "--k"),
        ("spring_color", g, "--g"),
        ("mnist_spring_color", radius, "--radius"),
    ] {
        let error = variant(key).with(&changes).unwrap_err().to_string();
        assert!(error.contains(flag) && error.contains(key), "{error}");
    }
    for (changes, complaint) in [
        (Changes { k: Some(f64::NAN), ..Changes::default() }, "--k must be at least 0"),
        (Changes { substeps: Some(0), ..Changes::default() }, "--substeps"),
        (Changes { size: Some(4), ..Changes::default() }, "--size"),
        (Changes { equil: Some(20.0), ..Changes::default() }, "do not fit"),
        (Changes { vx: Some(1e6), ..Changes::default() }, "a substep"),
    ] {
        let error = variant("spring_color").with(&changes).unwrap_err().to_string();
        assert!(error.contains(complaint), "{error}");
    }
}
