//! The latent model: its divergence in closed form, planning by its rewards, and a small training that can be cut off.

use std::cell::Cell;
use std::path::Path;

use crate::random::numbers;
use ndarray::{Array2, Array5};
use paig::datasets::iterators::Clips;
use paig::kernels::Kernels;
use paig::network::System;
use paig::network::cells::Actions;
use paig::support::random::normal;
use paig::tasks::find;
use paig::training::base::TrainingOutcome;
use paig_experiments::baselines::end_to_end::checkpoint::load_weights;
use paig_experiments::baselines::end_to_end::config::{EndToEndConfig, EndToEndModel};
use paig_experiments::baselines::end_to_end::frame_model::{Batch, FrameModel, named_variables};
use paig_experiments::baselines::end_to_end::gaussian::{Gaussian, normal_numbers};
use paig_experiments::baselines::end_to_end::planet::Planet;
use paig_experiments::baselines::end_to_end::scores::EndToEndScores;
use paig_experiments::baselines::end_to_end::training::{self, EndToEndData};
use paig_experiments::control::latent::LatentModel;
use paig_experiments::control::model::{PlanStart, PlanningModel};
use paig_experiments::control::plans::{Plans, Trajectories};
use paig_experiments::control::reward::{GoalPath, Reward};
use paig_experiments::control::state::ControlState;
use tch::{Device, Tensor};

const TIME: usize = 14;

/// The pendulum's, in small frames.
fn system() -> System {
    System { side: 16, ..find("pendulum").unwrap().system }
}

fn gaussian(mean: &[f32], deviation: &[f32]) -> Gaussian {
    let row = |numbers: &[f32]| Tensor::from_slice(numbers).unsqueeze(0);
    Gaussian { mean: row(mean), log_variance: row(deviation).log() * 2.0 }
}

#[test]
fn the_divergence_is_its_closed_form_and_never_negative() {
    let (q, p) = (gaussian(&[1.0, -0.5], &[0.5, 2.0]), gaussian(&[0.0, 0.25], &[1.5, 1.0]));
    let of_one = |m: f64, s: f64, n: f64, t: f64| (t / s).ln() + (s * s + (m - n).powi(2)) / (2.0 * t * t) - 0.5;
    let expected = of_one(1.0, 0.5, 0.0, 1.5) + of_one(-0.5, 2.0, 0.25, 1.0);
    // A few float32 operations on numbers of about 1.
    assert!((q.divergence_from(&p).double_value(&[0]) - expected).abs() < 1e-5);
    assert_eq!(q.divergence_from(&q).double_value(&[0]), 0.0);
    let standard = gaussian(&[0.0, 0.0], &[1.0, 1.0]);
    assert!((q.divergence_from(&standard) - q.divergence()).abs().double_value(&[0]) < 1e-5);
    let random = |seed: u64| {
        let of = |purpose: &str| numbers(seed, purpose, &[1000, 10], |random| normal(random) as f32);
        Gaussian { mean: of("mean") * 2.0, log_variance: of("log variance") }
    };
    assert!(random(0).divergence_from(&random(1)).min().double_value(&[]) > 0.0);
}

/// Clips of a light spot that goes as it is pushed, their pushes, and what the frames are worth: more to the right.
fn spots(count: usize) -> (Clips, Tensor) {
    let mut pixels = Array5::zeros([count, TIME, 16, 16, 3]);
    let mut pushes = Array2::zeros([count, TIME]);
    let mut worths = Vec::new();
    for clip in 0..count {
        let mut place = 3 + (5 * clip) % 10;
        for frame in 0..TIME {
            pixels.slice_mut(ndarray::s![clip, frame, 6..9, place - 1..place + 2, ..]).fill(255u8);
            worths.push(place as f32 / 16.0);
            let push = if (clip * 7 + frame / 3 * 5) % 2 == 0 { 1.0 } else { -1.0 };
            pushes[[clip, frame]] = push;
            place = (place as f32 + push).clamp(2.0, 13.0) as usize;
        }
    }
    (Clips::new(&pixels, Some(&pushes), Device::Cpu), Tensor::from_slice(&worths).reshape([count as i64, TIME as i64]))
}

fn config(steps: u64) -> EndToEndConfig {
    EndToEndConfig {
        model: EndToEndModel::Planet,
        task: "pendulum".into(),
        data: "spots".into(),
        seed: 5,
        learning_rate: 3e-3,
        batch: 8,
        steps,
        checkpoint_every: 50,
        kernels: Kernels::Own,
    }
}

/// Trains in a folder; stops after so many steps, if any are given. Tells after which steps it was validated, too.
fn train(config: &EndToEndConfig, folder: &Path, until: Option<u64>) -> (Planet, TrainingOutcome, Vec<u64>) {
    let (clips, rewards) = spots(16);
    let data = EndToEndData { train: &clips, rewards: Some(&rewards), valid: &clips, test: &clips, checksums: "" };
    let asked = Cell::new(0);
    let stop = || {
        asked.set(asked.get() + 1);
        until.is_some_and(|until| asked.get() >= until)
    };
    let mut validated = Vec::new();
    let outcome =
        training::train(config, &system(), data, folder, &stop, &mut |record| validated.push(record.step)).unwrap();
    let planet = Planet::new(&system(), 99, Device::Cpu);
    load_weights(folder, &planet).unwrap();
    (planet, outcome, validated)
}

fn loss(planet: &Planet) -> f64 {
    let _guard = tch::no_grad_guard();
    let ((clips, rewards), all) = (spots(16), Vec::from_iter(0..16));
    let batch = Batch {
        frames: clips.batch(&all, TIME),
        actions: clips.actions(&all),
        rewards: Some(rewards),
        noise: Some(normal_numbers(5, 0, planet.draws(16, TIME))),
    };
    planet.loss(&batch).double_value(&[])
}

/// What each of two pushes is worth over some steps, after a clip's first frames.
fn worth_of_pushes(planet: Planet) -> [f32; 2] {
    let (clips, _) = spots(1);
    let seen: Vec<_> = (0..4).map(|frame| Some(clips.batch(&[0], 4).get(0).get(frame))).collect();
    let pushes: Vec<f64> = (0..3).map(|frame| clips.actions(&[0]).at(frame).unwrap().double_value(&[0, 0])).collect();
    let mut model = LatentModel::new(planet);
    model.see(&seen, &pushes);
    let reward = Reward::Goal(GoalPath::angle(0.0));
    let nowhere = ControlState::new(Vec::new(), Vec::new());
    let outset = PlanStart { state: &nowhere, step: 0, reward: &reward };
    let mut returns = [0.0; 2];
    let plans = Plans { actions: &[1.0, -1.0, 1.0, -1.0], candidates: 2, hold: 2 };
    model.returns(outset, &plans, &mut Trajectories::default(), &mut returns).unwrap();
    assert!(model.follow(&nowhere, &[1.0]).is_err());
    returns
}

/// A small training lowers the loss, and then plans to the right are worth more. Cut off and gone on with it ends with the
/// same bits.
#[test]
fn a_small_training_learns_what_pushes_are_worth_and_can_be_cut_off() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, cut] = ["whole", "cut"].map(|name| folder.path().join(name));
    let config = config(200);
    let before = loss(&Planet::new(&system(), config.seed, Device::Cpu));
    let (planet, outcome, validated) = train(&config, &whole, None);
    assert_eq!(outcome, TrainingOutcome::Finished);
    let after = loss(&planet);
    assert!(after < 0.3 * before, "{before} to {after}");
    assert_eq!(train(&config, &cut, Some(70)).1, TrainingOutcome::Interrupted);
    let (gone_on, _, validated_again) = train(&config, &cut, None);
    assert_eq!((validated, validated_again), (vec![0, 50, 100, 150, 200], vec![100, 150, 200]));
    for ((name, one), (_, other)) in named_variables(&planet).iter().zip(&named_variables(&gone_on)) {
        assert_eq!(one, other, "{name}");
    }
    assert_eq!(EndToEndScores::read(&cut).unwrap().unwrap().training_clips, 16);
    let [right, left] = worth_of_pushes(planet);
    assert!(right > left, "{right} and {left}");
}

/// The rewards of plans are those of the beliefs that are imagined, candidate by candidate.
#[test]
fn plans_are_worth_the_rewards_that_are_imagined() {
    let _guard = tch::no_grad_guard();
    let planet = Planet::new(&system(), 1, Device::Cpu);
    let (clips, _) = spots(1);
    let frames = clips.batch(&[0], 4).get(0);
    let scalar = |x: f64| Tensor::from(x as f32).reshape([1, 1]);
    let mut belief = planet.start(1);
    for frame in 0..4 {
        let acted = if frame == 0 { 0.0 } else { clips.actions(&[0]).at(frame - 1).unwrap().double_value(&[0, 0]) };
        belief = planet.see(&belief, &scalar(acted), &frames.get(frame as i64).unsqueeze(0));
    }
    let mut expected = [0.0; 2];
    for (expected, push) in expected.iter_mut().zip([1.0, -1.0]) {
        let mut ahead = belief.repeated(1);
        for _ in 0..4 {
            ahead = planet.imagine(&ahead, &scalar(push));
            *expected += planet.reward(&ahead).double_value(&[0]);
        }
    }
    let found = worth_of_pushes(Planet::new(&system(), 1, Device::Cpu));
    // Float32 in batches of two and of one.
    for (found, expected) in found.iter().zip(expected) {
        assert!((f64::from(*found) - expected).abs() < 1e-4, "{found} {expected}");
    }
    assert!((expected[0] - expected[1]).abs() > 1e-3);
}

/// Frames after the input change no prediction; a longer one begins as a shorter one.
#[test]
fn the_latent_model_predicts_from_the_input_alone() {
    let _guard = tch::no_grad_guard();
    let planet = Planet::new(&system(), 1, Device::Cpu);
    let input = spots(2).0.batch(&[0, 1], 4);
    let (short, long) = (planet.predict(&input, &Actions::none(), 3), planet.predict(&input, &Actions::none(), 6));
    assert_eq!(long.size(), [2, 6, 3, 16, 16]);
    assert!((long.narrow(1, 0, 3) - short).abs().max().double_value(&[]) < 1e-6);
}
