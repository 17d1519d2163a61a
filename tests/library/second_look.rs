//! The second look at objects that look alike.

use crate::random::numbers;
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::tasks;
use rand::Rng;
use tch::{Device, Kind, Tensor};

const FRAMES: i64 = 40;
const FLOAT: (Kind, Device) = (Kind::Float, Device::Cpu);

/// A model that has learned nothing but its sprites: two discs in these shades.
fn model(shades: [f64; 2], second_look: bool) -> PhysicsNet {
    let options = ModelOptions { exact_shift: true, second_look, ..ModelOptions::original() };
    let model = PhysicsNet::new(&tasks::builtin("spring_color").unwrap().system, &options, Device::Cpu, 4).unwrap();
    let line = Tensor::arange(16, FLOAT) - 7.5;
    let inside = (line.square().unsqueeze(0) + line.square().unsqueeze(1)).lt(30.0).to_kind(Kind::Float);
    let colours = shades.map(|shade| Tensor::full([3, 16, 16], shade, FLOAT));
    model.decoder.start_sprites(&inside.repeat([2, 1, 1]), &Tensor::stack(&colours, 0), 4.0, 0.0);
    model
}

/// Frames of two objects each, `[frames, 3, 32, 32]`.
fn frames(model: &PhysicsNet) -> Tensor {
    let positions = numbers(3, "positions", &[FRAMES, 4], |random| random.random_range(4.0..28.0f32));
    tch::no_grad(|| model.decoder.draw([&positions])[0].shallow_clone())
}

#[test]
fn of_two_encodings_the_one_that_draws_a_frame_better_is_taken() {
    let model = model([0.9, 0.9], true);
    let frames = frames(&model);
    let _guard = tch::no_grad_guard();
    let first = model.encoder.forward(&frames);
    let second = model.encoder.forward(&frames.transpose(2, 3).contiguous()).positions;
    let second = second.reshape([FRAMES, 2, 2]).flip([2]).flatten(1, 2);
    let chosen = model.look(&frames);
    let error = |positions: &Tensor| {
        let [drawn] = model.decoder.draw([positions]);
        Vec::<f32>::try_from((drawn - &frames).square().sum_dim_intlist([1i64, 2, 3].as_slice(), false, None)).unwrap()
    };
    let of_first = error(&first.positions);
    let of_second = error(&second);
    let of_chosen = error(&chosen.positions);
    let better = of_first.iter().zip(&of_second).filter(|(first, second)| second < first).count();
    let firsts = Vec::<i64>::try_from(model.at_first_look(&frames)).unwrap();
    let not_worse = (0..FRAMES).filter(|frame| of_second[*frame as usize] >= of_first[*frame as usize]);
    assert_eq!(firsts, not_worse.collect::<Vec<_>>());
    assert!(better > 0 && better < FRAMES as usize, "the second is better in {better}: nothing is tested");
    for frame in 0..FRAMES as usize {
        let least = of_first[frame].min(of_second[frame]);
        assert!((of_chosen[frame] - least).abs() <= 1e-6 * least, "{frame}: {} {least}", of_chosen[frame]);
        // What belongs together is taken together: the masked objects are those of the masks.
        let row = frame as i64;
        let masked = chosen.masks.get(row).narrow(0, 0, 2).unsqueeze(1) * frames.get(row).unsqueeze(0);
        let off = (chosen.masked.select(1, row) - masked).abs().max().double_value(&[]);
        assert!(off < 1e-6, "{frame}: {off}");
    }
}

#[test]
fn nothing_is_encoded_twice_where_objects_differ_or_are_learned_from() {
    let same = |model: &PhysicsNet, frames: &Tensor| {
        let (plain, looked) = (model.encoder.forward(frames).positions, model.look(frames).positions);
        plain.equal(&looked)
    };
    let unlike = model([0.9, 0.4], true);
    let off = model([0.9, 0.9], false);
    let alike = model([0.9, 0.9], true);
    for (model, unchanged) in [(&unlike, true), (&off, true), (&alike, false)] {
        let frames = frames(model);
        assert_eq!(tch::no_grad(|| same(model, &frames)), unchanged);
        // With gradients.
        assert!(same(model, &frames));
    }
}
