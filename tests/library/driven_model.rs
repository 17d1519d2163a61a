//! The model of a turning object that is driven from outside, and which parameters a model learns.

use std::collections::BTreeMap;

use crate::random::numbers;
use paig::network::cells::{Actions, State};
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::network::stn;
use paig::tasks::find;
use rand::Rng;
use tch::{Device, Kind, Tensor};

/// Uniform in \[0, 1).
fn uniform(purpose: &str, shape: &[i64]) -> Tensor {
    numbers(5, purpose, shape, |random| random.random::<f32>())
}

/// The roll-out begins at the last input frame, so it takes the torques from that frame on.
#[test]
fn each_frame_is_predicted_with_its_own_torque() {
    let task = find("pendulum").unwrap();
    let options = ModelOptions { refinement_steps: 2, ..ModelOptions::original() };
    let model = PhysicsNet::new(&task.system, &options, Device::Cpu, 1).unwrap();
    let _guard = tch::no_grad_guard();
    let (time, input) = (task.train_frames as i64, task.system.input_steps as i64);
    let torques = uniform("torques", &[2, time]) * 4.0 - 2.0;
    let clips = uniform("clips", &[2, time, 3, 64, 64]);
    let pass = model.forward(&clips, &Actions::new(Some(torques.shallow_clone()))).unwrap();
    let mut state = &pass.initial;
    assert_eq!(pass.states.len() as i64, time - input);
    for (frame, next) in (input - 1..).zip(&pass.states) {
        let expected = model.cell.step(state, Some(&torques.narrow(1, frame, 1)), task.system.dt);
        assert_eq!(next.joined(), expected.joined(), "frame {frame}");
        state = next;
    }
}

/// Of an estimate that knows nothing of the velocity the refinement makes the true one, if it knows what acted.
#[test]
fn the_first_state_is_refined_with_what_acted_during_the_input() {
    let task = find("pendulum").unwrap();
    let options = ModelOptions { refinement_steps: 3, ..ModelOptions::original() };
    let model = PhysicsNet::new(&task.system, &options, Device::Cpu, 1).unwrap();
    model.parameters.iter().zip([10.0, 1.0]).for_each(|(parameter, value)| model.set_value(parameter, value).unwrap());
    let _guard = tch::no_grad_guard();
    let first = State { pos: uniform("angles", &[50, 1]) * 6.0 - 3.0, vel: uniform("rates", &[50, 1]) * 8.0 - 4.0 };
    let torques = Actions::new(Some(uniform("torques", &[50, 3]) * 4.0 - 2.0));
    let states = model.cell.roll_out(&first, &torques, task.system.dt, 3);
    let seen = Tensor::cat(&[&first.pos.unsqueeze(1), &State::positions(&states)], 1);
    let error = (model.initial_state(&seen, &torques).vel - &states[2].vel).abs();
    // Three steps leave some thousandths of a first error of 4. Without the torques a quarter would be found by chance.
    let share = error.le(0.05).to_kind(Kind::Double).mean(Kind::Double).double_value(&[]);
    assert!(share > 0.9, "{share} of the velocities found");
}

#[test]
fn what_is_held_is_no_variable() {
    let task = find("3bp_color").unwrap();
    let variables = |fixed: &[(&str, f64)]| {
        let fixed: BTreeMap<String, f64> = fixed.iter().map(|(name, value)| (name.to_string(), *value)).collect();
        let options = ModelOptions { fixed, ..ModelOptions::original() };
        let model = PhysicsNet::new(&task.system, &options, Device::Cpu, 1).unwrap();
        let names = model.named_variables().into_iter().map(|(name, _)| name);
        names.filter_map(|name| name.strip_prefix("gravity_ode_cell.").map(String::from)).collect::<Vec<_>>()
    };
    assert_eq!(variables(&[]), ["log_g"]);
    assert_eq!(variables(&[("g", 60.0)]), ["log_m"]);
}

/// The original's decoder moves a template by (S-1)/S pixels for one unit of position.
#[test]
fn a_length_is_held_in_true_pixels_whatever_the_decoders_scale() {
    let task = find("spring_color").unwrap();
    for (exact_shift, units) in [(true, 6.0), (false, 6.0 * 32.0 / 31.0)] {
        let fixed = BTreeMap::from([("l".to_string(), 6.0)]);
        let options = ModelOptions { fixed, exact_shift, ..ModelOptions::original() };
        let model = PhysicsNet::new(&task.system, &options, Device::Cpu, 1).unwrap();
        let l = model.parameters.iter().find(|parameter| parameter.kind.name == "l").unwrap();
        assert!((l.unconstrained.double_value(&[]).exp() / units - 1.0).abs() < 1e-6, "exact_shift {exact_shift}");
    }
}

/// So that a diverged model ends with a message and not in an index out of bounds.
#[test]
fn a_theta_that_is_not_a_number_shows_in_the_frame() {
    let sampled = stn::transform(
        &Tensor::ones([1, 1, 4, 4], (Kind::Float, Device::Cpu)),
        &Tensor::full([1, 6], f64::NAN, (Kind::Float, Device::Cpu)),
        8,
    );
    assert_eq!(sampled.isnan().all().int64_value(&[]), 1);
}

/// A pendulum's model whose sprite is a bump of colours that vary smoothly from the top left to the bottom right.
fn model_of_a_coloured_bump(options: &ModelOptions) -> PhysicsNet {
    let task = find("pendulum").unwrap();
    let model = PhysicsNet::new(&task.system, options, Device::Cpu, 3).unwrap();
    let _guard = tch::no_grad_guard();
    model.decoder.start_templates(3.0, 0.3);
    let slope = Tensor::linspace(-1.0, 1.0, 32, (Kind::Float, Device::Cpu));
    let colours = (slope.unsqueeze(1) + slope.unsqueeze(0) * 2.0).unsqueeze(-1).repeat([1, 1, 3]).flatten(0, -1);
    for (name, mut variable) in model.named_variables() {
        if name.ends_with("bias") && variable.size() == colours.size() {
            variable.copy_(&colours);
        }
    }
    model
}

#[test]
fn sprites_turn_clockwise_about_the_middle() {
    let model = model_of_a_coloured_bump(&ModelOptions::original());
    let _guard = tch::no_grad_guard();
    let quarter = std::f32::consts::FRAC_PI_2;
    let drawn = model.decoder.forward(&Tensor::from_slice(&[0.0, quarter, 2.0 * quarter, -quarter]).unsqueeze(1));
    let objects = (drawn.masks.select(0, 0).unsqueeze(1) * drawn.contents.select(0, 0)).to_kind(Kind::Double);
    let upright = objects.narrow(0, 0, 1);
    let spread = (&upright - upright.rot90(2, [2, 3])).abs().max().double_value(&[]);
    assert!(spread > 0.1, "the sprite looks the same upside down: the test would show nothing");
    for (place, turns) in [(1, -1), (2, 2), (3, 1)] {
        // rot90 turns anticlockwise on the screen. The transformer's grid is half a hundredth of a pixel off its middle
        // (size - 1.01), which moves colours by some thousandths.
        let expected = upright.rot90(turns, [2, 3]);
        let error = (objects.narrow(0, place, 1) - expected).abs().max().double_value(&[]);
        assert!(error < 0.02, "turned by {turns} quarters: off by {error}");
    }
}

/// What is drawn turned is found turned, and its place goes with it about the middle.
#[test]
fn a_turned_place_is_aligned_with_the_picture() {
    let model = model_of_a_coloured_bump(&ModelOptions { alignment_steps: 3, ..ModelOptions::original() });
    let _guard = tch::no_grad_guard();
    let angles = Tensor::linspace(-2.5, 2.5, 20, (Kind::Float, Device::Cpu)).unsqueeze(1);
    let frames = model.decoder.forward(&angles).frames;
    let at = |angles: &Tensor| Tensor::cat(&[angles.sin() * 14.0 + 32.0, angles.cos() * -14.0 + 32.0], 1);
    let off = 0.03;
    let aligned = model.aligned_places(&frames, &at(&(&angles + off)));
    let error = (aligned - at(&angles)).square().sum_dim_intlist([1i64].as_slice(), false, Kind::Double).sqrt();
    let (error, begun) = (error.max().double_value(&[]), 14.0 * off);
    println!("{error:.3} px of {begun} px");
    // Three steps, all with the derivative at their beginning, leave a third of 0.42 px at most; steps the other way would
    // nearly double it.
    assert!(error < begun / 2.0, "{error} px are left of {begun} px");
}
