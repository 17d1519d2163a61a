//! Encoded positions, improved on the picture.

use paig::network::cells::Coordinates;
use paig::network::physics_models::alignment::align;
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::support::random::{named_generator, normal};
use paig::tasks::find;
use rand::Rng;
use tch::{Device, Kind, Tensor};

const FRAMES: i64 = 60;

/// A model of two coloured blobs on black, as a training would have made it.
fn model_of_two_blobs() -> PhysicsNet {
    let task = find("spring_color").unwrap();
    let options = ModelOptions { exact_shift: true, ..ModelOptions::original() };
    let model = PhysicsNet::new(&task.system, &options, Device::Cpu, 1).unwrap();
    let line = Tensor::arange(16, (Kind::Float, Device::Cpu)) - 7.5;
    let squared = line.square().unsqueeze(0) + line.square().unsqueeze(1);
    let visible = (squared / -10.0).exp().unsqueeze(0).repeat([2, 1, 1]);
    let colour = |rgb: [f32; 3]| Tensor::from_slice(&rgb).reshape([3, 1, 1]).expand([3, 16, 16], false);
    let colours = Tensor::stack(&[colour([0.9, 0.2, 0.1]), colour([0.1, 0.3, 0.9])], 0);
    model.decoder.start_sprites(&visible, &colours, 6.0, 0.0);
    let _guard = tch::no_grad_guard();
    model.decoder.start_background(&Tensor::full([3, 32, 32], -4.0, (Kind::Float, Device::Cpu)), 0.0);
    model
}

/// Positions `[FRAMES, 4]` of balls that do not hide each other, and normal errors of them, both in pixels.
fn places_and_errors() -> (Tensor, Tensor) {
    let mut random = named_generator(3, "places");
    let places: Vec<f32> = (0..FRAMES * 4)
        .map(|i| if i % 4 < 2 { random.random_range(6.0..13.0) } else { random.random_range(19.0..26.0) })
        .collect();
    let errors: Vec<f32> = (0..FRAMES * 4).map(|_| 0.4 * normal(&mut random) as f32).collect();
    (Tensor::from_slice(&places).reshape([FRAMES, 4]), Tensor::from_slice(&errors).reshape([FRAMES, 4]))
}

fn with_noise(frames: &Tensor, deviation: f64) -> Tensor {
    let mut random = named_generator(4, "noise");
    let noise: Vec<f32> = (0..frames.numel()).map(|_| (deviation * normal(&mut random)) as f32).collect();
    frames + Tensor::from_slice(&noise).reshape(frames.size())
}

fn root_mean_square(x: &Tensor) -> f64 {
    x.square().mean(Kind::Double).double_value(&[]).sqrt()
}

#[test]
fn positions_are_where_the_picture_shows_the_objects() {
    let model = model_of_two_blobs();
    let (places, errors) = places_and_errors();
    let frames = tch::no_grad(|| model.decoder.forward(&places).frames);
    let aligned = align(&model.decoder, Coordinates::Position, &frames, &(&places + &errors), 3);
    // Three steps leave a twentieth of errors of 0.4 px at most: the derivative is that at the encoded positions throughout,
    // a bilinear sprite has kinks, and the encoded positions pull a little.
    let left = root_mean_square(&(aligned - &places));
    assert!(left < 0.02, "{left} px are left of {} px", root_mean_square(&errors));
}

/// No estimate without bias is better than the bound of Cramer and Rao; least squares reach it.
#[test]
fn under_noise_positions_are_as_good_as_a_frame_allows() {
    let model = model_of_two_blobs();
    let (places, errors) = places_and_errors();
    let deviation = 0.04;
    let drawn =
        |places: &Tensor| tch::no_grad(|| model.decoder.forward(places).frames.flatten(1, 3).to_kind(Kind::Double));
    let frames = with_noise(&tch::no_grad(|| model.decoder.forward(&places).frames), deviation);
    let aligned = align(&model.decoder, Coordinates::Position, &frames, &(&places + &errors), 3);
    let derivative = |axis: i64| {
        let probe = Tensor::eye(4, (Kind::Float, Device::Cpu)).get(axis) * 0.25;
        (drawn(&(&places + &probe)) - drawn(&(&places - &probe))) / 0.5
    };
    let jacobian = Tensor::stack(&(0..4).map(derivative).collect::<Vec<_>>(), 1);
    let covariance = jacobian.bmm(&jacobian.transpose(1, 2)).inverse() * deviation * deviation;
    let bound = covariance.diagonal(0, 1, 2).mean(Kind::Double).double_value(&[]).sqrt();
    let found = root_mean_square(&(aligned - &places));
    // 240 errors: their root mean square is known to 5 %; the pull towards the encoded positions makes it smaller.
    assert!((0.8..1.2).contains(&(found / bound)), "{found} px; the bound is {bound} px");
}

#[test]
fn an_object_that_is_not_in_the_picture_stays_where_it_was_encoded() {
    let model = model_of_two_blobs();
    let (places, errors) = places_and_errors();
    let away = Tensor::from_slice(&[0.0f32, 0.0, 60.0, 60.0]);
    let encoded = &places + &errors + &away;
    let frames = with_noise(&tch::no_grad(|| model.decoder.forward(&(&places + &away)).frames), 0.02);
    let aligned = align(&model.decoder, Coordinates::Position, &frames, &encoded, 2);
    assert_eq!(aligned.narrow(1, 2, 2), encoded.narrow(1, 2, 2));
    assert!(root_mean_square(&(aligned - &places - &away).narrow(1, 0, 2)) < 0.05);
}

#[test]
fn gradients_pass_to_the_encoded_positions() {
    let model = model_of_two_blobs();
    let (places, errors) = places_and_errors();
    let frames = tch::no_grad(|| model.decoder.forward(&places).frames);
    let encoded = (places + errors).set_requires_grad(true);
    let aligned = align(&model.decoder, Coordinates::Position, &frames, &encoded, 1);
    aligned.sum(Kind::Float).backward();
    assert_eq!(encoded.grad(), Tensor::ones([FRAMES, 4], (Kind::Float, Device::Cpu)));
    assert!(model.named_variables().iter().all(|(_, variable)| !variable.grad().defined()));
}
