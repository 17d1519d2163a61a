//! The generators: frames against stored skimage output, motion against closed forms, rules, and determinism.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use ndarray::{Array3, Array4, ArrayView3, Axis, s};
use ndarray_npy::NpzReader;
use paig::datasets::files::{DatasetFile, Split};
use paig::datasets::states::States;
use paig::evaluation::ScoredClips;
use paig::generators::render::{Balls, Overlay};
use paig::generators::simulate::{SceneState, World};
use paig::generators::source_images::SourceImages;
use paig::generators::variant::{Changes, Variant};
use paig::generators::{Counts, DatasetJob, generate, generate_clips};
use paig::tasks::looks::ObjectLooks;
use paig::tasks::scene::{Background, Motion};
use paig::tasks::{self, Task, find};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tch::Device;

const COUNTS: Counts = Counts { train: 40, valid: 3, test: 5 };

fn variant(name: &str) -> Variant {
    Variant::new(&find(name).unwrap(), 0).unwrap()
}

/// Clips with the original's pictures.
fn clips(variant: &Variant, frames: usize, counts: Counts) -> (DatasetFile, States) {
    generate_clips(variant, &SourceImages::original().unwrap(), frames, counts, &|_| {}).unwrap()
}

fn scene_positions(positions: &Array3<f64>, scene: usize) -> Vec<[f64; 2]> {
    positions.index_axis(Axis(0), scene).rows().into_iter().map(|row| [row[0], row[1]]).collect()
}

fn largest_difference(frame: &[u8], expected: &[u8]) -> u8 {
    assert_eq!(frame.len(), expected.len());
    frame.iter().zip(expected).map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

fn picture(images: &SourceImages) -> ArrayView3<'_, u8> {
    images.pictures.index_axis(Axis(0), 0)
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
        let balls = Balls::new(side, 2.0, 3);
        let name = format!("balls_{side}");
        assert!(compare_with_skimage(&name, |positions, frame| balls.draw(positions, frame)) <= 1);
        assert!(compare_with_skimage(&name, |positions, frame| balls.draw_whole(positions, frame)) <= 1);
    }
}

#[test]
fn digits_equal_skimage_within_two_grey_levels() {
    let images = SourceImages::original().unwrap();
    let digits = Overlay::digits(64, &images);
    let backdrop = digits.backdrop(picture(&images));
    let mut canvas = backdrop.canvas.clone();
    let mut draw = |positions: &[[f64; 2]], frame: &mut [u8]| digits.draw(positions, &backdrop, &mut canvas, frame);
    assert!(compare_with_skimage("digits", &mut draw) <= 2);
    assert!(compare_with_skimage("digits", |positions, frame| digits.draw_whole(positions, &backdrop, frame)) <= 2);
}

#[test]
fn quick_drawing_equals_drawing_the_whole_canvas() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut point = |side: f64| [rng.random_range(-1.0..side + 1.0), rng.random_range(-1.0..side + 1.0)];
    // 12 pixels are less than a ball's patch; 2.45 is no whole number of canvas pixels.
    for (side, radius) in [(32, 2.0), (36, 2.45), (12, 2.0)] {
        let balls = Balls::new(side, radius, 3);
        let (mut quick, mut whole) = (vec![0; side * side * 3], vec![0; side * side * 3]);
        for _ in 0..100 {
            let positions = [point(side as f64), point(side as f64), point(side as f64)];
            balls.draw(&positions, &mut quick);
            balls.draw_whole(&positions, &mut whole);
            assert_eq!(quick, whole, "side {side}, radius {radius}, {positions:?}");
        }
    }
    let images = SourceImages::original().unwrap();
    let balls = |radius, channels, balls| Overlay::balls(64, radius, channels, balls, &ObjectLooks::default());
    for overlay in [Overlay::digits(64, &images), balls(2.45, 3, 2), balls(3.0, 1, 1)] {
        let backdrop = overlay.backdrop(picture(&images));
        let mut canvas = backdrop.canvas.clone();
        // As many channels as the canvas has planes, 5 or 10 times as large as the frame.
        let channels = if canvas.len().is_multiple_of(3) { 3 } else { 1 };
        let (mut quick, mut whole) = (vec![0; 64 * 64 * channels], vec![0; 64 * 64 * channels]);
        for _ in 0..15 {
            let positions = [point(64.0), point(64.0)];
            overlay.draw(&positions, &backdrop, &mut canvas, &mut quick);
            overlay.draw_whole(&positions, &backdrop, &mut whole);
            assert_eq!(quick, whole, "{positions:?}");
        }
        assert_eq!(canvas, backdrop.canvas);
    }
}

#[test]
fn ball_colours_follow_the_order_of_objects() {
    let (dataset, states) = clips(&variant("3bp_color"), 3, COUNTS);
    for (clip, frames) in dataset.train.outer_iter().enumerate() {
        for body in 0..3 {
            let (x, y) = (states.train.positions[[clip, 2, 2 * body]], states.train.positions[[clip, 2, 2 * body + 1]]);
            let pixel = frames.slice(s![2, y as usize, x as usize, ..]);
            assert!(pixel[2 - body] > 200, "body {body} of clip {clip}: {pixel}");
        }
    }
}

/// A wide box without rules in the way, at many substeps.
fn free_world(motion: Motion, objects: usize) -> World {
    World {
        motion,
        law: None,
        objects,
        speed: [0.0; 2],
        radius: 2.0,
        wall_margin: 2.0,
        side: 1000.0,
        dt: 1.0,
        substeps: 100_000,
        pane_frames: 0,
    }
}

fn run(world: &World, state: &mut SceneState, time: f64) {
    let steps = (time / world.dt * world.substeps as f64).round() as usize;
    (0..steps).for_each(|_| world.substep(state));
}

#[test]
fn spring_follows_the_harmonic_solution() {
    let (k, equil) = (4.0, 6.0);
    let (stretch, closing, drift) = (3.0, -1.5, [0.7, -0.2]);
    let direction = [0.6, 0.8];
    // Separation 2 equil + stretch, changing at the speed `closing`, centre of mass drifting.
    let at = |half: f64, centre: [f64; 2]| [centre[0] + half * direction[0], centre[1] + half * direction[1]];
    let half = (2.0 * equil + stretch) / 2.0;
    for damping in [0.0, 0.4] {
        let world = free_world(Motion::Spring { k, equil, half_pane: false, damping }, 2);
        let mut state = SceneState::in_plane(
            vec![at(half, [500.0; 2]), at(-half, [500.0; 2])],
            vec![at(closing / 2.0, drift), at(-closing / 2.0, drift)],
        );
        let start_energy = spring_energy(&state, k, equil);
        let time: f64 = 2.7;
        run(&world, &mut state, time);
        // The stretch s obeys s'' = -2 k s - damping s', the centre of mass v' = -damping v.
        let (decay, omega) = ((-damping * time / 2.0).exp(), (2.0 * k - damping * damping / 4.0).sqrt());
        let swing = (closing + damping * stretch / 2.0) / omega;
        let separation = 2.0 * equil + decay * (stretch * (omega * time).cos() + swing * (omega * time).sin());
        let drifted = if damping == 0.0 { time } else { (1.0 - (-damping * time).exp()) / damping };
        let centre = drift.map(|speed| 500.0 + speed * drifted);
        for (position, expected) in
            state.points().iter().zip([at(separation / 2.0, centre), at(-separation / 2.0, centre)])
        {
            for axis in 0..2 {
                assert!((position[axis] - expected[axis]).abs() < 1e-3, "{position:?} for {expected:?}");
            }
        }
        // Half the energy of a swing is kinetic: the whole falls nearly as exp(-damping t); without damping it stays.
        let kept = spring_energy(&state, k, equil) / start_energy;
        let expected = (-damping * time).exp();
        assert!((kept - expected).abs() < if damping == 0.0 { 1e-4 } else { 0.05 }, "{kept} for {expected}");
    }
}

/// Kinetic energy and that of the spring.
fn spring_energy(state: &SceneState, k: f64, equil: f64) -> f64 {
    let (p, q) = (state.points()[0], state.points()[1]);
    let stretch = (p[0] - q[0]).hypot(p[1] - q[1]) - 2.0 * equil;
    (state.velocities.iter().map(|v| v * v).sum::<f64>() + k * stretch * stretch) / 2.0
}

#[test]
fn damping_is_told_apart() {
    let damped = |damping| variant("spring_color").with(&Changes { damping: Some(damping), ..Changes::default() });
    let expected = "spring_color/color_spring_vx8_vy8_sl12_r2_k4_e6_damping0.05.npz";
    assert_eq!(damped(0.05).unwrap().files()[0], (12, PathBuf::from(expected)));
    let counts = Counts { train: 1, valid: 1, test: 1 };
    let made = |variant: &Variant| clips(variant, 2, counts);
    let (frames, states) = made(&variant("spring_color"));
    // Word for word what files made before there was any damping hold: they stay valid.
    assert_eq!(
        states.settings.text(),
        "generator 1, task spring_color, seed 0, clips 1+1+1 of 2 frames, side 32, dt 0.3, substeps 10, Scene { motion: \
         Spring { k: 4.0, equil: 6.0, half_pane: false }, speed: [8.0, 8.0], radius: 2.0, look: Balls }"
    );
    assert_eq!(made(&damped(0.0).unwrap()), (frames, states));
    assert!(made(&damped(0.05).unwrap()).1.settings.text().contains("half_pane: false, damping: 0.05 }"));
}

#[test]
fn the_truth_of_changed_scenes_is_what_the_model_should_find() {
    let truth = |task: &str, changes: Changes| variant(task).with(&changes).unwrap().truth();
    let plain = Changes::default();
    for task in tasks::all() {
        let table: Vec<_> = task.truth.iter().map(|parameter| parameter.value).collect();
        assert_eq!(truth(&task.name, plain), table, "{}", task.name);
    }
    assert_eq!(truth("spring_color", Changes { k: Some(8.0), equil: Some(5.0), vx: Some(3.0), ..plain }), [8.0, 5.0]);
    assert_eq!(truth("damped_spring", Changes { damping: Some(0.1), ..plain }), [4.0, 6.0, 0.1]);
    assert_eq!(truth("3bp_color", Changes { g: Some(30.0), ..plain }), [30.0, 1.0]);
    assert_eq!(truth("pendulum", Changes { a: Some(2.0), spin: Some(0.5), ..plain }), [10.0, 2.0]);
    // The clips of another time step follow the same equation; a training refuses them until its task has that step.
    assert_eq!(truth("spring_color", Changes { dt: Some(0.1), ..plain }), [4.0, 6.0]);
    // Another equation than the model's: the spring without friction, masses of 1, a rod of length 1.
    for (task, changes) in [
        ("spring_color", Changes { damping: Some(0.1), ..plain }),
        ("3bp_color", Changes { m: Some(2.0), ..plain }),
        ("pendulum", Changes { length: Some(0.9), ..plain }),
    ] {
        assert!(truth(task, changes).is_empty(), "{task}");
    }
}

/// The parameters of a text bear names of their own, or one of the scene's for something else.
#[test]
fn the_truth_of_an_equation_of_text_is_the_tasks() {
    let text = include_str!("../../configs/gallery/text_spring.toml").replace("2*l)", "2*half)");
    let text = text.replace("\nl = ", "\nhalf = ");
    let truth = |text: &str, changes: Changes| {
        let task = Task::from_toml(text).unwrap();
        let symbols: Vec<_> = task.truth.iter().map(|parameter| parameter.name.clone()).collect();
        let values = Variant::new(&task, 0).unwrap().with(&changes).unwrap().truth();
        symbols.into_iter().zip(values).collect::<BTreeMap<_, _>>()
    };
    let expected = |half: f64, k: f64| BTreeMap::from([("half".to_string(), half), ("k".to_string(), k)]);
    let plain = Changes::default();
    let stronger = Changes { k: Some(8.0), ..plain };
    assert_eq!(truth(&text, plain), expected(6.0, 4.0));
    // What has the scene's name and its value is its number, in other scenes, too.
    assert_eq!(truth(&text, stronger), expected(6.0, 8.0));
    // Nothing says what the rest length of another scene is to the equation.
    assert!(truth(&text, Changes { equil: Some(5.0), ..plain }).is_empty());
    let other = text.replace("\nk = 4.0", "\nk = 0.5");
    assert_eq!(truth(&other, plain), expected(6.0, 0.5));
    assert!(truth(&other, stronger).is_empty());
}

/// Clips that were made by another equation, or with other true values, are not kept for those that are asked for; bounds and
/// starts say only how a model learns.
#[test]
fn clips_of_another_equation_are_not_kept() {
    let folder = tempfile::tempdir().unwrap();
    let text = include_str!("../../configs/gallery/bounce_on_a_floor.toml");
    let made = |here: &str, there: &str| {
        let changed = text.replacen(here, there, 1);
        assert!(here == there || changed != text, "{here}");
        let variant = Variant::new(&Task::from_toml(&changed).unwrap(), 0).unwrap();
        let (counts, images) = (Counts { train: 2, valid: 1, test: 1 }, SourceImages::original().unwrap());
        generate(&DatasetJob { variant, counts, images, folder: folder.path().into(), force: false }, &|_| {})
    };
    made("", "").unwrap();
    made("", "").unwrap();
    made("start = 24.0", "start = 20.0").unwrap();
    for (here, there) in [("vec(0, g)", "vec(0, 2 * g)"), ("e = 0.8", "e = 0.7")] {
        let error = format!("{:#}", made(here, there).unwrap_err());
        assert!(error.contains("the equation is another") && error.contains("--force"), "{error}");
    }
}

/// The same symbol may be another quantity in another task's clips; where these move by the task's own equation it is the same.
#[test]
fn true_values_of_another_tasks_clips_count_only_for_its_own_equation() {
    let folder = tempfile::tempdir().unwrap();
    let truth = |made_for: &str, with: &Changes, read_as: &str| {
        let task = Task::from_toml(made_for).unwrap();
        let variant = Variant::new(&task, 0).unwrap().with(with).unwrap();
        let (_, file) = variant.files()[1].clone();
        let (counts, images) = (Counts { train: 1, valid: 1, test: 1 }, SourceImages::original().unwrap());
        let job = DatasetJob { variant, counts, images, folder: folder.path().into(), force: true };
        generate(&job, &|_| {}).unwrap();
        let reader = Task::from_toml(read_as).unwrap();
        let clips = ScoredClips::read(&folder.path().join(file), &reader, Split::Test, Device::Cpu).unwrap();
        clips.truth.into_iter().map(|truth| (truth.name, truth.value)).collect::<BTreeMap<_, _>>()
    };
    let plain = Changes::default();
    let linear = include_str!("../../configs/gallery/fall_linear_drag.toml");
    let quadratic = include_str!("../../configs/gallery/fall_quadratic_drag.toml");
    assert_eq!(truth(linear, &plain, linear).len(), 2);
    assert!(truth(linear, &plain, quadratic).is_empty());
    let spring = include_str!("../../configs/tasks/spring_color.toml");
    let mine = spring.replacen("spring_color", "my_spring", 1);
    let expected = |k: f64| BTreeMap::from([("k".to_string(), k), ("l".to_string(), 6.0)]);
    assert_eq!(truth(spring, &plain, &mine), expected(4.0));
    assert_eq!(truth(spring, &Changes { k: Some(8.0), ..plain }, &mine), expected(8.0));
}

#[test]
fn free_fall_is_a_parabola() {
    let world = variant("falling").world();
    let (h, g) = (world.dt / world.substeps as f64, 1.5);
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..20 {
        let clip = world.clip(30, &mut rng).unwrap();
        let ([x, y], [vx, vy]) = (clip[0].points()[0], [clip[0].velocities[0], clip[0].velocities[1]]);
        for (frame, state) in clip.iter().enumerate() {
            let time = frame as f64 * world.dt;
            // Taking the new velocity for each step of length h falls g h t / 2 further than the parabola: 0.2 px after
            // 30 frames.
            let expected = [x + vx * time, y + vy * time + g * time * (time + h) / 2.0];
            for (position, expected) in state.positions.iter().zip(expected) {
                assert!((position - expected).abs() < 1e-9, "frame {frame}: {position} for {expected}");
            }
        }
    }
}

#[test]
fn falling_balls_bounce_without_loss() {
    let (g, h) = (3.0, 0.03);
    let (mut bounces, mut steps) = (0, 0);
    for clip in clips_by_substep("falling_bouncing", 30) {
        for pair in clip.windows(2) {
            let [before, after] = [&pair[0], &pair[1]].map(|state| (state.points()[0], &state.velocities));
            assert!(after.0.iter().all(|x| (3.0..=29.0).contains(x)), "{after:?}");
            assert_eq!(before.1[0].abs(), after.1[0].abs());
            let fallen = before.1[1] + g * h;
            assert_eq!(fallen.abs(), after.1[1].abs());
            steps += 1;
            if after.1[1] != fallen {
                bounces += 1;
                continue;
            }
            // Between bounces a step loses (g h)^2 / 2, the integrator's error.
            let energy = |(position, velocity): ([f64; 2], &Vec<f64>)| velocity[1].powi(2) / 2.0 - g * position[1];
            assert!((energy(after) - energy(before) + (g * h).powi(2) / 2.0).abs() < 1e-9);
        }
    }
    // 40 clips of 8.7 time units; a fall from the ceiling takes 4.2, so a clip has one to three bounces off the floor.
    assert!((40..=200).contains(&bounces) && steps == 40 * 290, "{bounces} bounces in {steps} steps");
}

#[test]
fn grey_balls_are_white_discs() {
    for key in ["falling", "falling_bouncing"] {
        let (dataset, states) = clips(&variant(key), 12, COUNTS);
        assert_eq!(dataset.train.dim(), (40, 12, 32, 32, 1));
        assert_eq!(states.train.positions.dim(), (40, 12, 2));
        for (clip, frames) in dataset.train.outer_iter().enumerate() {
            for (index, frame) in frames.outer_iter().enumerate() {
                let at = |axis| states.train.positions[[clip, index, axis]];
                // 254 where the weights of the blur add up to a little less than 1.
                assert!(frame[[at(1) as usize, at(0) as usize, 0]] >= 254);
                // A disc of radius 3; next to a border the mirrored blur adds a little.
                let area = frame.iter().map(|&v| f64::from(v)).sum::<f64>() / 255.0;
                assert!((area / (9.0 * TAU / 2.0) - 1.0).abs() < 0.1, "{area}");
            }
        }
    }
}

/// Bouncing balls and falling balls may be any number; in frames of one channel all of them are white.
#[test]
fn any_number_of_balls_is_drawn() {
    let file = |objects: usize, channels: usize| {
        let text = format!(
            "name = \"some\"\n\
             [system]\nside = 32\nchannels = {channels}\nobjects = {objects}\ninput_steps = 4\npred_steps = 6\ndt = 0.3\n\
             equation = \"bouncing\"\n\
             [data]\ntrain_frames = 12\ntest_frames = 30\n\
             [scene]\nmotion = {{ law = \"bouncing\" }}\nspeed = [8.0, 8.0]\nradius = 2.0\nlook = \"balls\"\n"
        );
        Task::from_toml(&text)
    };
    // The fourth of four coloured balls shines in two channels.
    let shines = |ball: usize, channel: usize| if ball < 3 { channel == 2 - ball } else { channel < 2 };
    for (objects, channels) in [(1, 3), (4, 3), (1, 1), (5, 1)] {
        let (dataset, states) = clips(&Variant::new(&file(objects, channels).unwrap(), 0).unwrap(), 12, COUNTS);
        assert_eq!(states.train.positions.dim(), (40, 12, 2 * objects));
        let (mut lit, mut alone) = (0, 0);
        for (clip, frames) in dataset.train.outer_iter().enumerate() {
            for (index, frame) in frames.outer_iter().enumerate() {
                let place = |ball: usize| [0, 1].map(|axis| states.train.positions[[clip, index, 2 * ball + axis]]);
                for ball in 0..objects {
                    let [x, y] = place(ball);
                    let pixel = frame.slice(s![y as usize, x as usize, ..]);
                    let far = |other: usize| (place(other)[0] - x).hypot(place(other)[1] - y) > 6.0;
                    // Where another ball is near, its blur adds to what is seen.
                    if !(0..objects).filter(|&other| other != ball).all(far) {
                        continue;
                    }
                    alone += 1;
                    let right = |channel: usize| match channels == 1 || shines(ball, channel) {
                        true => pixel[channel] > 200,
                        false => pixel[channel] == 0,
                    };
                    lit += usize::from((0..channels).all(right));
                }
            }
        }
        assert!(alone > 400 && lit == alone, "{objects} balls in {channels} channels: {lit} of {alone}");
    }
    let error = format!("{:#}", file(7, 3).unwrap_err());
    assert!(error.contains("7 balls: there are colours for 6 only"), "{error}");
}

#[test]
fn three_bodies_circle_in_the_closed_form_period() {
    let (g, distance) = (60.0, 9.0);
    let world = free_world(Motion::ThreeBodies { g, m: 1.0 }, 3);
    // Equilateral triangle: each body is pulled to the centre with g / (sqrt(3) distance^2).
    let speed = (g / (3.0_f64.sqrt() * distance)).sqrt();
    let angles = [0.1, 0.1 + TAU / 3.0, 0.1 + 2.0 * TAU / 3.0];
    let start = SceneState::in_plane(
        angles.iter().map(|a| [500.0 + distance * a.cos(), 500.0 + distance * a.sin()]).collect(),
        angles.iter().map(|a| [-speed * a.sin(), speed * a.cos()]).collect(),
    );
    let mut state = start.clone();
    run(&world, &mut state, TAU * distance / speed);
    for (end, begin) in state.points().iter().zip(start.points()) {
        assert!((end[0] - begin[0]).hypot(end[1] - begin[1]) < 0.01, "{end:?} for {begin:?}");
    }
}

#[test]
fn bouncing_balls_follow_the_triangle_wave() {
    let world = World { side: 32.0, ..free_world(Motion::Bouncing {}, 2) };
    let mut state = SceneState::in_plane(vec![[5.0, 20.0]; 2], vec![[-7.0, 3.0], [4.0, -11.0]]);
    let start = state.clone();
    let time = 9.5;
    run(&world, &mut state, time);
    for ball in 0..2 {
        for axis in 0..2 {
            let entry = 2 * ball + axis;
            let path = start.positions[entry] - 2.0 + start.velocities[entry] * time;
            let folded = path.rem_euclid(56.0);
            let expected = 2.0 + folded.min(56.0 - folded);
            assert!((state.positions[entry] - expected).abs() < 1e-6);
        }
    }
}

/// Clips with every substep of a task's motion as a frame of its own, so that rules are checked at all of them.
fn clips_by_substep(key: &str, frames: usize) -> Vec<Vec<SceneState>> {
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
    for key in ["spring_color", "spring_color_half", "mnist_spring_color", "3bp_color", "falling"] {
        let task = find(key).unwrap();
        let margin = if key == "falling" { 3.0 } else { 2.0 };
        for clip in clips_by_substep(key, task.train_frames) {
            let far = task.system.side as f64 - margin;
            assert!(clip.iter().flat_map(|state| &state.positions).all(|&x| x > margin && x < far));
        }
    }
}

#[test]
fn half_pane_keeps_balls_left_during_input_and_prediction_only() {
    let clips = clips_by_substep("spring_color_half", 30);
    let right = |state: &SceneState| state.points().iter().any(|position| position[0] >= 14.0);
    assert!(clips.iter().all(|clip| !clip[..9 * 10 + 1].iter().any(right)));
    assert!(clips.iter().any(|clip| clip[9 * 10 + 1..].iter().any(right)));
}

#[test]
fn three_bodies_stay_apart() {
    for clip in clips_by_substep("3bp_color", 20) {
        for state in &clip {
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                let (p, q) = (state.points()[a], state.points()[b]);
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

fn first_states(key: &str) -> Vec<SceneState> {
    let world = variant(key).world();
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    (0..500).map(|_| world.clip(2, &mut rng).unwrap().remove(0)).collect()
}

fn speeds(state: &SceneState) -> Vec<f64> {
    state.velocities.chunks(2).map(|velocity| velocity[0].hypot(velocity[1])).collect()
}

#[test]
fn bouncing_balls_start_anywhere_at_full_speed() {
    let states = first_states("bouncing_balls");
    assert!(states.iter().flat_map(speeds).all(|speed| (speed - 8.0).abs() < 1e-9));
    let coordinates: Vec<f64> = states.iter().flat_map(|state| state.positions.clone()).collect();
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
            let (p, q) = (state.points()[0], state.points()[1]);
            let separation = (p[0] - q[0]).hypot(p[1] - q[1]);
            assert!((equil..3.0 * equil).contains(&separation), "{separation}");
            assert!((0..2).all(|axis| (border..side - border).contains(&((p[axis] + q[axis]) / 2.0))));
            assert!(speeds(&state).iter().all(|speed| (speed - 8.0).abs() < 1e-9));
        }
    }
}

#[test]
fn three_bodies_start_on_a_circle() {
    let mut senses = [0, 0];
    for state in first_states("3bp_color") {
        let polar: Vec<(f64, f64)> = state
            .points()
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
                let v = &state.velocities[2 * body..];
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
    let images = SourceImages::original().unwrap();
    for key in ["spring_color", "mnist_spring_color", "pendulum", "falling", "falling_bouncing"] {
        let with_threads = |threads: usize, counts: Counts, seed: u64| {
            let variant = Variant::new(&find(key).unwrap(), seed).unwrap();
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| generate_clips(&variant, &images, 4, counts, &|_| {})).unwrap()
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
    let (dataset, states) = clips(&variant("spring_color"), 12, COUNTS);
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
    let own = [
        "bouncing/color_bounce_vx8_vy8_sl{T}_r2.npz",
        "spring_color/color_spring_vx8_vy8_sl{T}_r2_k4_e6.npz",
        "spring_color_half/color_spring_vx4_vy4_sl{T}_r2_k4_e6_halfpane.npz",
        "damped_spring/color_spring_vx8_vy8_sl{T}_r2_k4_e6.npz",
        "mnist_spring_color/color_mnist_spring_vx8_vy8_sl{T}_r2_k2_e12.npz",
        "3bp_color/color_3bp_vx2_vy2_sl{T}_r2_g60_m1_dt05.npz",
        "pendulum/color_pendulum_sl{T}_g10_m1_l1_a1_u2_dt005.npz",
        "falling_ball/falling_ball_vx2_vy7_sl{T}_r3_g1.5.npz",
        "falling_bouncing_ball/falling_bouncing_ball_vx4_vy4_sl{T}_r3_g3.npz",
    ];
    assert_eq!(tasks::all().count(), own.len());
    for (task, own) in tasks::all().zip(own) {
        let expected =
            [task.train_frames, task.test_frames].map(|frames| (frames, own.replace("{T}", &frames.to_string())));
        let files =
            Variant::new(&task, 3).unwrap().files().map(|(frames, path)| (frames, path.to_str().unwrap().into()));
        assert_eq!(files, expected);
        assert_eq!([task.train_file, task.test_file], expected.map(|(_, file)| file));
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
    assert_eq!(variant.files()[0], (12, PathBuf::from(expected)));
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
        ("pendulum", radius, "--radius"),
        ("pendulum", k, "--k"),
        ("falling", k, "--k"),
        ("falling", Changes { m: Some(1.0), ..Changes::default() }, "--m"),
        ("falling_bouncing", Changes { torque: Some(1.0), ..Changes::default() }, "--torque"),
        ("3bp_color", Changes { damping: Some(1.0), ..Changes::default() }, "--damping"),
        ("pendulum", Changes { vy: Some(1.0), ..Changes::default() }, "--vy"),
        ("pendulum", Changes { background: Some(Background::Cifar), ..Changes::default() }, "--background"),
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
    for (changes, complaint) in [
        (Changes { length: Some(3.0), ..Changes::default() }, "--length must be at most 2.1"),
        (Changes { spin: Some(9.0), ..Changes::default() }, "--spin must be at most 8"),
        (Changes { m: Some(0.0), ..Changes::default() }, "--m must be at least 0.01"),
        (Changes { dt: Some(1.0), ..Changes::default() }, "raise --substeps"),
    ] {
        let error = variant("pendulum").with(&changes).unwrap_err().to_string();
        assert!(error.contains(complaint), "{error}");
    }
}
