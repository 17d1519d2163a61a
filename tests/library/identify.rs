//! The fit of physical parameters to trajectories, from starts a decade away and through template offsets.

use crate::random::numbers;
use paig::generators::source_images::SourceImages;
use paig::generators::variant::Variant;
use paig::generators::{Counts, generate_clips};
use paig::network::cells::{Actions, CellKind, State};
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::tasks::{Task, find};
use paig::training::identify::Identify;
use paig::training::identify::encoded_positions::EncodedPositions;
use paig::training::identify::explain::explain;
use paig::training::identify::fit::{Fit, FitStart, Trust, fit};
use paig::training::identify::missing::PositionResiduals;
use paig::training::identify::{rank, velocity_fit};
use rand::Rng;
use tch::{Device, Kind, Tensor};

fn settings() -> Identify {
    Identify { clips: CLIPS as usize, ..Identify::usual(FRAMES) }
}

/// Standard normal numbers that are the same in every run, `[clips, n]`.
fn normal(purpose: &str, n: usize) -> Tensor {
    // Twelve uniform numbers have variance 1.
    numbers(7, purpose, &[CLIPS, n as i64], |random| (0..12).map(|_| random.random::<f64>() - 0.5).sum::<f64>())
}

const CLIPS: i64 = 200;
const FRAMES: usize = 12;
/// Standard deviation of the observed positions, pixels.
const NOISE: f64 = 0.1;

/// The fit of all of a task's parameters, or of those that are `learned`, from `start`.
fn fitted(task: &Task, positions: &Tensor, actions: &Actions, start: &[f64], learned: &[bool]) -> Fit {
    fit(&settings(), &task.system, positions, actions, &begin(start, learned), &Trust::default()).unwrap()
}

fn begin(start: &[f64], learned: &[bool]) -> FitStart {
    FitStart {
        unconstrained: start.iter().map(|value| value.ln()).collect(),
        learned: learned.into(),
        free_offsets: true,
        states: None,
    }
}

fn log(value: f64) -> Tensor {
    Tensor::from(value.ln()).to_kind(Kind::Double)
}

/// Trajectories `[clips, frames, coordinates]` of a task from scattered states around `pos` and `vel`, seen with offsets
/// and noise of a standard deviation.
fn observed(
    task: &Task,
    parameters: &[f64],
    actions: &Actions,
    pos: (&[f64], f64),
    vel: (&[f64], f64),
    offsets: &[f64],
    noise: f64,
) -> Tensor {
    let n = offsets.len();
    let first = State {
        pos: Tensor::from_slice(pos.0) + normal("positions", n) * pos.1,
        vel: Tensor::from_slice(vel.0) + normal("velocities", n) * vel.1,
    };
    let logs: Vec<_> = parameters.iter().map(|value| log(*value)).collect();
    let rolled = task.system.build_cell(&logs).roll_out(&first, actions, task.system.dt, FRAMES - 1);
    let seen: Vec<_> = std::iter::once(&first).chain(&rolled).map(|state| &state.pos).collect();
    let noise = normal("noise", FRAMES * n).reshape([CLIPS, FRAMES as i64, n as i64]) * noise;
    Tensor::stack(&seen, 1) + Tensor::from_slice(offsets) + noise
}

fn scattered_springs(task: &Task, parameters: &[f64], offsets: &[f64]) -> Tensor {
    observed(task, parameters, &Actions::none(), (&[21.0, 16.0, 9.0, 16.0], 1.5), (&[0.0; 4], 3.0), offsets, NOISE)
}

#[test]
fn spring_is_found_from_every_start_and_through_offsets() {
    let offsets = [1.5, -0.4, -1.5, 0.4];
    let task = find("spring_color").unwrap();
    let seen = scattered_springs(&task, &[4.0, 6.0], &offsets);
    for start in [[1.0f64, 1.0], [10.0, 1.0], [0.1, 3.0], [1.0, 12.0]] {
        let fit = fitted(&task, &seen, &Actions::none(), &start, &[true; 2]);
        let (k, l) = (fit.unconstrained[0].exp(), fit.unconstrained[1].exp());
        // 200 clips of 12 frames at 0.1 px of noise leave some 0.1 % on either.
        assert!((k / 4.0 - 1.0).abs() < 0.01 && (l / 6.0 - 1.0).abs() < 0.01, "from {start:?}: k {k}, l {l}");
        // Only the relative offset shows in the motion.
        for axis in 0..2 {
            let found = fit.offsets[axis] - fit.offsets[2 + axis];
            let expected = offsets[axis] - offsets[2 + axis];
            assert!((found - expected).abs() < 0.1, "from {start:?}: offset {found} instead of {expected}");
        }
        assert!((fit.residual - NOISE).abs() < 0.05, "residual {}", fit.residual);
    }
}

/// What is found lies within a few of its own standard deviations of the truth, and these are as small as the noise allows.
#[test]
fn a_fit_knows_how_far_it_may_be_off() {
    let task = find("spring_color").unwrap();
    let seen = scattered_springs(&task, &[4.0, 6.0], &[0.0; 4]);
    let fit = fitted(&task, &seen, &Actions::none(), &[1.0; 2], &[true; 2]);
    for (place, truth) in [4.0f64, 6.0].into_iter().enumerate() {
        let (error, deviation) = ((fit.unconstrained[place] - truth.ln()).abs(), fit.deviations[place]);
        println!("error {error}, deviation {deviation}");
        assert!(error < 4.0 * deviation, "error {error} of a logarithm, deviation {deviation}");
        // 200 clips of 12 frames at 0.1 px: some tenths of a per cent.
        assert!(deviation > 1e-5 && deviation < 5e-3, "deviation {deviation}");
    }
}

/// Fits of eight parts of the clips scatter as much as each of them says.
#[test]
fn fits_scatter_by_their_deviations() {
    let task = find("spring_color").unwrap();
    let seen = scattered_springs(&task, &[4.0, 6.0], &[0.0; 4]);
    let part = |part: i64| {
        let seen = seen.narrow(0, 25 * part, 25);
        let fit = fitted(&task, &seen, &Actions::none(), &[1.0; 2], &[true; 2]);
        (fit.unconstrained[0], fit.deviations[0])
    };
    let (logs, deviations): (Vec<_>, Vec<_>) = (0..8).map(part).unzip();
    let mean = |numbers: &[f64]| numbers.iter().sum::<f64>() / 8.0;
    let middle = mean(&logs);
    let scatter = (logs.iter().map(|log| (log - middle).powi(2)).sum::<f64>() / 7.0).sqrt();
    let ratio = scatter / mean(&deviations);
    println!("scatter {scatter}, {ratio:.2} deviations");
    // Of eight numbers the scatter is known to 27 %; here it is 0.8 deviations, and 0.3 if these were three times too large.
    assert!((0.5..2.0).contains(&ratio), "fits scatter by {ratio} of their deviations");
}

/// Positions under a wrong name are no part of the motion.
#[test]
fn a_mask_leaves_out_what_is_far_off() {
    let task = find("spring_color").unwrap();
    let seen = scattered_springs(&task, &[4.0, 6.0], &[0.0; 4]);
    // In every fifth clip the balls swap names from the sixth frame on.
    let swapped = seen.index_select(2, &Tensor::from_slice(&[2i64, 3, 0, 1]));
    let mut mask = Tensor::ones([CLIPS, FRAMES as i64, 4], (Kind::Double, Device::Cpu));
    for clip in (0..CLIPS).step_by(5) {
        let late = |x: &Tensor| x.get(clip).narrow(0, 6, FRAMES as i64 - 6);
        late(&seen).copy_(&late(&swapped));
        let _ = late(&mask).zero_();
    }
    mask = mask.reshape([CLIPS, -1]);
    let k = |trust: &Trust| {
        let start = begin(&[4.0, 6.0], &[true; 2]);
        fit(&settings(), &task.system, &seen, &Actions::none(), &start, trust).unwrap().unconstrained[0].exp()
    };
    let (all, some) = (k(&Trust::default()), k(&Trust { mask: Some(mask), ..Trust::default() }));
    assert!((some / 4.0 - 1.0).abs() < 0.01, "k {some}");
    assert!((all / 4.0 - 1.0).abs() > (some / 4.0 - 1.0).abs(), "with the swapped names k {all}, without {some}");
}

/// Residuals that are larger than the noise, but no outliers either, pull a fit that squares them all.
#[test]
fn a_few_clips_that_move_otherwise_pull_little() {
    let task = find("spring_color").unwrap();
    let (seen, stiffer) =
        (scattered_springs(&task, &[4.0, 6.0], &[0.0; 4]), scattered_springs(&task, &[4.6, 6.0], &[0.0; 4]));
    for clip in (0..CLIPS).step_by(8) {
        seen.get(clip).copy_(&stiffer.get(clip));
    }
    let squared = fitted(&task, &seen, &Actions::none(), &[1.0; 2], &[true; 2]).unconstrained[0].exp();
    let model = PhysicsNet::new(&task.system, &ModelOptions::original(), Device::Cpu, 1).unwrap();
    let bounded =
        explain(&settings(), &model, &seen_by_both(&seen), &begin(&[1.0; 2], &[true; 2])).unwrap().fit.unconstrained[0]
            .exp();
    // An eighth of the clips are 15 % stiffer: 2 % on average.
    assert!(squared > 4.04, "k {squared} by squares");
    // The others' residuals reach three times the noise: about half of the pull is left.
    let pull = (bounded - 4.0) / (squared - 4.0);
    assert!(pull.abs() < 0.65, "k {bounded} with bounded residuals, {squared} without");
}

/// On a circle, moving along it, no close encounters, as the task has them.
#[test]
fn gravity_or_mass_is_found_from_far_starts() {
    let task = find("3bp_color").unwrap();
    let (pos, vel) = ([18.0, 9.0, 25.8, 22.5, 10.2, 22.5], [2.0, 0.0, -1.0, 1.7, -1.0, -1.7]);
    let seen = observed(&task, &[60.0, 1.0], &Actions::none(), (&pos, 0.7), (&vel, 0.3), &[0.0; 6], NOISE);
    for start in [1.0f64, 10.0, 300.0] {
        let fit = fitted(&task, &seen, &Actions::none(), &[start, 1.0], &[true, false]);
        let g = fit.unconstrained[0].exp();
        assert!((g / 60.0 - 1.0).abs() < 0.02, "from {start}: g {g}");
        assert_eq!(fit.unconstrained[1], 0.0, "m is held");
    }
    for start in [0.2f64, 4.0] {
        let fit = fitted(&task, &seen, &Actions::none(), &[60.0, start], &[false, true]);
        let m = fit.unconstrained[1].exp();
        assert!((m - 1.0).abs() < 0.01, "from {start}: m {m}");
        assert_eq!(fit.unconstrained[0], 60f64.ln(), "g is held");
    }
}

/// Spring and friction together: the worked example of a cell of one's own.
#[test]
fn a_damped_spring_is_found() {
    let task = find("damped_spring").unwrap();
    let truth: Vec<f64> = task.truth.iter().map(|parameter| parameter.value).collect();
    let seen = scattered_springs(&task, &truth, &[0.0; 4]);
    let fit = fitted(&task, &seen, &Actions::none(), &[1.0; 3], &[true; 3]);
    for ((log, parameter), tolerance) in fit.unconstrained.iter().zip(&task.truth).zip([0.01, 0.01, 0.03]) {
        // Friction is a small force: ten times the spring's relative error.
        let found = log.exp();
        assert!((found / parameter.value - 1.0).abs() < tolerance, "{} {found}", parameter.name);
    }
}

#[test]
fn a_driven_pendulum_is_found_through_an_offset() {
    let task = find("pendulum").unwrap();
    let actions = Actions::new(Some(normal("torque", FRAMES) * 1.2));
    let seen = observed(&task, &[10.0, 1.0], &actions, (&[0.0], 0.9), (&[0.0], 1.2), &[0.05], 0.01);
    let fit = fitted(&task, &seen, &actions, &[1.0; 2], &[true; 2]);
    // 200 clips of half a second at 0.01 rad leave some 0.5 % on a, less on g.
    let (g, a) = (fit.unconstrained[0].exp(), fit.unconstrained[1].exp());
    assert!((g / 10.0 - 1.0).abs() < 0.01 && (a - 1.0).abs() < 0.02, "g {g}, a {a}");
    assert!((fit.offsets[0] - 0.05).abs() < 0.01, "offset {}", fit.offsets[0]);
}

#[test]
fn positions_that_are_not_numbers_are_refused() {
    let task = find("spring_color").unwrap();
    let seen = Tensor::full([4, 12, 4], f64::NAN, (Kind::Double, tch::Device::Cpu));
    let start = begin(&[1.0; 2], &[true; 2]);
    let error = fit(&settings(), &task.system, &seen, &Actions::none(), &start, &Trust::default()).unwrap_err();
    assert!(error.to_string().contains("not finite"), "{error}");
}

/// The generator integrates a frame in ten steps, the model in five: even true positions give a k that is 0.2 % low.
#[test]
fn true_trajectories_give_the_spring_up_to_the_integration_step() {
    let task = find("spring_color").unwrap();
    let counts = Counts { train: 300, valid: 1, test: 1 };
    let (_, states) = generate_clips(
        &Variant::new(&task, 5).unwrap(),
        &SourceImages::original().unwrap(),
        task.train_frames,
        counts,
        &|_| {},
    )
    .unwrap();
    let positions = states.train.positions;
    let shape: Vec<i64> = positions.shape().iter().map(|&n| n as i64).collect();
    let seen = Tensor::from_slice(positions.as_slice().unwrap()).reshape(&shape);
    let fit = fitted(&task, &seen, &Actions::none(), &[1.0; 2], &[true; 2]);
    let (k, l) = (fit.unconstrained[0].exp(), fit.unconstrained[1].exp());
    println!("k {k}, l {l}, residual {} px", fit.residual);
    assert!((k / 4.0 - 0.998).abs() < 0.001, "k {k}");
    assert!((l / 6.0 - 1.0).abs() < 0.001, "l {l}");
}

/// Without forces the velocity is the difference of any two positions: the estimator has all it needs.
#[test]
fn the_velocity_estimator_learns_free_motion() {
    let task = find("spring_color").unwrap();
    let model = PhysicsNet::new(&task.system, &ModelOptions::original(), Device::Cpu, 3).unwrap();
    let stiffness = model.learned().find(|parameter| parameter.kind.name == "k").unwrap();
    model.set_unconstrained(stiffness, 1e-6f64.ln());
    let start = Tensor::from_slice(&[21.0, 16.0, 9.0, 16.0]) + normal("positions", 4);
    let spread = 3.0;
    let first = Tensor::cat(&[start, normal("velocities", 4) * spread], 1);
    let left = |steps| velocity_fit::fit(&model, &first, &Actions::none(), FRAMES, steps, 1e-3).unwrap();
    let before = left(0);
    let after = left(1500);
    println!("velocity error {before} before, {after} after");
    assert!(before > 0.5 * spread, "an untrained estimator knows nothing: {before}");
    assert!(after < 0.1 * spread, "a tenth of the velocities' spread is left at most: {after}");
}

/// Of three bodies only g m^2 shows.
#[test]
fn a_fit_tells_which_parameters_do_not_show_apart() {
    let task = find("3bp_color").unwrap();
    let (pos, vel) = ([18.0, 9.0, 25.8, 22.5, 10.2, 22.5], [2.0, 0.0, -1.0, 1.7, -1.0, -1.7]);
    let seen = observed(&task, &[60.0, 1.0], &Actions::none(), (&pos, 0.7), (&vel, 0.3), &[0.0; 6], NOISE);
    let parameters: Vec<_> = task.system.cell.parameters.iter().collect();
    let both = fitted(&task, &seen, &Actions::none(), &[40.0, 1.2], &[true; 2]);
    let found = rank::unidentifiable(&both.curvature, &parameters).unwrap();
    assert_eq!((found.names, found.shows), (["g", "m"].map(String::from).to_vec(), vec!["g m^2".to_string()]));
    let task = find("damped_spring").unwrap();
    let seen = scattered_springs(&task, &[4.0, 6.0, 0.3], &[0.0; 4]);
    let parameters: Vec<_> = task.system.cell.parameters.iter().collect();
    let fit = fitted(&task, &seen, &Actions::none(), &[1.0; 3], &[true; 3]);
    assert_eq!(rank::unidentifiable(&fit.curvature, &parameters), None);
}

/// A parameter that acts nowhere is not known at all, and is named.
#[test]
fn a_parameter_that_never_shows_has_no_bounds() {
    let text = "acceleration = \"vec(0, -k * max(p.y - 1000, 0))\"\nparameters.k.unit = [0, -2]";
    let cell = CellKind::of_text(&toml::from_str(text).unwrap(), 2).unwrap();
    let mut task = find("spring_color").unwrap();
    task.system.cell = cell.clone().into();
    let still = (&[21.0, 16.0, 9.0, 16.0], 1.5);
    let seen = observed(&task, &[1.0], &Actions::none(), (still.0, still.1), (&[0.0; 4], 3.0), &[0.0; 4], NOISE);
    let fit = fitted(&task, &seen, &Actions::none(), &[1.0], &[true]);
    assert_eq!(fit.deviations, [f64::INFINITY]);
    let parameters: Vec<_> = cell.parameters.iter().collect();
    assert_eq!(rank::unidentifiable(&fit.curvature, &parameters).unwrap().names, ["k"]);
}

/// Of one clip the scatter says nothing: its residuals do, as those of many clips.
#[test]
fn few_clips_make_no_fit_certain() {
    let task = find("spring_color").unwrap();
    let seen = scattered_springs(&task, &[4.0, 6.0], &[0.0; 4]);
    let deviation = |clips: i64| {
        let seen = seen.narrow(0, 0, clips);
        let start = FitStart { free_offsets: false, ..begin(&[4.0, 6.0], &[true; 2]) };
        fit(&settings(), &task.system, &seen, &Actions::none(), &start, &Trust::default()).unwrap().deviations[0]
    };
    let many = deviation(CLIPS);
    for clips in [1, 2, 10] {
        // As one over the root of the clips; how much one tells depends on its motion.
        let ratio = deviation(clips) / many / (CLIPS as f64 / clips as f64).sqrt();
        assert!(0.2 < ratio && ratio < 5.0, "{clips} clips: {ratio} times what is expected");
    }
}

/// What two balls see.
fn seen_by_both(positions: &Tensor) -> EncodedPositions {
    let coordinates = positions.size()[2] as usize;
    let objects = coordinates / 2;
    EncodedPositions {
        encoded: positions.shallow_clone(),
        centroids: positions.shallow_clone(),
        offsets: vec![0.0; coordinates],
        present: vec![1.0; objects],
        owned: vec![1.0 / objects as f64; objects],
        covered: 1.0,
        actions: Actions::none(),
    }
}

/// A force that is not the one between two balls leaves residuals that are opposite, and the middle between them fits any: the
/// motion is not explained. What a camera does to both alike is forgiven.
#[test]
fn a_wrong_force_is_no_shaking_camera() {
    let task = find("spring_color").unwrap();
    let explained = |task: &Task, positions: &Tensor, start: &[f64]| {
        let model = PhysicsNet::new(&task.system, &ModelOptions::original(), Device::Cpu, 1).unwrap();
        explain(&settings(), &model, &seen_by_both(positions), &begin(start, &[true; 2][..start.len()])).unwrap()
    };
    let springs = scattered_springs(&task, &[4.0, 6.0], &[0.0; 4]);
    let shake = normal("shake", FRAMES * 2).reshape([CLIPS, FRAMES as i64, 2]).repeat([1, 1, 2]);
    let shaken = explained(&task, &(&springs + shake), &[1.0; 2]);
    assert!(shaken.explains(), "a camera leaves {}", shaken.own_residual);
    let (k, deviation) = (shaken.fit.unconstrained[0].exp(), shaken.fit.deviations[0]);
    println!("shaken: k {k}, deviation {deviation}");
    // The noise leaves 0.1 %, and that is the deviation, too. Weights with rows and columns exchanged take more than 1 %
    // off k, and know it to 0.5 %.
    assert!((k / 4.0 - 1.0).abs() < 0.006 && deviation < 2.5e-3, "k {k}, deviation {deviation}");
    // An attraction that falls with the distance, where the spring's grows.
    let text = "acceleration = \"others((q - p) * a / max(norm(p - q), 1)^2)\"\nparameters.a.unit = [2, -2]";
    let cell = CellKind::of_text(&toml::from_str(text).unwrap(), 2).unwrap();
    let mut wrong = task.clone();
    wrong.system.cell = cell.into();
    let wrong = explained(&wrong, &springs, &[10.0]);
    assert!(!wrong.explains(), "the wrong force leaves {}", wrong.own_residual);
}

/// A ball falls through a medium that resists, by an equation without the resistance. It leaves far less than half a pixel, and g
/// is wrong all the same.
#[test]
fn a_missing_force_shows_in_whole_clips() {
    let task = find("falling").unwrap();
    let mut resisting = task.clone();
    let text = "acceleration = \"vec(0, g) - c * v\"\nparameters.c.unit = [0, -1]\nparameters.g.unit = [1, -2]";
    resisting.system.cell = CellKind::of_text(&toml::from_str(text).unwrap(), 1).unwrap().into();
    let falls = |task: &Task, parameters: &[f64]| {
        observed(task, parameters, &Actions::none(), (&[16.0; 2], 4.0), (&[0.0; 2], 3.0), &[0.0; 2], 0.05)
    };
    let explained = |positions: &Tensor| {
        let model = PhysicsNet::new(&task.system, &ModelOptions::original(), Device::Cpu, 1).unwrap();
        let seen = seen_by_both(positions);
        let explanation = explain(&settings(), &model, &seen, &begin(&[1.0], &[true])).unwrap();
        let left = PositionResiduals::of(&settings(), &model, &seen, &explanation).unwrap();
        (explanation, left.expect("half a clip is six frames"))
    };
    let (right, of_right) = explained(&falls(&task, &[1.5]));
    let (wrong, of_wrong) = explained(&falls(&resisting, &[0.1, 1.5]));
    assert!(right.explains() && !of_right.misses_a_force(), "{of_right:?}");
    let g = wrong.fit.unconstrained[0].exp();
    assert!(wrong.explains() && (g / 1.5 - 1.0).abs() > 0.02, "g {g}");
    assert!(of_wrong.misses_a_force(), "{of_wrong:?}");
}

/// A ball that falls on a floor, from a fit that went astray while g was wrong: the floor too high, and nothing left of the speed.
/// Most of the motion is explained all the same, for most of it is free fall.
#[test]
fn a_wall_that_was_moved_away_is_looked_for_anew() {
    let task = Task::from_toml(include_str!("../../configs/gallery/bounce_on_a_floor.toml")).unwrap();
    let model = PhysicsNet::new(&task.system, &ModelOptions::original(), Device::Cpu, 1).unwrap();
    let unconstrained = |values: &[(&str, f64)]| -> Vec<f64> {
        let of = |name: &str| values.iter().find(|(symbol, _)| *symbol == name).unwrap().1;
        task.system.cell.parameters.iter().map(|kind| kind.bounds.unconstrained(of(&kind.name))).collect()
    };
    let truth: Vec<_> =
        unconstrained(&[("e", 0.8), ("floor", 25.0), ("g", 3.0)]).into_iter().map(Tensor::from).collect();
    let first = State {
        pos: Tensor::from_slice(&[16.0, 13.0]) + normal("positions", 2) * 3.0,
        vel: normal("velocities", 2) * 2.0,
    };
    let rolled = task.system.build_cell(&truth).roll_out(&first, &Actions::none(), task.system.dt, FRAMES - 1);
    let seen: Vec<_> = std::iter::once(&first).chain(&rolled).map(|state| &state.pos).collect();
    let noise = normal("noise", FRAMES * 2).reshape([CLIPS, FRAMES as i64, 2]) * 0.03;
    let positions = Tensor::stack(&seen, 1) + noise;
    let start = FitStart {
        unconstrained: unconstrained(&[("e", 1e-4), ("floor", 22.85), ("g", 3.0)]),
        learned: vec![true; 3],
        free_offsets: true,
        states: None,
    };
    let found = explain(&settings(), &model, &seen_by_both(&positions), &start).unwrap();
    let values: Vec<_> = task
        .system
        .cell
        .parameters
        .iter()
        .zip(&found.fit.unconstrained)
        .map(|(kind, unconstrained)| kind.bounds.value(*unconstrained))
        .collect();
    // In the order of their names. The noise leaves some 0.2 %.
    let [e, floor, g] = values[..] else { panic!("three parameters") };
    assert!(found.explained > 0.95, "{} explained by {values:?}", found.explained);
    assert!(
        (e / 0.8 - 1.0).abs() < 0.02 && (floor / 25.0 - 1.0).abs() < 0.01 && (g / 3.0 - 1.0).abs() < 0.01,
        "{values:?}"
    );
}
