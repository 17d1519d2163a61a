//! Black-box dynamics, the black-box decoder and separate gradients: closed forms, symmetries, who learns from what.

use crate::random::numbers;
use paig::network::cells::Actions;
use paig::network::dynamics::DynamicsKind;
use paig::network::physics_models::losses::{Losses, latent_error};
use paig::network::physics_models::{DecoderKind, GradientPaths, ModelOptions, PhysicsNet, VariableGroup};
use paig::tasks;
use paig::training::optimizers::{Optimizer, OptimizerKind};
use rand::Rng;
use tch::{Device, Kind, Tensor};

const BLACK_BOXES: [DynamicsKind; 5] =
    [DynamicsKind::Lstm, DynamicsKind::Gru, DynamicsKind::InteractionNetwork, DynamicsKind::Mlp, DynamicsKind::Linear];

fn model(task: &str, dynamics: DynamicsKind, decoder: DecoderKind) -> PhysicsNet {
    let options = ModelOptions { dynamics, decoder, exact_shift: true, ..ModelOptions::original() };
    PhysicsNet::new(&tasks::builtin(task).unwrap().system, &options, Device::Cpu, 1).unwrap()
}

fn black_box(task: &str, dynamics: DynamicsKind) -> PhysicsNet {
    model(task, dynamics, DecoderKind::CoordinateConsistent)
}

fn weights(model: &PhysicsNet, group: VariableGroup) -> usize {
    let variables = model.named_variables().into_iter().filter(|(name, _)| model.group(name) == group);
    variables.map(|(_, variable)| variable.numel()).sum()
}

/// Paths of uniform motion, `[batch, frames, coordinates]`, pixels.
fn uniform_motion(batch: i64, frames: i64, coordinates: i64, seed: u64) -> Tensor {
    let between = |purpose: &str, low: f32, high: f32| {
        numbers(seed, purpose, &[batch, 1, coordinates], |random| random.random_range(low..high))
    };
    let time = Tensor::arange(frames, (Kind::Float, Device::Cpu)).reshape([1, -1, 1]);
    between("start", 8.0, 24.0) + between("speed", -1.0, 1.0) * time
}

/// Clips of a spring's frames that are noise, `[batch, frames, 3, 32, 32]`.
fn noise(batch: i64, frames: i64) -> Tensor {
    numbers(0, "noise", &[batch, frames, 3, 32, 32], |random| random.random::<f32>())
}

/// A linear predictor with the weights of `change = p_t - p_{t-1}` goes on in a straight line for ever.
#[test]
fn linear_dynamics_can_be_uniform_motion() {
    let model = black_box("spring_color", DynamicsKind::Linear);
    {
        let _guard = tch::no_grad_guard();
        let variables = model.named_variables();
        let (_, kernel) = variables.iter().find(|(name, _)| name == "dynamics.dense.weight").unwrap();
        // [4, L * 4]: the last two of the four frames.
        let one = Tensor::eye(4, (Kind::Float, Device::Cpu));
        let none = Tensor::zeros([4, 8], (Kind::Float, Device::Cpu));
        kernel.shallow_clone().copy_(&Tensor::cat(&[&none, &-&one, &one], 1));
    }
    let paths = uniform_motion(3, 14, 4, 0);
    let (initial, states) = model.roll_out(&paths.narrow(1, 0, 4), &Actions::none(), 10);
    let rolled = Tensor::stack(&states.iter().map(|state| state.pos.shallow_clone()).collect::<Vec<_>>(), 1);
    // Ten float32 sums of numbers up to 32.
    assert!((rolled - paths.narrow(1, 4, 10)).abs().max().double_value(&[]) < 1e-4);
    let speed = (paths.select(1, 1) - paths.select(1, 0)) / model.system.dt;
    for state in std::iter::once(&initial).chain(&states) {
        assert!((&state.vel - &speed).abs().max().double_value(&[]) < 1e-3);
    }
}

/// Objects have no order for an interaction network: what is said of them follows them.
#[test]
fn interaction_network_does_not_know_the_order_of_objects() {
    let model = black_box("3bp_color", DynamicsKind::InteractionNetwork);
    let paths = uniform_motion(5, 4, 6, 1);
    let order = Tensor::from_slice(&[4i64, 5, 0, 1, 2, 3]);
    let rolled = |paths: &Tensor| model.roll_out(paths, &Actions::none(), 3).1.pop().unwrap().pos;
    let (there, here) = (rolled(&paths.index_select(2, &order)), rolled(&paths).index_select(1, &order));
    assert!((there - &here).abs().max().double_value(&[]) < 1e-4);
    // It is not that nothing happens.
    assert!((here - paths.select(1, 3).index_select(1, &order)).abs().max().double_value(&[]) > 0.1);
}

/// Each sees every one of the L input frames.
#[test]
fn every_input_frame_counts() {
    for kind in BLACK_BOXES {
        let model = black_box("spring_color", kind);
        let paths = uniform_motion(2, 4, 4, 2).set_requires_grad(true);
        let last = model.roll_out(&paths, &Actions::none(), 2).1.pop().unwrap().pos;
        last.sum(Kind::Float).backward();
        let by_frame = paths.grad().abs().sum_dim_intlist([0i64, 2].as_slice(), false, None);
        assert!(by_frame.min().double_value(&[]) > 0.0, "{kind:?}: {by_frame:?}");
    }
}

/// The sizes that docs/baselines.md states; those of the four networks lie within 3 %.
#[test]
fn networks_are_of_one_size() {
    let counts = BLACK_BOXES.map(|kind| weights(&black_box("spring_color", kind), VariableGroup::Dynamics));
    assert_eq!(counts, [42_404, 42_209, 43_152, 42_319, 68]);
    let physics = black_box("spring_color", DynamicsKind::Physics);
    assert_eq!(weights(&physics, VariableGroup::Velocity) + weights(&physics, VariableGroup::Physics), 11_202 + 2);
    for kind in BLACK_BOXES {
        let model = black_box("spring_color", kind);
        assert_eq!(weights(&model, VariableGroup::Velocity) + weights(&model, VariableGroup::Physics), 0);
        assert_eq!(model.parameter_values(), []);
    }
    for task in ["spring_color", "3bp_color", "mnist_spring_color"] {
        let of = |decoder| weights(&model(task, DynamicsKind::Lstm, decoder), VariableGroup::Decoder) as f64;
        let ratio = of(DecoderKind::Mlp) / of(DecoderKind::CoordinateConsistent);
        assert!((0.99..=1.0).contains(&ratio), "{task}: {ratio}");
    }
}

/// Some hundred steps on uniform motion teach each of them most of it.
#[test]
fn every_black_box_learns_uniform_motion() {
    for kind in BLACK_BOXES {
        let model = black_box("spring_color", kind);
        let variables: Vec<_> =
            model.named_variables().into_iter().filter(|(name, _)| name.starts_with("dyn")).collect();
        let mut optimizer = Optimizer::new(OptimizerKind::Adam, None, &variables);
        let error = |seed: u64| {
            let paths = uniform_motion(50, 8, 4, seed);
            let (_, states) = model.roll_out(&paths.narrow(1, 0, 4), &Actions::none(), 4);
            let rolled: Vec<_> = states.into_iter().map(|state| state.pos).collect();
            latent_error(&Tensor::stack(&rolled, 1), &paths.narrow(1, 4, 4))
        };
        let before = error(1000).double_value(&[]);
        for step in 0..300 {
            error(step).backward();
            optimizer.step(&variables, |_| 3e-3);
        }
        let after = error(1000).double_value(&[]);
        assert!(after < 0.2 * before, "{kind:?}: {before} to {after}");
    }
}

/// With separate gradients encoder and decoder have none from L_pred, velocity and physics none from L_rec; jointly all
/// parts learn from L_pred.
#[test]
fn separate_gradients_keep_the_losses_apart() {
    for (dynamics, decoder) in [
        (DynamicsKind::Physics, DecoderKind::CoordinateConsistent),
        (DynamicsKind::Lstm, DecoderKind::CoordinateConsistent),
        (DynamicsKind::Physics, DecoderKind::Mlp),
    ] {
        let model = model("spring_color", dynamics, decoder);
        let clips = noise(2, 10);
        let reached = |gradients: GradientPaths, prediction: bool| {
            let pass = model.forward_with(&clips, &Actions::none(), None, gradients).unwrap();
            let losses = Losses::new(&pass, &clips, &model.system);
            let loss = if prediction { losses.prediction } else { losses.reconstruction };
            loss.backward();
            let mut groups = Vec::new();
            for (name, variable) in model.named_variables() {
                let mut gradient = variable.grad();
                if gradient.defined() && gradient.abs().sum(Kind::Double).double_value(&[]) > 0.0 {
                    groups.push(model.group(&name));
                    let _ = gradient.zero_();
                }
            }
            groups.dedup();
            [
                VariableGroup::Encoder,
                VariableGroup::Decoder,
                VariableGroup::Velocity,
                VariableGroup::Physics,
                VariableGroup::Dynamics,
            ]
            .map(|group| groups.contains(&group))
        };
        let told = dynamics == DynamicsKind::Physics;
        assert_eq!(reached(GradientPaths::Separate, false), [true, true, false, false, false]);
        assert_eq!(
            reached(GradientPaths::Separate, true),
            [false, false, told, told, !told],
            "{dynamics:?} {decoder:?}"
        );
        assert_eq!(reached(GradientPaths::Joint, true), [true, true, told, told, !told]);
    }
}

/// Who learns from what changes no number of the pass itself.
#[test]
fn separate_gradients_predict_the_same() {
    let model = black_box("spring_color", DynamicsKind::Physics);
    let clips = noise(2, 12);
    let [joint, separate] = [GradientPaths::Joint, GradientPaths::Separate]
        .map(|gradients| model.forward_with(&clips, &Actions::none(), None, gradients).unwrap().predictions);
    assert!((joint - separate).abs().max().double_value(&[]) < 1e-5);
}

/// An order that is known before a step, as on a GPU, is the one that its positions are in; the one that is looked up is the
/// one that the step finds by itself.
#[test]
fn a_step_follows_the_order_that_is_known_before() {
    let system = tasks::builtin("spring_color").unwrap().system;
    let options = ModelOptions {
        names_by_continuity: true,
        second_look: true,
        alignment_steps: 1,
        refinement_steps: 1,
        ..ModelOptions::original()
    };
    let model = PhysicsNet::new(&system, &options, Device::Cpu, 4).unwrap();
    let clips = noise(6, 10);
    let pass = |order: Option<&Tensor>| {
        let pass = model.forward_with(&clips, &Actions::none(), order, GradientPaths::Joint).unwrap();
        [pass.positions.detach(), pass.predictions.detach()]
    };
    let looked_up = model.order(&clips).unwrap();
    assert_eq!(pass(Some(&looked_up)), pass(None));
    // In every other frame the objects change names.
    let frame = Tensor::arange(10, (Kind::Int64, Device::Cpu)).remainder(2).unsqueeze(1);
    let changing = (frame + Tensor::arange(2, (Kind::Int64, Device::Cpu))).remainder(2).expand([6, 10, 2], false);
    let own = Tensor::arange(2, (Kind::Int64, Device::Cpu)).expand([6, 10, 2], false);
    let [seen, _] = pass(Some(&own));
    let [renamed, _] = pass(Some(&changing));
    let exchanged = seen.reshape([6, 10, 2, 2]).flip([2]).reshape([6, 10, 4]);
    let odd = Tensor::arange_start_step(1, 10, 2, (Kind::Int64, Device::Cpu));
    assert_eq!(renamed.index_select(1, &odd), exchanged.index_select(1, &odd));
    assert_eq!(renamed.index_select(1, &(odd - 1)), seen.slice(1, 0, 10, 2));
}
