//! Positions and velocities against the true ones.
//!
//! A model numbers its objects as it likes and may see each of them beside its true centre, by the same offset
//! everywhere; so objects are matched first, and errors are given with and without that offset. What looks different is
//! matched once for all clips; of objects that look alike nothing says which is which from clip to clip, so these are
//! matched in each clip.

use std::f64::consts::TAU;

use anyhow::Result;
use tch::{Kind, Tensor};

use crate::datasets::states::SplitStates;
use crate::network::System;
use crate::network::cells::Coordinates;
use crate::runs::scores::StateErrors;
use crate::support::assignment::best_assignment;

/// What a model makes of clips, double, in pixels or radians.
pub(super) struct EstimatedStates {
    /// `[clips, L + T_pred, coordinates * objects]`.
    pub encoded: Tensor,
    /// From the last input frame on, `[clips, 1 + T - L, coordinates * objects]`.
    pub positions: Tensor,
    pub velocities: Tensor,
    /// For each of the model's objects the first that looks like it.
    pub twins: Vec<usize>,
}

pub(super) fn errors(seen: &EstimatedStates, truth: &SplitStates, system: &System) -> Result<StateErrors> {
    let objects = system.objects;
    truth.check(system)?;
    let tensor = |states: &ndarray::Array3<f32>| {
        let (clips, time, _) = states.dim();
        let values: Vec<f32> = states.iter().copied().collect();
        let values = Tensor::from_slice(&values).to_kind(Kind::Double).reshape([clips as i64, time as i64, -1]);
        split(&values, objects)
    };
    let (true_positions, true_velocities) = (tensor(&truth.positions), tensor(&truth.velocities));
    let [encoded, positions, velocities] =
        [&seen.encoded, &seen.positions, &seen.velocities].map(|x| split(x, objects));
    let coordinates = system.cell.coordinates;
    let (input, pred) = (system.input_steps as i64, system.pred_steps as i64);
    let true_encoded = true_positions.narrow(1, 0, input + pred);
    let (order, in_each_clip) = best_orders(&encoded, &true_encoded, &seen.twins, coordinates)?;
    let encoded = difference(&reordered(&encoded, &in_each_clip), &true_encoded, coordinates);
    let offset = encoded.mean_dim([0i64, 1].as_slice(), true, Kind::Double);
    // Rolled-out states begin at the last input frame.
    let rolled_out = positions.size()[1];
    let true_rolled_out = true_positions.narrow(1, input - 1, rolled_out);
    let positions = difference(&reordered(&positions, &in_each_clip), &true_rolled_out, coordinates);
    let (velocities, true_velocities) =
        (reordered(&velocities, &in_each_clip), true_velocities.narrow(1, input - 1, rolled_out));
    let slope = slope(&velocities.narrow(1, 0, 1), &true_velocities.narrow(1, 0, 1));
    let velocities = velocities - true_velocities;
    let predicted = positions.narrow(1, 1, pred);
    let extrapolated = (rolled_out > 1 + pred).then(|| positions.narrow(1, 1 + pred, rolled_out - 1 - pred));
    Ok(StateErrors {
        offsets: (0..objects as i64)
            .map(|object| (0..offset.size()[3]).map(|axis| offset.double_value(&[0, 0, object, axis])).collect())
            .collect(),
        encoded: rms(&encoded),
        encoded_without_offset: rms(&(&encoded - &offset)),
        predicted: rms(&predicted),
        predicted_without_offset: rms(&(&predicted - &offset)),
        extrapolated: extrapolated.as_ref().map(rms),
        extrapolated_without_offset: extrapolated.map(|error| rms(&(error - &offset))),
        initial_velocity: rms(&velocities.narrow(1, 0, 1)),
        initial_velocity_slope: slope,
        predicted_velocity: rms(&velocities.narrow(1, 1, pred)),
        objects: order,
    })
}

/// `[clips, time, coordinates * objects]` to `[clips, time, objects, coordinates]`.
fn split(states: &Tensor, objects: usize) -> Tensor {
    let size = states.size();
    states.reshape([size[0], size[1], objects as i64, -1])
}

/// Of angles the short way round.
fn difference(seen: &Tensor, truth: &Tensor, coordinates: Coordinates) -> Tensor {
    let difference = seen - truth;
    match coordinates {
        Coordinates::Position => difference,
        Coordinates::Angle => &difference - (&difference / TAU).round() * TAU,
    }
}

/// States `[clips, time, objects, coordinates]` in the order of each clip, `[clips, objects]`.
fn reordered(states: &Tensor, in_each_clip: &Tensor) -> Tensor {
    let size = states.size();
    let index = in_each_clip.reshape([size[0], 1, size[2], 1]).expand(&size, false);
    states.gather(2, &index, false)
}

/// Root mean square length of the vectors `[.., coordinates]`.
fn rms(vectors: &Tensor) -> f64 {
    let squares = vectors.square().sum_dim_intlist([-1i64].as_slice(), false, Kind::Double);
    squares.mean(Kind::Double).sqrt().double_value(&[])
}

/// Slope of the line through the origin that fits `seen` over `truth` best.
fn slope(seen: &Tensor, truth: &Tensor) -> Option<f64> {
    let sum = |x: Tensor| x.sum(Kind::Double).double_value(&[]);
    let squares = sum(truth.square());
    (squares > 0.0).then(|| sum(seen * truth) / squares)
}

/// The model's object for each true one over all clips, and in each of them, `[clips, objects]`, where objects that look
/// alike may change places; `seen` and `truth` are `[clips, time, objects, coordinates]`. Both are the assignment with the
/// least sum of squared distances.
fn best_orders(
    seen: &Tensor,
    truth: &Tensor,
    twins: &[usize],
    coordinates: Coordinates,
) -> Result<(Vec<usize>, Tensor)> {
    let objects = twins.len();
    let apart = difference(&seen.unsqueeze(2), &truth.unsqueeze(3), coordinates);
    let costs = apart.square().sum_dim_intlist([-1i64].as_slice(), false, Kind::Double).mean_dim(1i64, false, None);
    let matrix = |costs: Tensor| -> Result<Vec<Vec<f64>>> {
        let costs: Vec<f64> = costs.flatten(0, -1).try_into()?;
        Ok(costs.chunks(objects).map(<[f64]>::to_vec).collect())
    };
    let order = best_assignment(&matrix(costs.mean_dim(0i64, false, None))?);
    let clips = costs.size()[0];
    let mut in_each_clip = Vec::with_capacity(objects * clips as usize);
    for clip in 0..clips {
        let mut costs = matrix(costs.get(clip))?;
        for (costs, &usual) in costs.iter_mut().zip(&order) {
            let others = (0..objects).filter(|&of_model| twins[of_model] != twins[usual]);
            others.for_each(|of_model| costs[of_model] = f64::INFINITY);
        }
        in_each_clip.extend(best_assignment(&costs).into_iter().map(|object| object as i64));
    }
    Ok((order, Tensor::from_slice(&in_each_clip).reshape([clips, objects as i64])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks;

    /// Made-up true states, and what a model sees that swaps the two balls, one of them 3 px left and 4 px down.
    #[test]
    fn objects_are_matched_and_offsets_taken_off() {
        let task = tasks::builtin("spring_color").unwrap();
        let truth = |scale: f32| {
            ndarray::Array3::from_shape_fn((2, 30, 4), |(c, t, i)| scale * (5.0 * i as f32 + t as f32 + 2.0 * c as f32))
        };
        let states = SplitStates { positions: truth(1.0), velocities: truth(0.1) };
        let seen = |states: &ndarray::Array3<f32>, first: i64, frames: i64, offset: [f64; 4]| {
            let all: Vec<f32> = states.iter().copied().collect();
            let all = Tensor::from_slice(&all).to_kind(Kind::Double).reshape([2, 30, 4]);
            let swapped = all.narrow(1, first, frames).index_select(2, &Tensor::from_slice(&[2i64, 3, 0, 1]));
            swapped + Tensor::from_slice(&offset)
        };
        let offset = [-3.0, 4.0, 0.0, 0.0];
        let seen = EstimatedStates {
            encoded: seen(&states.positions, 0, 10, offset),
            positions: seen(&states.positions, 3, 27, offset),
            velocities: seen(&states.velocities, 3, 27, [0.5, 0.0, 0.0, 0.0]),
            twins: vec![0, 1],
        };
        let found = errors(&seen, &states, &task.system).unwrap();
        assert_eq!(found.objects, [1, 0]);
        let near = |a: f64, b: f64| (a - b).abs() < 1e-5;
        assert!(near(found.offsets[1][0], -3.0) && near(found.offsets[1][1], 4.0) && near(found.offsets[0][0], 0.0));
        // One of two balls is off by 5 pixels.
        let expected = (25.0f64 / 2.0).sqrt();
        assert!(near(found.encoded, expected) && near(found.predicted, expected));
        assert!(near(found.extrapolated.unwrap(), expected) && near(found.extrapolated_without_offset.unwrap(), 0.0));
        assert!(near(found.encoded_without_offset, 0.0) && near(found.predicted_without_offset, 0.0));
        assert!(near(found.predicted_velocity, (0.25f64 / 2.0).sqrt()));
        // At frame 3 of clip c the true velocities are 0.1 (5 i + 3 + 2 c) for i = 0 to 3; the second ball's x, i = 2 (13 + 2 c),
        // is seen 0.5 larger.
        let all: f64 = (0..8).map(|place| (0.5 * (place % 4) as f64 + 0.3 + 0.2 * (place / 4) as f64).powi(2)).sum();
        assert!(near(found.initial_velocity_slope.unwrap(), 1.0 + 0.5 * (1.3 + 1.5) / all));
    }

    /// Ten objects: all 3,628,800 orders would take minutes.
    #[test]
    fn many_objects_are_matched() {
        let truth = Tensor::arange(2 * 3 * 10 * 2, (Kind::Double, tch::Device::Cpu)).reshape([2, 3, 10, 2]);
        let expected = [3i64, 1, 4, 0, 5, 9, 2, 6, 8, 7];
        let mut place = [0i64; 10];
        expected.iter().enumerate().for_each(|(of_truth, &of_model)| place[of_model as usize] = of_truth as i64);
        let seen = truth.index_select(2, &Tensor::from_slice(&place)) + 0.3;
        let unlike: Vec<usize> = (0..10).collect();
        let (order, in_each_clip) = best_orders(&seen, &truth, &unlike, Coordinates::Position).unwrap();
        assert_eq!(order, expected.map(|object| object as usize));
        assert!((0..2).all(|clip| in_each_clip.get(clip) == Tensor::from_slice(&expected)));
    }

    /// Three balls in four clips: in the third the model swaps the last two, in the fourth the first two.
    #[test]
    fn only_what_looks_alike_is_matched_in_each_clip() {
        let truth = Tensor::arange(4 * 5 * 3 * 2, (Kind::Double, tch::Device::Cpu)).reshape([4, 5, 3, 2]);
        let swaps = Tensor::from_slice(&[0i64, 1, 2, 0, 1, 2, 0, 2, 1, 1, 0, 2]).reshape([4, 3]);
        let seen = reordered(&truth, &swaps);
        let remaining = |twins: &[usize]| {
            let (order, in_each_clip) = best_orders(&seen, &truth, twins, Coordinates::Position).unwrap();
            assert_eq!(order, [0, 1, 2]);
            let error = difference(&reordered(&seen, &in_each_clip), &truth, Coordinates::Position);
            (0..4).map(|clip| rms(&error.get(clip)) > 1.0).collect::<Vec<_>>()
        };
        assert_eq!(remaining(&[0, 0, 2]), [false, false, true, false]);
        assert_eq!(remaining(&[0, 1, 2]), [false, false, true, true]);
    }

    #[test]
    fn angles_differ_by_the_shorter_way_round() {
        let angle = |values: &[f64]| Tensor::from_slice(values).reshape([1, 2, 1, 1]);
        let apart = difference(&angle(&[6.4, -3.1]), &angle(&[0.0, 3.1]), Coordinates::Angle);
        let found: Vec<f64> = apart.flatten(0, 3).try_into().unwrap();
        let expected = [6.4 - TAU, TAU - 6.2];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        assert!((rms(&angle(&[3.0, -4.0])) - 12.5f64.sqrt()).abs() < 1e-12);
    }
}
