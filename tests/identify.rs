//! The fit of physical parameters to trajectories, from starts a decade away and through template offsets.

use paig::cells::{CellKind, State};
use paig::config::Identify;
use paig::datasets::generators::{Counts, generate_clips};
use paig::datasets::sprites::Sprites;
use paig::datasets::variant::Variant;
use paig::initial_values::named_generator;
use paig::recipe::identify::fit;
use paig::tasks::find;
use rand::Rng;
use tch::{Kind, Tensor};

fn settings() -> Identify {
    Identify { clips: 200, horizons: vec![3, 4, 6, 8, 12], max_iterations: 30, huber: 1.0, recentre_above: 0.0 }
}

/// Standard normal numbers that are the same in every run, `[clips, n]`.
fn normal(purpose: &str, n: usize) -> Tensor {
    let mut random = named_generator(7, purpose);
    // Twelve uniform numbers have variance 1.
    let values: Vec<f64> =
        (0..CLIPS as usize * n).map(|_| (0..12).map(|_| random.random::<f64>() - 0.5).sum()).collect();
    Tensor::from_slice(&values).reshape([CLIPS, n as i64])
}

const CLIPS: i64 = 200;
const FRAMES: usize = 12;
/// Standard deviation of the observed positions, pixels.
const NOISE: f64 = 0.1;

/// Trajectories `[clips, frames, 2 * objects]` of a cell from scattered states around `pos` and `vel`, seen with offsets
/// and noise.
fn observed(kind: CellKind, logs: &[f64], dt: f64, pos: (&[f64], f64), vel: (&[f64], f64), offsets: &[f64]) -> Tensor {
    let n = offsets.len();
    let first = State {
        pos: Tensor::from_slice(pos.0) + normal("positions", n) * pos.1,
        vel: Tensor::from_slice(vel.0) + normal("velocities", n) * vel.1,
    };
    let logs: Vec<_> = logs.iter().map(|&log| Tensor::from(log).to_kind(Kind::Double)).collect();
    let mut seen = vec![first.pos.shallow_clone()];
    seen.extend(kind.build(&logs, 36).roll_out(&first, dt, FRAMES - 1).into_iter().map(|state| state.pos));
    let noise = normal("noise", FRAMES * n).reshape([CLIPS, FRAMES as i64, n as i64]) * NOISE;
    Tensor::stack(&seen, 1) + Tensor::from_slice(offsets) + noise
}

#[test]
fn spring_is_found_from_every_start_and_through_offsets() {
    let offsets = [1.5, -0.4, -1.5, 0.4];
    let truth = [4.0f64, 6.0];
    let logs = truth.map(f64::ln);
    let seen = observed(CellKind::Spring, &logs, 0.3, (&[21.0, 16.0, 9.0, 16.0], 1.5), (&[0.0; 4], 3.0), &offsets);
    for start in [[1.0f64, 1.0], [10.0, 1.0], [0.1, 3.0], [1.0, 12.0]] {
        let fit = fit(&settings(), CellKind::Spring, 32, 0.3, &seen, &start.map(f64::ln)).unwrap();
        let (k, l) = (fit.logs[0].exp(), fit.logs[1].exp());
        // 200 clips of 12 frames at 0.1 px of noise leave some 0.1 % on either.
        assert!((k / 4.0 - 1.0).abs() < 0.01 && (l / 6.0 - 1.0).abs() < 0.01, "from {start:?}: k {k}, l {l}");
        // Only the relative offset shows in the motion.
        for axis in 0..2 {
            let found = fit.offsets[axis] - fit.offsets[2 + axis];
            let expected = offsets[axis] - offsets[2 + axis];
            assert!((found - expected).abs() < 0.1, "from {start:?}: offset {found} instead of {expected}");
        }
        assert!((fit.residual - NOISE).abs() < 0.05, "residual {}", fit.residual);
    }
}

#[test]
fn gravity_is_found_from_far_starts() {
    // As the task has them: on a circle, moving along it, no close encounters.
    let (pos, vel) = ([18.0, 9.0, 25.8, 22.5, 10.2, 22.5], [2.0, 0.0, -1.0, 1.7, -1.0, -1.7]);
    let seen = observed(CellKind::Gravity, &[60f64.ln()], 0.5, (&pos, 0.7), (&vel, 0.3), &[0.0; 6]);
    for start in [1.0f64, 10.0, 300.0] {
        let fit = fit(&settings(), CellKind::Gravity, 36, 0.5, &seen, &[start.ln()]).unwrap();
        let g = fit.logs[0].exp();
        assert!((g / 60.0 - 1.0).abs() < 0.02, "from {start}: g {g}");
    }
}

#[test]
fn positions_that_are_not_numbers_are_refused() {
    let seen = Tensor::full([4, 12, 4], f64::NAN, (Kind::Double, tch::Device::Cpu));
    let error = fit(&settings(), CellKind::Spring, 32, 0.3, &seen, &[0.0, 0.0]).unwrap_err();
    assert!(error.to_string().contains("not finite"), "{error}");
}

/// The generator integrates a frame in ten steps, the model in five: even true positions give a k that is 0.2 % low.
#[test]
fn true_trajectories_give_the_spring_up_to_the_integration_step() {
    let task = find("spring_color").unwrap();
    let counts = Counts { train: 300, valid: 1, test: 1 };
    let (_, states) =
        generate_clips(&Variant::new(task, 5), &Sprites::original().unwrap(), task.train_frames, counts).unwrap();
    let positions = states.train.positions;
    let shape: Vec<i64> = positions.shape().iter().map(|&n| n as i64).collect();
    let seen = Tensor::from_slice(positions.as_slice().unwrap()).reshape(&shape);
    let fit = fit(&settings(), task.cell, task.side, task.dt, &seen, &[0.0, 0.0]).unwrap();
    let (k, l) = (fit.logs[0].exp(), fit.logs[1].exp());
    println!("k {k}, l {l}, residual {} px", fit.residual);
    assert!((k / 4.0 - 0.998).abs() < 0.001, "k {k}");
    assert!((l / 6.0 - 1.0).abs() < 0.001, "l {l}");
}
