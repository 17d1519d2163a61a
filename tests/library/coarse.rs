//! The halved system, on which large frames' objects are found first.

use crate::random::numbers;
use ndarray::Array5;
use paig::datasets::iterators::Clips;
use paig::network::System;
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::tasks;
use rand::Rng;
use tch::{Device, Kind, Tensor};

const FLOAT: (Kind, Device) = (Kind::Float, Device::Cpu);
/// The digits' side.
const SIDE: i64 = 64;

fn whole() -> System {
    tasks::builtin("mnist_spring_color").unwrap().system
}

fn model(system: &System, seed: u64, exact_shift: bool) -> PhysicsNet {
    let options = ModelOptions { exact_shift, ..ModelOptions::original() };
    PhysicsNet::new(system, &options, Device::Cpu, seed).unwrap()
}

/// A model of the halved system with bright round sprites, and one of the whole system that begins as it.
fn pair(exact_shift: bool) -> [PhysicsNet; 2] {
    let [coarse, fine] = [model(&whole().halved(), 1, exact_shift), model(&whole(), 2, exact_shift)];
    let line = Tensor::arange(16, FLOAT) - 7.5;
    // Smooth: a sharp edge would be sampled at another place on each grid.
    let inside = ((line.square().unsqueeze(0) + line.square().unsqueeze(1)) / -18.0).exp();
    let colours = [0.9, 0.6].map(|shade| Tensor::full([3, 16, 16], shade, FLOAT));
    coarse.decoder.start_sprites(&inside.repeat([2, 1, 1]), &Tensor::stack(&colours, 0), 8.0, 0.0);
    fine.begin_as(&coarse);
    [coarse, fine]
}

/// Two positions in each of some frames, pixels of the whole frame.
fn positions() -> Tensor {
    // Nothing else here draws from libtorch's generator, which is the process's.
    tch::manual_seed(5);
    Tensor::rand([20, 4], FLOAT) * 40.0 + 12.0
}

#[test]
fn halved_clips_are_means_of_four_pixels() {
    let pixels =
        Array5::from_shape_fn((2, 3, 4, 4, 3), |(clip, time, y, x, c)| (clip + 7 * time + 3 * y * x + c) as u8);
    let clips = Clips::new(&pixels, None, Device::Cpu);
    let halved = clips.halved();
    let mean = |frames: &Tensor| {
        let corner = |y: i64, x: i64| frames.slice(-2, y, None, 2).slice(-1, x, None, 2);
        (corner(0, 0) + corner(0, 1) + corner(1, 0) + corner(1, 1)) / 4.0
    };
    let (chosen, places) = ([1, 0], [4, 0, 5]);
    for (given, whole) in
        [(halved.batch(&chosen, 2), clips.batch(&chosen, 2)), (halved.frames(&places), clips.frames(&places))]
    {
        let wanted = mean(&whole);
        assert_eq!(given.size(), wanted.size());
        assert!((given - wanted).abs().max().double_value(&[]) < 1e-6);
    }
}

/// The localisation network of large frames sees them halved in any case: what it learned on halved frames holds.
#[test]
fn objects_are_localised_where_they_were() {
    let [coarse, fine] = pair(true);
    let masked = numbers(6, "masked", &[2, 6, 3, SIDE, SIDE], |random| random.random::<f32>());
    let halved = masked.flatten(0, 1).avg_pool2d(2, 2, 0, false, true, None).reshape([2, 6, 3, SIDE / 2, SIDE / 2]);
    let (by_fine, by_coarse) = (fine.encoder.localise(&masked), coarse.encoder.localise(&halved));
    assert!((&by_fine - by_coarse).abs().max().double_value(&[]) < 1e-4);
    assert!(by_fine.std(true).double_value(&[]) > 0.1, "all in one place: nothing is tested");
}

/// Positions are in pixels of the whole frame in both: a disc is drawn around the same place, as large as it was, in the original
/// decoder's unit of length as well.
#[test]
fn sprites_are_drawn_where_they_were() {
    for exact_shift in [true, false] {
        drawn_where_they_were(&pair(exact_shift));
    }
}

fn drawn_where_they_were([coarse, fine]: &[PhysicsNet; 2]) {
    let positions = positions();
    // Where neither disc hides the other.
    let apart = (positions.select(1, 0) - positions.select(1, 2)).abs().gt(20.0).nonzero().squeeze_dim(1);
    assert!(apart.size()[0] > 3);
    let positions = positions.index_select(0, &apart);
    let sum = |x: Tensor, axes: &[i64]| x.sum_dim_intlist(axes, false, None);
    let drawn = [coarse, fine].map(|model| {
        // Squared: what is faintly there all over the frame does not count.
        let first = tch::no_grad(|| model.decoder.forward(&positions).masks).get(0).square();
        let mass = sum(first.shallow_clone(), &[1, 2]);
        let across = sum(sum(first, &[1]) * model.pixel_centres(), &[1]);
        (across / &mass, mass * model.system.given_pixel().powi(2))
    });
    let [(coarse_x, coarse_area), (fine_x, fine_area)] = &drawn;
    let off = |a: &Tensor, b: &Tensor| (a - b).abs().max().double_value(&[]);
    let wanted = positions.select(1, 0);
    // A tenth of a pixel, and of the area: the grids are others.
    assert!(off(coarse_x, &wanted) < 0.1, "{}", off(coarse_x, &wanted));
    assert!(off(fine_x, &wanted) < 0.1, "{}", off(fine_x, &wanted));
    assert!(off(&(coarse_area / fine_area), &coarse_area.ones_like()) < 0.1, "{coarse_area} {fine_area}");
}

/// The encoder's kernels and the parameters are taken over as they are, in the same unit.
#[test]
fn parameters_keep_their_values() {
    let [coarse, fine] = [model(&whole().halved(), 1, true), model(&whole(), 2, true)];
    for parameter in coarse.learned() {
        coarse.set_value(parameter, 3.5).unwrap();
    }
    fine.begin_as(&coarse);
    assert_eq!(fine.parameter_values(), coarse.parameter_values());
    assert!(fine.parameter_values().iter().all(|(_, value)| (value - 3.5).abs() < 1e-5));
    let (mine, others) = (fine.variables.variables(), coarse.variables.variables());
    let encoder: Vec<_> = mine.keys().filter(|name| name.starts_with("encoder")).collect();
    assert!(encoder.len() > 10 && encoder.iter().all(|name| mine[*name].equal(&others[*name])));
}
