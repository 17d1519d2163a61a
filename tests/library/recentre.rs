//! Re-centring: positions lose the offset, the picture stays.

use crate::random::numbers;
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::support::random::named_generator;
use paig::tasks::find;
use paig::training::identify::recentre::recentre;
use rand::Rng;
use tch::{Device, Kind, Tensor};

/// Frames with one soft ball of each of two colours at random places, `[frames, 3, 32, 32]`.
fn frames(count: i64) -> Tensor {
    let mut random = named_generator(3, "balls");
    let mut place =
        || Tensor::from_slice(&(0..count).map(|_| random.random_range(6.0..26.0f32)).collect::<Vec<_>>()).unsqueeze(1);
    let line = Tensor::arange(32, (Kind::Float, Device::Cpu)) + 0.5;
    let mut ball = || {
        let (x, y) = (place(), place());
        let squared = (&line - x).square().unsqueeze(1) + (&line - y).square().unsqueeze(2);
        (squared / -8.0).exp()
    };
    let (first, second) = (ball(), ball());
    Tensor::stack(&[&first.zeros_like(), &second, &first], 1)
}

#[test]
fn recentring_moves_positions_and_keeps_the_picture() {
    let options = ModelOptions { exact_shift: true, ..ModelOptions::original() };
    let task = find("spring_color").unwrap();
    let model = PhysicsNet::new(&task.system, &options, Device::Cpu, 1).unwrap();
    let _guard = tch::no_grad_guard();
    // Bumps that stand out from the fresh networks' noise: noise alone a shift by a fraction of a pixel must blur.
    model.decoder.start_templates(3.0, 0.3);
    let frames = frames(600);
    // Masks that tell the objects apart, as discovery leaves them.
    model.encoder.spread_masks(&frames, &frames.sum_dim_intlist([1i64].as_slice(), false, None), 10.0);
    let before = model.encoder.forward(&frames).positions;
    let offsets = [1.2f32, -0.7, -0.4, 0.9];
    let moved = &before - Tensor::from_slice(&offsets);
    let masks = |positions: &Tensor| model.decoder.forward(positions).masks;
    let difference = |a: &Tensor, b: &Tensor| (a - b).square().mean(Kind::Double).double_value(&[]);
    let drawn = masks(&before);
    let unshifted = difference(&drawn, &masks(&moved));

    let left = recentre(&model, &frames, &moved, &offsets.map(f64::from)).unwrap();

    // The offsets are about 1 px; the rest is what an untrained network's features cannot express.
    assert!(left < 0.2, "{left} px left");
    let change = difference(&drawn, &masks(&moved));
    // Moving without the shift is the yardstick; a shift by a fraction of a pixel blurs the fresh networks' noise (4 %), a
    // wrong sign or axis would cost several times the yardstick.
    assert!(change < 0.1 * unshifted, "masks changed by {change}; without the sprites' shift by {unshifted}");
}

/// Objects that are numbered anew are seen and drawn as before, under their new numbers.
#[test]
fn a_new_order_changes_only_the_numbers() {
    let system = paig::tasks::builtin("3bp_color").unwrap().system;
    let model = PhysicsNet::new(&system, &ModelOptions::original(), Device::Cpu, 5).unwrap();
    let _guard = tch::no_grad_guard();
    let frames = numbers(1, "frames", &[6, 3, 36, 36], |random| random.random::<f32>());
    let (before, [drawn]) =
        (model.encoder.forward(&frames).positions, model.decoder.draw([&positions(&model, &frames)]));
    model.reorder(&[2, 0, 1]);
    let after = model.encoder.forward(&frames).positions;
    let order = Tensor::from_slice(&[2i64, 0, 1]);
    let expected = before.reshape([6, 3, 2]).index_select(1, &order).flatten(1, 2);
    let off = (&after - expected).abs().max().double_value(&[]);
    assert!(off < 1e-4, "positions are {off} px off");
    let [redrawn] = model.decoder.draw([&after]);
    let off = (redrawn - drawn).abs().max().double_value(&[]);
    assert!(off < 1e-5, "what is drawn is {off} off");
}

fn positions(model: &PhysicsNet, frames: &Tensor) -> Tensor {
    model.encoder.forward(frames).positions
}
