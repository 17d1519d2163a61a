//! The encoder that is given what a frame adds to the background: what stands behind makes no difference to it.

use paig::network::physics_models::{ModelOptions, PhysicsNet};
use tch::{Device, Kind, Tensor};

/// A model whose decoder has this background everywhere, of the same weights otherwise.
fn model(background: f64, subtract_background: bool) -> PhysicsNet {
    let options = ModelOptions { subtract_background, ..ModelOptions::original() };
    let system = paig::tasks::builtin("spring_color").unwrap().system;
    let model = PhysicsNet::new(&system, &options, Device::Cpu, 3).unwrap();
    let _guard = tch::no_grad_guard();
    let logits = Tensor::full([3, 32, 32], background, (Kind::Float, Device::Cpu)).logit(None::<f64>);
    model.decoder.start_background(&logits, 0.0);
    model
}

/// Frames with two balls of light on a background.
fn frames(background: f64) -> Tensor {
    let frames = Tensor::full([1, 4, 3, 32, 32], background, (Kind::Float, Device::Cpu));
    for frame in 0..4 {
        for (channel, left) in [(0, 4 + 3 * frame), (1, 20)] {
            let ball = frames.get(0).get(frame).get(channel).narrow(0, 10, 4).narrow(1, left, 4);
            let _ = ball.shallow_clone().fill_(background + 0.4);
        }
    }
    frames
}

#[test]
fn what_stands_behind_makes_no_difference() {
    let _guard = tch::no_grad_guard();
    let seen = |background, subtracted| model(background, subtracted).encode(&frames(background));
    let difference = |subtracted| {
        let [(dark, in_dark), (bright, in_bright)] = [0.1, 0.5].map(|background| seen(background, subtracted));
        let masks = (dark.masks - bright.masks).abs().max().double_value(&[]);
        (masks, (in_dark - in_bright).abs().max().double_value(&[]))
    };
    // Rounding of differences between numbers below 1, through the network.
    let (masks, positions) = difference(true);
    assert!(masks < 1e-4 && positions < 1e-2, "masks {masks}, positions {positions} px apart");
    let (masks, _) = difference(false);
    assert!(masks > 1e-3, "masks of whole frames are {masks} apart: the test would show nothing");
}

#[test]
fn without_the_option_the_encoder_is_given_the_frame() {
    let frames = frames(0.3).flatten(0, 1);
    assert_eq!(model(0.5, false).given(&frames), frames);
    let difference = model(0.25, true).given(&frames) - (&frames - 0.25);
    assert!(difference.abs().max().double_value(&[]) < 1e-6);
}
