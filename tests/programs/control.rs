//! Control: the environments by their formulas, what is seen, the models, the planners, and what goes wrong.

use std::f64::consts::PI;
use std::fs;

use crate::programs::paig;
use crate::project::project;
use anyhow::{Result, bail};
use paig::datasets::files::Split;
use paig::generators::source_images::SourceImages;
use paig::generators::streams::{Purpose, Streams};
use paig::generators::variant::Variant;
use paig::generators::{Counts, generate_clips};
use paig::network::cells::{Actions, PENDULUM, State, Walls};
use paig::network::dynamics::DynamicsKind;
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::tasks::{Task, find};
use paig_experiments::control::controller::{Controller, Decision};
use paig_experiments::control::cross_entropy::CrossEntropy;
use paig_experiments::control::environment::{Environment, Rules};
use paig_experiments::control::episode::{Episode, play};
use paig_experiments::control::eyes::{Eyes, StateSource};
use paig_experiments::control::faults::{Faults, FaultyCamera};
use paig_experiments::control::learned;
use paig_experiments::control::model::{self, CellModel, PlainModel, PlanningModel};
use paig_experiments::control::mppi::PathIntegral;
use paig_experiments::control::pendulum::{FORMAT, PendulumEnvironment, PendulumSettings};
use paig_experiments::control::planner::{Planner, SearchSettings};
use paig_experiments::control::plans::{Plans, Trajectories};
use paig_experiments::control::relearning::Relearning;
use paig_experiments::control::results::mean_and_interval;
use paig_experiments::control::reward::{GoalPath, Reward};
use paig_experiments::control::scene::SceneEnvironment;
use paig_experiments::control::state::{ControlState, PastFrame, wrapped};
use paig_experiments::control::vision::Vision;
use tch::{Device, Kind, Tensor};

fn upright() -> Rules {
    Rules::pendulum(GoalPath::angle(0.0))
}

fn pendulum(settings: PendulumSettings, rules: Rules) -> PendulumEnvironment {
    PendulumEnvironment::new(settings, rules).unwrap()
}

/// Far fewer plans than by default, so that an episode takes a fraction of a second.
fn small() -> SearchSettings {
    SearchSettings { candidates: 200, iterations: 4, ..SearchSettings::default() }
}

#[test]
fn a_step_is_the_closed_formula() {
    let settings = PendulumSettings { gravity: 9.0, length: 1.2, mass: 0.8, ..PendulumSettings::default() };
    let mut environment = pendulum(settings, Rules::pendulum(GoalPath::angle(0.5)));
    for (angle, rate, torque) in [(0.3, -1.0, 1.5), (3.0, 7.9, 2.0), (-2.0, -7.9, -9.0)] {
        environment.place(angle, rate);
        let reward = environment.step(torque);
        let held = f64::clamp(torque, -2.0, 2.0);
        let faster = rate + (3.0 * 9.0 / (2.0 * 1.2) * f64::sin(angle) + 3.0 * held / (0.8 * 1.2 * 1.2)) * 0.05;
        let (expected_angle, expected_rate) = (angle + 0.05 * faster, faster.clamp(-8.0, 8.0));
        let found = environment.true_state();
        // The same numbers in another order of multiplication.
        assert!((found.positions[0] - expected_angle).abs() < 1e-12);
        assert!((found.velocities[0] - expected_rate).abs() < 1e-12);
        assert!((reward - (1.0 - wrapped(expected_angle - 0.5).abs() / PI)).abs() < 1e-12);
    }
    environment.place(0.1, 0.0);
    let mut same = environment.clone();
    assert_eq!(environment.step(f64::NAN), same.step(0.0));
}

#[test]
fn gymnasiums_cost_is_that_of_the_state_before_the_step() {
    let mut environment = pendulum(PendulumSettings::gymnasium(), Rules::gymnasium());
    environment.place(PI + 0.5, 2.0);
    let cost = (PI - 0.5).powi(2) + 0.1 * 4.0 + 0.001;
    assert!((environment.step(1.0) + cost).abs() < 1e-12);
    assert_eq!(environment.rules().steps, 200);
}

#[test]
fn a_moving_goal_is_where_its_swing_has_it() {
    let goal = GoalPath::angle(0.2).swinging(0.5, 40.0);
    assert_eq!((goal.at(0, 0), goal.at(0, 10)), (0.2, 0.7));
    let mut environment = pendulum(PendulumSettings::default(), Rules::pendulum(goal));
    environment.reset(0);
    for step in 0..10 {
        environment.place(0.1, 0.0);
        let reward = environment.step(0.0);
        let expected = 0.2 + 0.5 * (2.0 * PI * f64::from(step + 1) / 40.0).sin();
        let angle = environment.true_state().positions[0];
        assert!((reward - (1.0 - (angle - expected).abs() / PI)).abs() < 1e-12, "step {step}");
    }
}

#[test]
fn episodes_begin_within_their_range_and_by_their_seed() {
    let mut environment = pendulum(PendulumSettings::default(), upright());
    let mut starts = |seed| {
        environment.reset(seed);
        let state = environment.true_state();
        [state.positions[0], state.velocities[0]]
    };
    let drawn: Vec<_> = (0..200).map(&mut starts).collect();
    assert!(drawn.iter().all(|[angle, rate]| angle.abs() <= PI / 2.0 && rate.abs() <= 2.0));
    assert!(drawn.iter().any(|state| state[0] > 1.3) && drawn.iter().any(|state| state[1] < -1.7));
    assert_eq!(starts(7), drawn[7]);
}

#[test]
fn frames_are_those_of_the_dataset() {
    let variant = Variant::new(&find("pendulum").unwrap(), 3).unwrap();
    let (images, frames) = (SourceImages::of(&variant).unwrap(), 5);
    let counts = Counts { train: 1, valid: 1, test: 1 };
    let (dataset, _) = generate_clips(&variant, &images, frames, counts, &|_| {}).unwrap();
    let streams = Streams { seed: 3, split: Split::Train, index: 0, take: 0 };
    let clip = variant.world().clip(frames, &mut streams.of(Purpose::Motion)).unwrap();
    let mut environment = pendulum(PendulumSettings::default(), upright());
    for (frame, state) in clip.iter().enumerate() {
        environment.place(state.positions[0], state.velocities[0]);
        let pixels: Vec<u8> =
            dataset.train.index_axis(ndarray::Axis(0), 0).index_axis(ndarray::Axis(0), frame).iter().copied().collect();
        let side = FORMAT.side as i64;
        let drawn =
            Tensor::from_slice(&pixels).reshape([side, side, 3]).permute([2, 0, 1]).to_kind(Kind::Float) / 255.0;
        assert_eq!(environment.observe(), Some(drawn), "frame {frame}");
    }
}

/// Where plans lead on a model, by candidate.
fn followed(model: &mut dyn PlanningModel, start: &ControlState, plans: &Plans) -> Vec<Vec<ControlState>> {
    let mut trajectories = Trajectories::default();
    model.roll_out(start, plans, &mut trajectories).unwrap();
    (0..plans.candidates).map(|candidate| trajectories.of(candidate)).collect()
}

/// The largest difference of two states' numbers.
fn difference(a: &ControlState, b: &ControlState) -> f64 {
    let pairs = a.positions.iter().zip(&b.positions).chain(a.velocities.iter().zip(&b.velocities));
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Plain numbers and tensors are the same equation; and one Euler step of it is the environment's.
#[test]
fn the_models_agree() {
    let (g, a, dt): (f64, f64, f64) = (9.0, 1.3, 0.05);
    let cell = PENDULUM.kind(1).cell(&[g, a].map(|x| Tensor::from(x.ln() as f32)), Walls::new(64, 0.0));
    // Two candidates of three decisions.
    let plans = Plans { actions: &[0.5, 1.5, -1.0, 0.0, 2.0, -2.0], candidates: 2, hold: 2 };
    let start = ControlState::turning(0.4, -1.0);
    let tensors = followed(&mut CellModel { cell: cell.as_ref(), dt }, &start, &plans);
    let plain = followed(model::of_cell(cell.as_ref(), dt).as_mut(), &start, &plans);
    assert_eq!((plain.len(), plain[0].len()), (2, 6));
    for (plain, tensors) in plain.iter().flatten().zip(tensors.iter().flatten()) {
        // Thirty Euler steps in float32.
        assert!(difference(plain, tensors) < 1e-4, "{plain:?} and {tensors:?}");
    }
    for reward in [Reward::Goal(GoalPath::angle(0.0).swinging(0.4, 9.0)), Reward::Gymnasium] {
        let rules = Rules { reward, ..upright() };
        let mut environment = pendulum(PendulumSettings::default(), rules.clone());
        let mut model = PendulumSettings::default().model();
        let mut trajectories = Trajectories::default();
        model.roll_out(&start, &plans, &mut trajectories).unwrap();
        let mut returns = [0.0; 2];
        rules.reward.returns(0, &start, &plans, &trajectories, &mut returns);
        for (candidate, found) in returns.into_iter().enumerate() {
            environment.reset(0);
            environment.place(0.4, -1.0);
            let mut total = 0.0;
            for (step, foretold) in trajectories.of(candidate).iter().enumerate() {
                total += environment.step(f64::from(plans.at(step)[candidate]));
                assert!(difference(foretold, &environment.true_state()) < 1e-4, "step {step}");
            }
            let found = f64::from(found);
            assert!((found - total).abs() < 1e-4 * total.abs().max(1.0), "{found} instead of {total}");
        }
    }
}

/// The planner's roll-out of a black box is the model's own, for each candidate; what is not known of the past moved evenly.
#[test]
fn black_boxes_roll_out_as_in_their_training() {
    let kinds = [DynamicsKind::Lstm, DynamicsKind::Gru, DynamicsKind::Mlp, DynamicsKind::InteractionNetwork];
    for dynamics in kinds {
        let options = ModelOptions { dynamics, ..ModelOptions::original() };
        let net = PhysicsNet::new(&find("pendulum").unwrap().system, &options, Device::Cpu, 2).unwrap();
        let (seen, acted) = ([0.5, 0.4, 0.2, -0.1], [1.0, -2.0, 0.5]);
        let rate = (seen[3] - seen[2]) / net.system.dt;
        let moment = |(angle, action): (&f64, &f64)| PastFrame { positions: vec![*angle], action: *action };
        let known: Vec<PastFrame> = seen.iter().zip(&acted).map(moment).collect();
        let even: Vec<f64> = (0..4).map(|frame| seen[3] - rate * net.system.dt * f64::from(3 - frame)).collect();
        let plans = Plans { actions: &[0.5, 1.5, -1.0, 0.0, 2.0, -2.0], candidates: 2, hold: 2 };
        for (before, path, acted) in [(known, seen.to_vec(), acted), (Vec::new(), even, [0.0; 3])] {
            let start = ControlState { before, ..ControlState::turning(seen[3], rate) };
            let found = followed(learned::of_net(&net).as_mut(), &start, &plans);
            for (candidate, states) in found.iter().enumerate() {
                let ahead = (0..6).map(|step| f64::from(plans.at(step)[candidate]));
                let actions: Vec<f64> = acted.into_iter().chain(ahead).collect();
                let tensor = |numbers: &[f64]| Tensor::from_slice(numbers).to_kind(Kind::Float).unsqueeze(0);
                let input = tensor(&path).unsqueeze(2);
                let (_, expected) = net.roll_out(&input, &Actions::new(Some(tensor(&actions))), 6);
                for (state, expected) in states.iter().zip(&expected) {
                    let expected = expected.pos.double_value(&[0, 0]);
                    // Six float32 steps in batches of two and of one; and something moves.
                    assert!((state.positions[0] - expected).abs() < 1e-5, "{dynamics:?}: {state:?} {expected}");
                    assert!((expected - seen[3]).abs() > 1e-4);
                }
            }
        }
    }
}

/// An angle and the same after full turns are one place to a black box.
#[test]
fn black_boxes_do_not_count_turns() {
    let options = ModelOptions { dynamics: DynamicsKind::Mlp, ..ModelOptions::original() };
    let net = PhysicsNet::new(&find("pendulum").unwrap().system, &options, Device::Cpu, 2).unwrap();
    let input = Tensor::from_slice(&[0.5f32, 0.4, 0.2, -0.1]).reshape([1, 4, 1]);
    let change = |input: &Tensor| net.roll_out(input, &Actions::none(), 1).1[0].vel.double_value(&[0, 0]);
    // The rounding of 4 pi + 0.5 in float32, by the time step.
    assert!((change(&input) - change(&(&input + 4.0 * PI))).abs() < 1e-4);
}

/// Every equation of the gallery about one object is the same in plain numbers, whatever it is integrated by.
#[test]
fn equations_of_text_are_the_same_in_plain_numbers() {
    let folder = project("configs");
    let files = ["gallery", "control"].map(|name| fs::read_dir(folder.join(name)).unwrap());
    let mut compared = 0;
    for file in files.into_iter().flatten().map(|entry| entry.unwrap().path()) {
        let Ok(task) = Task::from_toml(&fs::read_to_string(&file).unwrap()) else { continue };
        let (system, kind) = (&task.system, &task.system.cell);
        let unconstrained = kind.parameters.iter().map(|it| task.truth_of(&it.name).or(it.fixed).unwrap_or(1.0));
        let unconstrained: Vec<_> = unconstrained
            .zip(&*kind.parameters)
            .map(|(value, it)| Tensor::from(it.bounds.unconstrained(value) as f32))
            .collect();
        let cell = system.build_cell(&unconstrained);
        let Some(plain) = cell.plain() else {
            assert!(system.objects > 1 || kind.tells_time(), "{} has no plain form", task.name);
            continue;
        };
        let angle = kind.coordinates.per_object() == 1;
        let start =
            if angle { ControlState::turning(0.4, -1.0) } else { ControlState::new(vec![9.0, 21.0], vec![2.5, -1.0]) };
        let plans = Plans { actions: &[0.5, 0.0, -1.0, 0.0, 1.0, 0.0], candidates: 2, hold: 2 };
        let tensors = followed(&mut CellModel { cell: cell.as_ref(), dt: system.dt }, &start, &plans);
        let plain = followed(&mut PlainModel { cell: plain, dt: system.dt }, &start, &plans);
        for (plain, tensors) in plain.iter().flatten().zip(tensors.iter().flatten()) {
            // Some dozens of steps in float32 of numbers up to 64, and sines that are off by 1e-6.
            assert!(difference(plain, tensors) < 1e-3, "{}: {plain:?} and {tensors:?}", task.name);
        }
        compared += 1;
    }
    assert!(compared >= 8, "only {compared} equations have a plain form");
}

/// The mean return over the first episodes.
fn mean_return(environment: &mut dyn Environment, mut controller: Controller) -> f64 {
    (0..6).map(|seed| play(environment, &mut controller, seed, false).total).sum::<f64>() / 6.0
}

fn knowing(planner: Box<dyn Planner>) -> Controller<'static> {
    Controller::TrueState { model: Box::new(PendulumSettings::default().model()), planner }
}

#[test]
fn planning_with_the_truth_is_much_better_than_no_planning() {
    let mut world = pendulum(PendulumSettings::default(), upright());
    let planned = mean_return(&mut world, knowing(Box::new(CrossEntropy::new(small()))));
    let by_paths = mean_return(&mut world, knowing(Box::new(PathIntegral::new(small()))));
    let idle = mean_return(&mut world, Controller::Zero);
    let random = mean_return(&mut world, Controller::random());
    eprintln!("planned {planned}, by paths {by_paths}, zero {idle}, random {random}");
    assert!(planned > idle.max(random) + 8.0, "planned {planned}, zero {idle}, random {random}");
    assert!(by_paths > idle.max(random) + 8.0, "by path integrals {by_paths}, zero {idle}, random {random}");
}

#[test]
fn a_moving_goal_is_tracked_by_looking_ahead() {
    let rules = Rules { steps: 100, ..Rules::pendulum(GoalPath::angle(0.0).swinging(0.3, 50.0)) };
    let Reward::Goal(goal) = rules.reward.clone() else { unreachable!() };
    let near = PendulumSettings { largest_angle: 0.1, largest_rate: 0.2, ..PendulumSettings::default() };
    let mut world = pendulum(near, rules);
    let episode = play(&mut world, &mut knowing(Box::new(CrossEntropy::new(small()))), 1, false);
    let off = episode.states.iter().enumerate().skip(50).map(|(step, state)| goal.distance(state, step));
    let mean = off.sum::<f64>() / 51.0;
    // The goal's own mean distance from upright is 0.3 * 2 / pi = 0.19; a torque of 2 holds the pendulum at up to 0.41.
    assert!(mean < 0.1, "{mean} rad off");
}

fn puck() -> Task {
    find(project("configs/control/puck.toml").to_str().unwrap()).unwrap()
}

/// Another task, of positions and by an equation of text: only the world differs.
#[test]
fn a_puck_is_pushed_to_its_goal() {
    let task = puck();
    let goal = GoalPath::point([22.0, 16.0], 32.0);
    let rules = Rules { steps: 50, hold: 2, largest_action: 1.0, reward: Reward::Goal(goal), frames_before: 3 };
    let mut world = SceneEnvironment::new(&task, rules).unwrap();
    let planner = Box::new(CrossEntropy::new(SearchSettings { largest: 1.0, ..small() }));
    let model = SceneEnvironment::true_model(&task).unwrap();
    let mut controller = Controller::TrueState { model, planner };
    for seed in 0..3 {
        let episode = play(&mut world, &mut controller, seed, seed == 0);
        let last = episode.states.last().unwrap();
        // The other axis swings freely, and slowly comes to rest.
        assert!((last.positions[0] - 22.0).abs() < 0.7, "seed {seed}: ends at {last:?}");
        let idle = play(&mut world, &mut Controller::Zero, seed, false);
        assert!(episode.total > idle.total + 3.0, "seed {seed}: {} and {}", episode.total, idle.total);
        assert!(episode.states[0] == idle.states[0] && (seed > 0 || episode.frames.len() == 54));
    }
    // What is seen is the dataset's drawing of the same state.
    world.reset(3);
    let variant = Variant::new(&task, 0).unwrap();
    let state = world.true_state();
    let renderer = paig::generators::render::Renderer::new(&variant, &SourceImages::of(&variant).unwrap()).unwrap();
    let streams = Streams { seed: 0, split: Split::Test, index: 0, take: 0 };
    let point = paig::generators::simulate::SceneState { positions: state.positions, velocities: vec![], action: 0.0 };
    let film = renderer.draw(&[point], &streams).unwrap();
    let mut pixels = vec![0; 32 * 32];
    film.quantise(&mut pixels);
    let drawn = Tensor::from_slice(&pixels).reshape([1, 32, 32]).to_kind(Kind::Float) / 255.0;
    assert_eq!(world.observe(), Some(drawn));
}

/// The dataset of a task that is pushed holds the pushes, and they explain its motion.
#[test]
fn clips_of_the_puck_obey_their_pushes() {
    let task = puck();
    let variant = Variant::new(&task, 5).unwrap();
    let counts = Counts { train: 4, valid: 1, test: 1 };
    let (dataset, states) =
        generate_clips(&variant, &SourceImages::of(&variant).unwrap(), 14, counts, &|_| {}).unwrap();
    let [pushes, ..] = dataset.actions.unwrap();
    assert!(pushes.iter().all(|push| push.abs() <= 1.0) && pushes.iter().any(|push| push.abs() > 0.8));
    let tensor = |array: &ndarray::Array3<f32>| {
        let shape: Vec<i64> = array.shape().iter().map(|&n| n as i64).collect();
        Tensor::from_slice(array.as_slice().unwrap()).reshape(shape)
    };
    let (pos, vel) = (tensor(&states.train.positions), tensor(&states.train.velocities));
    let unconstrained = task.system.cell.parameters.iter().zip(&task.truth);
    let unconstrained: Vec<_> =
        unconstrained.map(|(it, truth)| Tensor::from(it.bounds.unconstrained(truth.value) as f32)).collect();
    let actions = Tensor::from_slice(pushes.as_slice().unwrap()).reshape([4, 14]);
    let first = State { pos: pos.select(1, 0), vel: vel.select(1, 0) };
    let rolled =
        task.system.build_cell(&unconstrained).roll_out(&first, &Actions::new(Some(actions)), task.system.dt, 13);
    for (frame, state) in (1..).zip(rolled) {
        let error = (pos.select(1, frame) - state.pos).abs().max().double_value(&[]);
        // Five Euler steps a frame against Runge and Kutta's method.
        assert!(error < 0.5, "frame {frame}: {error} px off");
    }
}

/// What the camera saw before an episode leads to where it begins.
#[test]
fn going_back_and_on_again_is_where_it_was() {
    let rules = Rules { largest_action: 1.0, ..Rules::pendulum(GoalPath::point([22.0, 16.0], 32.0)) };
    let worlds: [Box<dyn Environment>; 2] = [
        Box::new(pendulum(PendulumSettings::default(), upright())),
        Box::new(SceneEnvironment::new(&puck(), rules).unwrap()),
    ];
    for mut world in worlds {
        world.reset(6);
        let first = world.true_state();
        world.go_back(3);
        assert!(difference(&world.true_state(), &first) > 0.05, "nothing moved");
        (0..3).for_each(|_| _ = world.step(0.0));
        // Euler's step is undone exactly; that of Runge and Kutta to the fifth order of 0.03.
        assert!(difference(&world.true_state(), &first) < 1e-5, "{:?} and {first:?}", world.true_state());
    }
}

fn untrained() -> PhysicsNet {
    let task = find("pendulum").unwrap();
    let options = ModelOptions { refinement_steps: 2, exact_shift: true, ..ModelOptions::original() };
    PhysicsNet::new(&task.system, &options, Device::Cpu, 1).unwrap()
}

fn seeing(model: &PhysicsNet) -> Controller<'_> {
    Controller::seeing(Vision::new(model, FORMAT).unwrap(), Box::new(CrossEntropy::new(small())))
}

#[test]
fn an_episode_by_sight_repeats_to_the_bit() {
    let model = untrained();
    let faults = Faults { dropped: 0.2, hidden: 0.0 };
    let rules = Rules { steps: 12, ..upright() };
    let mut environment = FaultyCamera::new(Box::new(pendulum(PendulumSettings::default(), rules)), faults);
    let mut controller = seeing(&model).relearning(Relearning { names: vec!["g".into()], frames: 8 }).unwrap();
    let before = model.parameter_values();
    let mut episode = || -> Episode { play(&mut environment, &mut controller, 4, false) };
    let (first, second) = (episode(), episode());
    assert_eq!((first.total.to_bits(), &first.actions), (second.total.to_bits(), &second.actions));
    assert_eq!(first.notes, second.notes);
    assert_eq!((first.frames.len(), first.actions.len(), first.decisions), (16, 12, 6));
    controller.begin(5);
    assert_eq!(model.parameter_values(), before, "what one episode learned is forgotten in the next");
}

/// From the angles themselves, in the environment's own step, gravity is found again.
#[test]
fn gravity_is_learned_again_from_a_few_frames() {
    let model = untrained();
    model.set_value(&model.parameters[0], 10.0).unwrap();
    let relearning = Relearning { names: vec!["g".into()], frames: 25 };
    for gravity in [5.0, 15.0] {
        let settings = PendulumSettings { gravity, ..PendulumSettings::default() };
        let episode = play(&mut pendulum(settings, upright()), &mut Controller::random(), 3, false);
        let angles: Vec<f64> = episode.states[..25].iter().map(|state| state.positions[0]).collect();
        let angles = Tensor::from_slice(&angles).reshape([1, 25, 1]);
        relearning.learn(&model, &angles, angles.ones_like().squeeze_dim(2), &episode.actions).unwrap();
        let values = model.parameter_values();
        // The model takes five steps where the environment takes one: an error of the order of the step.
        assert!((values[0].1 / gravity - 1.0).abs() < 0.05, "{values:?} instead of {gravity}");
        assert_eq!(values[1].1, 1.0, "only what is named is learned");
    }
    let due =
        [(6, 0), (7, 0), (12, 7), (14, 7), (30, 7), (30, 25)].map(|(frames, so_far)| relearning.due(frames, so_far));
    assert_eq!(due, [None, Some(7), None, Some(13), Some(25), None]);
    assert!(Relearning { names: vec!["k".into()], frames: 25 }.check(&model).is_err());
}

#[test]
fn frames_without_a_number_or_none_at_all_are_a_lost_pendulum() {
    let model = untrained();
    let vision = Vision::new(&model, FORMAT).unwrap();
    let nothing = Tensor::full([4, 3, 64, 64], f64::NAN, (Kind::Float, Device::Cpu));
    assert_eq!(vision.places(&nothing), vec![None; 4]);
    let frames: Vec<_> = (0..4).map(|frame| Some(nothing.get(frame))).collect();
    let environment = pendulum(PendulumSettings::default(), upright());
    assert_eq!(seeing(&model).decide(&environment, 0, &frames, &[0.0; 3]), Decision::Lost);
    let none: Vec<Option<Tensor>> = (0..4).map(|_| None).collect();
    assert_eq!(seeing(&model).decide(&environment, 0, &none, &[0.0; 3]), Decision::Lost);
    assert_eq!(seeing(&model).decide(&environment, 0, &[], &[]), Decision::Lost);
}

/// What is not seen is foretold from the last sight, for a while.
#[test]
fn a_missing_frame_is_foretold() {
    let model = untrained();
    let mut world = pendulum(PendulumSettings::default(), upright());
    world.reset(2);
    let mut frames: Vec<_> = (0..4)
        .map(|_| {
            let frame = world.observe();
            world.step(0.5);
            frame
        })
        .collect();
    let mut eyes = Eyes::new(Vision::new(&model, FORMAT).unwrap());
    let mut physics = model::of_cell(model.cell.as_ref(), 0.05);
    let mut actions = vec![0.5; 3];
    let StateSource::Seen(seen) = eyes.look(&frames, &actions, physics.as_mut()) else { panic!("not seen") };
    for missing in 1..=12 {
        frames.push(None);
        actions.push(-0.25);
        let sight = eyes.look(&frames, &actions, physics.as_mut());
        if missing > 10 {
            assert_eq!(sight, StateSource::Lost, "{missing} frames without a sight");
            continue;
        }
        let StateSource::Foretold(state, ago) = sight else { panic!("{missing}: {sight:?}") };
        let expected = physics.follow(&seen, &vec![-0.25; missing]).unwrap().pop().unwrap();
        assert_eq!(ago, missing);
        assert!(difference(&state, &expected) < 1e-4, "{state:?} and {expected:?}");
    }
}

/// The state comes from the last L frames and from what acted between them, not at the beginning of the episode.
#[test]
fn the_last_frames_are_seen_with_their_own_actions() {
    let model = untrained();
    let mut world = pendulum(PendulumSettings::default(), upright());
    world.reset(2);
    let actions = [2.0, -1.0, 0.5, -2.0, 1.5];
    let mut frames = vec![world.observe()];
    for action in actions {
        world.step(action);
        frames.push(world.observe());
    }
    let mut physics = model::of_cell(model.cell.as_ref(), 0.05);
    let mut eyes = Eyes::new(Vision::new(&model, FORMAT).unwrap());
    let sight = eyes.look(&frames, &actions, physics.as_mut());
    let all = Tensor::stack(&frames.iter().flatten().collect::<Vec<_>>(), 0);
    let places: Vec<_> = eyes.vision.places(&all).into_iter().map(|places| places.expect("seen")).collect();
    let last: Vec<_> = places[2..].iter().collect();
    let state = |actions: &[f64]| eyes.vision.state(&last, actions).unwrap();
    assert_eq!(sight, StateSource::Seen(state(&actions[2..])));
    assert!(difference(&state(&actions[2..]), &state(&actions[..3])) > 1e-3, "actions change nothing here");
}

#[test]
fn a_fast_start_and_a_faulty_camera_end_without_a_panic() {
    let model = untrained();
    let settings = PendulumSettings { rate: Some(8.0), ..PendulumSettings::default() };
    for faults in [Faults { dropped: 0.5, hidden: 0.5 }, Faults { dropped: 1.0, hidden: 0.0 }] {
        let rules = Rules { steps: 10, ..upright() };
        let mut world = FaultyCamera::new(Box::new(pendulum(settings, rules)), faults);
        let episode = play(&mut world, &mut seeing(&model), 1, false);
        assert!(episode.states[0].velocities[0].abs() == 8.0 && episode.total.is_finite());
        if faults.dropped == 1.0 {
            assert_eq!((episode.actions.as_slice(), episode.notes.len()), ([0.0; 10].as_slice(), 5));
        }
    }
}

/// A model that foretells no numbers, or fails, from a call on.
struct Broken {
    fails: bool,
    works_for: usize,
}

impl PlanningModel for Broken {
    fn roll_out(&mut self, start: &ControlState, plans: &Plans, into: &mut Trajectories) -> Result<()> {
        if self.works_for > 0 {
            self.works_for -= 1;
            return PendulumSettings::default().model().roll_out(start, plans, into);
        }
        if self.fails {
            bail!("no roll-out");
        }
        into.make_room(plans.candidates, 1, plans.steps());
        for step in 0..plans.steps() {
            into.step_mut(step).into_iter().for_each(|all| all.fill(f32::NAN));
        }
        Ok(())
    }
}

#[test]
fn without_a_plan_the_torque_is_held_then_0_and_a_note_says_so() {
    let mut environment = pendulum(PendulumSettings::default(), Rules { steps: 14, ..upright() });
    for (fails, paths) in [(false, false), (true, false), (false, true)] {
        let planner: Box<dyn Planner> =
            if paths { Box::new(PathIntegral::new(small())) } else { Box::new(CrossEntropy::new(small())) };
        // As many iterations as a decision has: the first one is planned.
        let model = Broken { fails, works_for: small().iterations };
        let mut controller = Controller::TrueState { model: Box::new(model), planner };
        let episode = play(&mut environment, &mut controller, 0, false);
        let first = episode.actions[0];
        assert!(first != 0.0 && episode.total.is_finite());
        assert_eq!(episode.actions[..8], [first; 8]);
        assert_eq!(episode.actions[8..], [0.0; 6]);
        assert_eq!(episode.notes.len(), 6, "{:?}", episode.notes);
    }
}

#[test]
fn a_model_of_another_system_is_refused() {
    let task = find("spring_color").unwrap();
    let model = PhysicsNet::new(&task.system, &ModelOptions::original(), Device::Cpu, 0).unwrap();
    let error = Vision::new(&model, FORMAT).unwrap_err().to_string();
    assert!(error.contains("actions"), "{error}");
    let settings = PendulumSettings { length: 3.0, ..PendulumSettings::default() };
    assert!(PendulumEnvironment::new(settings, upright()).is_err());
    assert!(SceneEnvironment::new(&task, upright()).is_err());
}

#[test]
fn an_interval_holds_the_mean() {
    let returns: Vec<f64> = (0..100).map(f64::from).collect();
    let [mean, low, high] = mean_and_interval(&returns, 0).unwrap();
    assert_eq!(mean, 49.5);
    // Standard error 2.9: 1.96 of them to each side, give or take what a draw of 2000 leaves open.
    assert!((mean - low - 5.66).abs() < 0.7 && (high - mean - 5.66).abs() < 0.7, "{low} {high}");
    assert_eq!(mean_and_interval(&[], 0), None);
}

/// A run that takes seconds.
const TINY: &str = "[discover]\nframes = 4\nmax_steps = 2\n[identify]\nclips = 2\nhorizons = [3]\nmax_iterations = 1\n\
    [join]\nbatch = 2\nmax_steps = 2\nvalidation_clips = 2\n[output]\nexamples = 0\n";

/// The program plays the lines of a study, with a run of its own, into files; again it takes over what it played.
#[test]
fn a_study_is_played_once() {
    let folder = tempfile::tempdir().unwrap();
    let call = |program: &str, arguments: &str| {
        let done = paig(program).args(arguments.split(' ')).current_dir(folder.path()).output().unwrap();
        let said = String::from_utf8_lossy(&done.stdout).into_owned() + &String::from_utf8_lossy(&done.stderr);
        assert!(done.status.success(), "{arguments}: {said}");
        said
    };
    let file = |name: &str| folder.path().join(name);
    fs::write(file("tiny.toml"), TINY).unwrap();
    let study = "[[play]]\nname = \"still\"\narguments = \"--planner zero --episodes 2 --steps 4 --goal 20\"\n\
        [[play]]\nname = \"seen\"\narguments = \"run --planner learned --episodes 1 --steps 4\"\n";
    fs::write(file("study.toml"), study).unwrap();
    call("generate", "--task pendulum --train 20 --valid 4 --test 4 --out data");
    call("train", "--task pendulum --data data --config tiny.toml --threads 1 --out run");
    call("control", "--study study.toml --out played");
    for name in ["results.json", "still/goal.png", "still/zero.gif", "still/returns.png", "seen/course.png"] {
        assert!(file("played").join(name).exists(), "{name} is missing");
    }
    let before = fs::read_to_string(file("played/results.json")).unwrap();
    let rows = &serde_json::from_str::<serde_json::Value>(&before).unwrap()["rows"];
    let planners: Vec<_> = rows.as_array().unwrap().iter().map(|row| row["planner"].as_str().unwrap()).collect();
    assert_eq!(planners, ["zero", "learned"]);
    assert_eq!((rows[0]["goal"].as_f64(), rows[1]["clips"].as_u64()), (Some(20.0), Some(20)));
    // Times would differ if anything were played again.
    let said = call("control", "--study study.toml --out played --resume");
    assert_eq!(said.matches("played before").count(), 2, "{said}");
    assert_eq!(fs::read_to_string(file("played/results.json")).unwrap(), before);
    // Without a folder the results lie beside the run.
    call("control", "run --planner zero --episodes 1 --steps 4");
    assert!(file("run/control/results.json").exists());
}
