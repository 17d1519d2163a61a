//! Guides for the encoder's masks while objects are being found: what moves belongs to an object, each object is the same
//! blob in every frame, and its position is where its mask is.
//!
//! The reconstruction alone gets stuck: the first object that finds a ball leaves the other without a gradient. The
//! guides look only at the frames. Where the blobs cannot be told apart, two weaker ones stand in: each object is in one
//! place, and none goes without. They fade to zero, so the phase ends at an optimum of the plain loss. Not in the
//! original.

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};
use tch::{Kind, Tensor};

use crate::network::physics_models::Encoding;
use crate::training::ranges::not_negative;

/// Weights of the guides. 0 switches one off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guide {
    /// Masks of the objects together cover what moves.
    pub coverage: f64,
    /// Each object is the same blob in every frame. At 0 blobs have no names at all: sprites begin as a bump, and objects that
    /// look alike take no more steps than others.
    pub identity: f64,
    /// Where blobs cannot be told apart: each mask is in one place.
    pub compactness: f64,
    /// Where blobs cannot be told apart: no object goes without its share.
    pub balance: f64,
    /// An object's position is at the centroid of its mask.
    pub tie: f64,
    /// Steps with the guides at full weight; more where the objects are not found by then.
    pub full_until: u64,
    /// The step from which they are off; later by as many where those are more.
    pub zero_from: u64,
    /// Whether they have full weight until the objects are drawn also on whole frames after halved ones; otherwise they fade
    /// there at once.
    #[serde(default = "yes")]
    pub waits: bool,
}

fn yes() -> bool {
    true
}

impl Guide {
    pub(super) fn check(&self) -> Result<()> {
        let Guide { coverage, compactness, balance, identity, tie, full_until, zero_from, waits: _ } = *self;
        for (key, number) in [
            ("discover.guide.coverage", coverage),
            ("discover.guide.compactness", compactness),
            ("discover.guide.balance", balance),
            ("discover.guide.identity", identity),
            ("discover.guide.tie", tie),
        ] {
            not_negative(key, number)?;
        }
        ensure!(
            full_until <= zero_from,
            "config: discover.guide.full_until = {full_until} must not come after zero_from = {zero_from}"
        );
        Ok(())
    }
}

/// Keeps centroids of empty masks finite.
const EMPTY: f64 = 1e-3;

/// Keeps the logarithm of a mask finite; far below any mask that still has a gradient.
const LEAST_MASK: f64 = 1e-30;

/// The weighted sum of the guides for frames `[frames, channels, S, S]`.
///
/// * `positions`: as the localisation network has them, `[frames, 2 * objects]`, without a way back to the masks;
/// * `moving`: [`Foreground::share`](crate::training::objects::motion::Foreground::share);
/// * `responsibilities`: [`Names::responsibilities`](crate::training::objects::names::Names::responsibilities), if there
///   are names;
/// * `pixel_centres`: the position of each pixel index on an axis, `[S]`, in the model's coordinates.
pub(crate) fn loss(
    guide: &Guide,
    encoding: &Encoding,
    positions: &Tensor,
    moving: &Tensor,
    responsibilities: Option<&Tensor>,
    pixel_centres: &Tensor,
) -> Tensor {
    let objects = encoding.masks.size()[1] - 1;
    let side = moving.size()[1];
    let masks = encoding.masks.narrow(1, 0, objects);
    let background = encoding.masks.select(1, objects);
    let some_object = sum(&masks, &[1]).clamp_min(LEAST_MASK);
    let moving_in_all = sum(moving, &[1, 2]) + EMPTY;
    let static_in_all = ((side * side) as f64 - &moving_in_all).clamp_min(EMPTY);

    // Coverage: cross-entropy between "some object's mask" and "moves", moving and static pixels weighing the same.
    let log_object = some_object.log();
    let log_background = background.clamp_min(LEAST_MASK).log();
    let coverage = -(sum(&(moving * log_object), &[1, 2]) / &moving_in_all
        + sum(&((1.0 - moving) * log_background), &[1, 2]) / &static_in_all)
        .mean(Kind::Float);

    // The objects among themselves, the background left out: otherwise pixels given to it would look compact.
    let among = masks / some_object.unsqueeze(1);

    // What each object owns of what moves, its mass [frames, objects] and its centroid.
    let owned = &among * moving.unsqueeze(1);
    let mass = sum(&owned, &[2, 3]);
    let by_row = sum(&owned, &[3]);
    let by_column = sum(&owned, &[2]);
    let centroid = |along: &Tensor| sum(&(along * pixel_centres), &[2]) / (&mass + EMPTY);
    let (x, y) = (centroid(&by_column), centroid(&by_row));

    // Tie: the encoded position at the centroid, counted as far as the object owns anything.
    let total_share = &mass / moving_in_all.unsqueeze(1);
    let centroids = Tensor::stack(&[&x, &y], 2).detach();
    let owns = (&total_share * objects as f64).clamp_max(1.0).detach();
    let positions = positions.reshape([-1, objects, 2]);
    let distance = positions.smooth_l1_loss(&centroids, tch::Reduction::None, 1.0);
    let tie = sum(&(sum(&distance, &[2]) * owns), &[1]).mean(Kind::Float);

    let guides = coverage * guide.coverage + tie * guide.tie;
    let Some(responsibilities) = responsibilities else {
        // Compactness: variance of what an object owns around its centroid, in units of the frame's side.
        let spread = |along: &Tensor, centre: &Tensor| {
            sum(&(along * (pixel_centres - centre.unsqueeze(-1)).square()), &[1, 2]) / &moving_in_all
        };
        let extent = pixel_centres.diff(1, 0, None::<Tensor>, None::<Tensor>).mean(Kind::Float) * side as f64;
        let compactness = (spread(&by_column, &x) + spread(&by_row, &y)).mean(Kind::Float) / extent.square();

        // Balance: divergence of the objects' shares from equal ones. Unlike the shares' entropy it has a gradient for an
        // object that owns nothing.
        let share = total_share.mean_dim([0i64].as_slice(), false, None);
        let share = &share / share.sum(Kind::Float);
        let balance = -(share + 1e-8).log().mean(Kind::Float) - (objects as f64).ln();
        return guides + compactness * guide.compactness + balance * guide.balance;
    };

    // Identity: cross-entropy between the named blobs and the masks.
    let log_among = among.clamp_min(LEAST_MASK).log();
    let named = moving.unsqueeze(1) * responsibilities;
    let identity = -sum(&(&named * log_among), &[0, 1, 2, 3]) / (sum(&named, &[0, 1, 2, 3]) + EMPTY);
    guides + identity * guide.identity
}

fn sum(x: &Tensor, axes: &[i64]) -> Tensor {
    x.sum_dim_intlist(axes, false, None)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: i64 = 16;

    fn guide() -> Guide {
        Guide {
            coverage: 10.0,
            identity: 10.0,
            compactness: 300.0,
            balance: 10.0,
            tie: 5.0,
            full_until: 10,
            zero_from: 20,
            waits: true,
        }
    }

    /// A square of 4 x 4 pixels from this pixel on, `[1, S, S]`.
    fn square(x: i64, y: i64) -> Tensor {
        let frame = Tensor::zeros([1, SIDE, SIDE], (Kind::Float, tch::Device::Cpu));
        let _ = frame.narrow(1, y, 4).narrow(2, x, 4).fill_(1.0);
        frame
    }

    /// Two objects whose masks are nearly these squares.
    fn encoding(first: &Tensor, second: &Tensor) -> Encoding {
        let logits = Tensor::stack(&[&(first * 8.0), &(second * 8.0), &first.full_like(4.0)], 1);
        let masks = logits.softmax(1, Kind::Float);
        Encoding { masked: masks.shallow_clone(), positions: Tensor::new(), masks }
    }

    fn at(first: [f32; 2], second: [f32; 2]) -> Tensor {
        Tensor::from_slice(&[first, second].concat()).unsqueeze(0)
    }

    /// Frames with the two squares at (2, 3) and (10, 9).
    fn guides(encoding: &Encoding, positions: &Tensor, named: bool) -> f64 {
        let (a, b) = (square(2, 3), square(10, 9));
        let responsibilities = Tensor::stack(&[&a, &b], 1);
        let centres = Tensor::arange(SIDE, (Kind::Float, tch::Device::Cpu)) + 0.5;
        let named = named.then_some(&responsibilities);
        loss(&guide(), encoding, positions, &(&a + &b), named, &centres).double_value(&[])
    }

    #[test]
    fn masks_on_their_objects_cost_less_than_beside_them() {
        let positions = at([4.0, 5.0], [12.0, 11.0]);
        for named in [false, true] {
            let right = guides(&encoding(&square(2, 3), &square(10, 9)), &positions, named);
            let beside = guides(&encoding(&square(6, 3), &square(10, 9)), &positions, named);
            let missing = guides(&encoding(&square(2, 3), &square(2, 3)), &positions, named);
            assert!(right < 0.5 * beside && right < 0.5 * missing, "named {named}: {right}, {beside}, {missing}");
        }
    }

    #[test]
    fn names_tell_which_mask_is_whose_and_nothing_else_does() {
        let (right, swapped) = (encoding(&square(2, 3), &square(10, 9)), encoding(&square(10, 9), &square(2, 3)));
        let (here, there) = (at([4.0, 5.0], [12.0, 11.0]), at([12.0, 11.0], [4.0, 5.0]));
        assert!(guides(&right, &here, true) + 10.0 < guides(&swapped, &there, true));
        let unnamed = [guides(&right, &here, false), guides(&swapped, &there, false)];
        assert!((unnamed[0] - unnamed[1]).abs() < 1e-3, "{unnamed:?}");
    }

    #[test]
    fn a_position_belongs_to_its_mask() {
        let masks = encoding(&square(2, 3), &square(10, 9));
        let apart = guides(&masks, &at([7.0, 5.0], [12.0, 11.0]), true);
        let together = guides(&masks, &at([4.0, 5.0], [12.0, 11.0]), true);
        // 3 px beyond the quadratic part of a smooth L1: 2.5, times the weight.
        assert!((apart - together - 2.5 * 5.0).abs() < 0.5, "{together} {apart}");
    }
}
