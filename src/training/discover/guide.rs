//! Guides for the encoder's masks while objects are being found: what moves belongs to an object, each object is in
//! one place and of one colour, none goes without, and its position is where its mask is.
//!
//! The reconstruction alone gets stuck: the first object that finds a ball leaves the other without a gradient. The
//! guides look only at the frame and at its median over the dataset, the static background. They fade to zero, so the
//! phase ends at an optimum of the plain loss. Not in the original.

use anyhow::{Result, ensure};
use serde::{Deserialize, Serialize};
use tch::{Kind, Tensor};

use crate::network::physics_models::Encoding;
use crate::training::ranges::not_negative;

/// Weights of the guides. 0 switches one off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guide {
    /// Difference from the median frame, summed over channels, at which a pixel counts as moving.
    pub temperature: f64,
    /// Masks of the objects together cover what moves.
    pub coverage: f64,
    /// Each mask is in one place.
    pub compactness: f64,
    /// No object goes without its share.
    pub balance: f64,
    /// Each object is of one colour.
    pub colour: f64,
    /// An object's position is at the centroid of its mask.
    pub tie: f64,
    /// Steps with the guides at full weight, and the step from which they are off.
    pub full_until: u64,
    pub zero_from: u64,
}

impl Guide {
    pub(super) fn check(&self) -> Result<()> {
        let Guide { temperature, coverage, compactness, balance, colour, tie, full_until, zero_from } = *self;
        for (key, number) in [
            ("discover.guide.coverage", coverage),
            ("discover.guide.compactness", compactness),
            ("discover.guide.balance", balance),
            ("discover.guide.colour", colour),
            ("discover.guide.tie", tie),
        ] {
            not_negative(key, number)?;
        }
        ensure!(temperature > 0.0, "config: discover.guide.temperature = {temperature}: must be positive");
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

/// What moves in each pixel, `[frames, S, S]` in \[0, 1): `1 - exp(-|frame - median| / temperature)`, the difference
/// summed over channels.
pub fn moving(frames: &Tensor, median: &Tensor, temperature: f64) -> Tensor {
    let difference = (frames - median).abs().sum_dim_intlist([1i64].as_slice(), false, None);
    1.0 - (difference / -temperature).exp()
}

/// The weight of all guides at a step: 1, then a half cosine down to 0.
pub fn fade(guide: &Guide, step: u64) -> f64 {
    if step < guide.full_until {
        1.0
    } else if step >= guide.zero_from {
        0.0
    } else {
        let share = (step - guide.full_until) as f64 / (guide.zero_from - guide.full_until) as f64;
        0.5 * (1.0 + (std::f64::consts::PI * share).cos())
    }
}

/// The weighted sum of the guides for frames `[frames, channels, S, S]`.
///
/// * `moving`: see [`moving`];
/// * `responsibilities`: each object's responsibility by colour, see
///   [`Anchors::responsibilities`](super::anchors::Anchors::responsibilities), if there is any;
/// * `pixel_centres`: the position of each pixel index on an axis, `[S]`, in the model's coordinates.
pub fn loss(
    guide: &Guide,
    encoding: &Encoding,
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

    // Compactness: variance of what an object owns around its centroid, in units of the frame's side.
    let spread = |along: &Tensor, centre: &Tensor| {
        sum(&(along * (pixel_centres - centre.unsqueeze(-1)).square()), &[1, 2]) / &moving_in_all
    };
    let compactness = (spread(&by_column, &x) + spread(&by_row, &y)).mean(Kind::Float) / (side * side) as f64;

    // Balance: divergence of the objects' shares from equal ones. Unlike the shares' entropy it has a gradient for an
    // object that owns nothing.
    let total_share = &mass / moving_in_all.unsqueeze(1);
    let share = total_share.mean_dim([0i64].as_slice(), false, None);
    let share = &share / share.sum(Kind::Float);
    let balance = -(share + 1e-8).log().mean(Kind::Float) - (objects as f64).ln();

    // Tie: the encoded position at the centroid, counted as far as the object owns anything.
    let centroids = Tensor::stack(&[x, y], 2).detach();
    let owns = (total_share * objects as f64).clamp_max(1.0).detach();
    let positions = encoding.positions.reshape([-1, objects, 2]);
    let distance = positions.smooth_l1_loss(&centroids, tch::Reduction::None, 1.0);
    let tie = sum(&(sum(&distance, &[2]) * owns), &[1]).mean(Kind::Float);

    let guides =
        coverage * guide.coverage + compactness * guide.compactness + balance * guide.balance + tie * guide.tie;
    let Some(responsibilities) = responsibilities else { return guides };

    // Colour: cross-entropy between the responsibilities by colour and the masks.
    let log_among = among.clamp_min(LEAST_MASK).log();
    let colour = -sum(&(moving.unsqueeze(1) * responsibilities * log_among), &[0, 1, 2, 3]) / sum(&moving_in_all, &[0]);
    guides + colour * guide.colour
}

fn sum(x: &Tensor, axes: &[i64]) -> Tensor {
    x.sum_dim_intlist(axes, false, None)
}
