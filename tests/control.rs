//! Control of a pendulum: the environment by its formula, what is seen, the planners, and what goes wrong.

use std::f64::consts::PI;

use anyhow::{Result, bail};
use paig::control::controller::{Controller, Decision};
use paig::control::environment::{Environment, PendulumEnvironment, PendulumSettings, SIDE};
use paig::control::episode::{Episode, play};
use paig::control::model::{CellModel, Model, Plans, Trajectories};
use paig::control::mppi::PathIntegral;
use paig::control::pendulum_model::PendulumModel;
use paig::control::planner::CrossEntropy;
use paig::control::results::mean_and_interval;
use paig::control::reward::{PendulumState, Reward, wrapped};
use paig::control::search::{Planner, SearchSettings};
use paig::control::vision::Vision;
use paig::datasets::files::Split;
use paig::generators::source_images::SourceImages;
use paig::generators::streams::{Purpose, Streams};
use paig::generators::variant::Variant;
use paig::generators::{Counts, generate_clips};
use paig::network::cells::{PENDULUM, Walls};
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::tasks::find;
use tch::{Device, Kind, Tensor};

fn upright() -> PendulumSettings {
    PendulumSettings::to_goal(0.0)
}

/// Far fewer plans than by default, so that an episode takes a fraction of a second.
fn small() -> SearchSettings {
    SearchSettings { candidates: 200, iterations: 4, ..SearchSettings::default() }
}

#[test]
fn a_step_is_the_closed_formula() {
    let settings = PendulumSettings { gravity: 9.0, length: 1.2, mass: 0.8, ..PendulumSettings::to_goal(0.5) };
    let mut environment = PendulumEnvironment::new(settings).unwrap();
    for (angle, rate, torque) in [(0.3, -1.0, 1.5), (3.0, 7.9, 2.0), (-2.0, -7.9, -9.0)] {
        environment.place(PendulumState { angle, rate });
        let reward = environment.step(torque);
        let held = f64::clamp(torque, -2.0, 2.0);
        let faster = rate + (3.0 * 9.0 / (2.0 * 1.2) * f64::sin(angle) + 3.0 * held / (0.8 * 1.2 * 1.2)) * 0.05;
        let expected = PendulumState { angle: angle + 0.05 * faster, rate: faster.clamp(-8.0, 8.0) };
        let found = environment.true_state();
        // The same numbers in another order of multiplication.
        assert!((found.angle - expected.angle).abs() < 1e-12 && (found.rate - expected.rate).abs() < 1e-12);
        assert!((reward - (1.0 - wrapped(expected.angle - 0.5).abs() / PI)).abs() < 1e-12);
    }
    environment.place(PendulumState { angle: 0.1, rate: 0.0 });
    let mut same = environment.clone();
    assert_eq!(environment.step(f64::NAN), same.step(0.0));
}

#[test]
fn gymnasiums_cost_is_that_of_the_state_before_the_step() {
    let mut environment = PendulumEnvironment::new(PendulumSettings::gymnasium()).unwrap();
    environment.place(PendulumState { angle: PI + 0.5, rate: 2.0 });
    let cost = (PI - 0.5).powi(2) + 0.1 * 4.0 + 0.001;
    assert!((environment.step(1.0) + cost).abs() < 1e-12);
    assert_eq!(environment.steps(), 200);
}

#[test]
fn episodes_begin_within_their_range_and_by_their_seed() {
    let mut environment = PendulumEnvironment::new(upright()).unwrap();
    let mut starts = |seed| {
        environment.reset(seed);
        environment.true_state()
    };
    let drawn: Vec<_> = (0..200).map(&mut starts).collect();
    assert!(drawn.iter().all(|state| state.angle.abs() <= PI / 2.0 && state.rate.abs() <= 2.0));
    assert!(drawn.iter().any(|state| state.angle > 1.3) && drawn.iter().any(|state| state.rate < -1.7));
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
    let mut environment = PendulumEnvironment::new(upright()).unwrap();
    for (frame, state) in clip.iter().enumerate() {
        environment.place(PendulumState { angle: state.positions[0], rate: state.velocities[0] });
        let pixels: Vec<u8> =
            dataset.train.index_axis(ndarray::Axis(0), 0).index_axis(ndarray::Axis(0), frame).iter().copied().collect();
        let side = SIDE as i64;
        let drawn =
            Tensor::from_slice(&pixels).reshape([side, side, 3]).permute([2, 0, 1]).to_kind(Kind::Float) / 255.0;
        assert_eq!(environment.observe(), drawn, "frame {frame}");
    }
}

/// Plain numbers and tensors are the same equation; and one Euler step of it is the environment's.
#[test]
fn the_models_agree() {
    let (g, a, dt): (f64, f64, f64) = (9.0, 1.3, 0.05);
    let cell = PENDULUM.cell(&[g, a].map(|x| Tensor::from(x.ln() as f32)), Walls::new(SIDE, 0.0));
    let torques = [0.5, -1.0, 2.0, 1.5, 0.0, -2.0];
    let plans = Plans { torques: &torques, decisions: 3, hold: 2 };
    let start = PendulumState { angle: 0.4, rate: -1.0 };
    let tensors = CellModel { cell: cell.as_ref(), dt }.roll_out(start, &plans).unwrap();
    let plain = PendulumModel::of_cell(g, a, dt).roll_out(start, &plans).unwrap();
    assert_eq!((plain.angles.len(), tensors.rates.len()), (12, 12));
    for (plain, tensors) in plain.angles.iter().chain(&plain.rates).zip(tensors.angles.iter().chain(&tensors.rates)) {
        // Thirty Euler steps in float32.
        assert!((plain - tensors).abs() < 1e-4, "{plain} and {tensors}");
    }
    let mut environment = PendulumEnvironment::new(upright()).unwrap();
    let model = PendulumModel::of_environment(&upright()).roll_out(start, &plans).unwrap();
    let total: Vec<f64> = torques
        .chunks(3)
        .zip(model.angles.chunks(6))
        .map(|(torques, angles)| {
            environment.place(start);
            let steps = angles.iter().enumerate().map(|(step, angle)| {
                let reward = environment.step(f64::from(torques[step / 2]));
                assert!((environment.true_state().angle - f64::from(*angle)).abs() < 1e-4, "step {step}");
                reward
            });
            steps.sum()
        })
        .collect();
    for (found, expected) in model.returns(start, &plans, Reward::Goal(0.0)).iter().zip(total) {
        assert!((found - expected).abs() < 1e-4, "{found} instead of {expected}");
    }
}

/// The mean return over the first episodes.
fn mean_return(settings: PendulumSettings, mut controller: Controller) -> f64 {
    let mut environment = PendulumEnvironment::new(settings).unwrap();
    (0..6).map(|seed| play(&mut environment, &mut controller, seed, false).total).sum::<f64>() / 6.0
}

fn knowing(settings: PendulumSettings, planner: Box<dyn Planner>) -> Controller<'static> {
    Controller::TrueState { model: Box::new(PendulumModel::of_environment(&settings)), planner }
}

#[test]
fn planning_with_the_truth_is_much_better_than_no_planning() {
    let settings = upright();
    let planned = mean_return(settings, knowing(settings, Box::new(CrossEntropy::new(small()))));
    let by_paths = mean_return(settings, knowing(settings, Box::new(PathIntegral::new(small()))));
    let idle = mean_return(settings, Controller::Zero);
    let random = mean_return(settings, Controller::random());
    eprintln!("planned {planned}, by paths {by_paths}, zero {idle}, random {random}");
    assert!(planned > idle.max(random) + 8.0, "planned {planned}, zero {idle}, random {random}");
    assert!(by_paths > idle.max(random) + 8.0, "by path integrals {by_paths}, zero {idle}, random {random}");
}

fn untrained() -> PhysicsNet {
    let task = find("pendulum").unwrap();
    let options = ModelOptions { refinement_steps: 2, exact_shift: true, ..ModelOptions::original() };
    PhysicsNet::new(&task.system, &options, Device::Cpu, 1).unwrap()
}

#[test]
fn an_episode_by_sight_repeats_to_the_bit_and_begins_without_torque() {
    let model = untrained();
    let settings = PendulumSettings { steps: 10, ..upright() };
    let mut environment = PendulumEnvironment::new(settings).unwrap();
    let mut episode = || -> Episode {
        let vision = Vision::new(&model).unwrap();
        let planner = Box::new(CrossEntropy::new(small()));
        let plan_with = Box::new(PendulumModel::of_cell(10.0, 1.0, 0.05));
        play(&mut environment, &mut Controller::Seeing { vision, model: plan_with, planner }, 4, false)
    };
    let (first, second) = (episode(), episode());
    assert_eq!((first.total.to_bits(), &first.torques), (second.total.to_bits(), &second.torques));
    assert_eq!((first.frames.len(), first.torques.len(), first.decisions), (11, 10, 3));
    assert!(first.torques[..4].iter().all(|torque| *torque == 0.0), "{:?}", first.torques);
}

#[test]
fn frames_without_a_number_are_a_lost_pendulum() {
    let model = untrained();
    let vision = Vision::new(&model).unwrap();
    let nothing = Tensor::full([4, 3, 64, 64], f64::NAN, (Kind::Float, Device::Cpu));
    assert_eq!(vision.state(&nothing, &[0.0; 3]), None);
    let frames: Vec<Tensor> = (0..4).map(|frame| nothing.get(frame)).collect();
    let planner = Box::new(CrossEntropy::new(small()));
    let plan_with = Box::new(PendulumModel::of_cell(10.0, 1.0, 0.05));
    let mut controller = Controller::Seeing { vision, model: plan_with, planner };
    let environment = PendulumEnvironment::new(upright()).unwrap();
    assert_eq!(controller.decide(&environment, &frames, &[0.0; 3]), Decision::Lost);
}

/// A model that foretells no numbers, or fails.
struct Broken {
    fails: bool,
}

impl Model for Broken {
    fn roll_out(&self, _: PendulumState, plans: &Plans) -> Result<Trajectories> {
        if self.fails {
            bail!("no roll-out");
        }
        let states = vec![f32::NAN; plans.candidates() * plans.steps()];
        Ok(Trajectories { angles: states.clone(), rates: states })
    }
}

#[test]
fn without_a_plan_the_torque_is_held_and_a_note_says_so() {
    let mut environment = PendulumEnvironment::new(PendulumSettings { steps: 6, ..upright() }).unwrap();
    for (fails, paths) in [(false, false), (true, false), (false, true)] {
        let planner: Box<dyn Planner> =
            if paths { Box::new(PathIntegral::new(small())) } else { Box::new(CrossEntropy::new(small())) };
        let mut controller = Controller::TrueState { model: Box::new(Broken { fails }), planner };
        let episode = play(&mut environment, &mut controller, 0, false);
        assert_eq!((episode.torques.as_slice(), episode.notes.len()), ([0.0; 6].as_slice(), 3));
        assert!(episode.total.is_finite());
    }
}

#[test]
fn a_model_of_another_system_is_refused() {
    let task = find("spring_color").unwrap();
    let model = PhysicsNet::new(&task.system, &ModelOptions::original(), Device::Cpu, 0).unwrap();
    let error = Vision::new(&model).unwrap_err().to_string();
    assert!(error.contains("pendulum"), "{error}");
    assert!(PendulumEnvironment::new(PendulumSettings { length: 3.0, ..upright() }).is_err());
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
