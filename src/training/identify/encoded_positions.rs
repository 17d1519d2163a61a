//! Where the objects of some clips are seen: by the encoder, aligned with the picture, and by the centroids of its masks.
//!
//! Two measures of one thing. The localisation network may be beside its object; a mask's centroid may hold a part of
//! another's. Where they agree but for an offset that is always the same, the positions can be trusted.

use tch::{Device, Kind, Tensor};

use crate::datasets::iterators::Clips;
use crate::network::cells::{Actions, Coordinates};
use crate::network::physics_models::PhysicsNet;
use crate::network::system::System;
use crate::training::objects::motion::MotionDetector;

/// An object whose mask holds less of what moves than this, in saturated pixels, has no centroid: the encoder's position
/// without its offset stands for it.
const LEAST_MASS: f64 = 0.5;

/// Of a pixel, the share of the object that has most of it.
const MOST: f64 = 0.5;

/// Positions in pixels, in the encoder's order of objects: `[clips, time, 2 * objects]`.
#[derive(Debug)]
pub struct EncodedPositions {
    /// The encoder's, aligned with the picture, without the offsets.
    pub encoded: Tensor,
    pub centroids: Tensor,
    /// The encoder's minus the centroids', the median over the frames that have one, `[2 * objects]`. 0 where coordinates are
    /// angles: only the direction of what is seen counts there, and one and the same offset in pixels would turn it.
    pub offsets: Vec<f64>,
    /// Share of the frames in which each object's mask holds something that moves, `[objects]`.
    pub present: Vec<f64>,
    /// Of all that moves, the share that each object's mask holds on average, `[objects]`.
    pub owned: Vec<f64>,
    /// Of all that moves, what the masks hold together.
    pub covered: f64,
    /// What acts during the clips.
    pub actions: Actions,
}

impl EncodedPositions {
    /// The objects of the first `count` clips, seen `batch` clips at a time.
    pub fn of(model: &PhysicsNet, clips: &Clips, motion: &MotionDetector, count: usize, batch: usize) -> Self {
        let _guard = tch::no_grad_guard();
        let time = clips.time() as i64;
        let chosen: Vec<i64> = (0..clips.len().min(count) as i64).collect();
        let (mut encoded, mut centroids, mut present, mut owned, mut covered) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for chosen in chosen.chunks(batch) {
            let frames = clips.batch(chosen, clips.time()).flatten(0, 1);
            let places = clips.places(chosen, clips.time());
            let encoding = model.look(&frames);
            let excess = motion.of(clips, &places, &frames).excess;
            let masses = Masses::of(model, &encoding.masks, &excess);
            let in_all = excess.sum_dim_intlist([1i64, 2].as_slice(), false, None).clamp_min(LEAST_MASS);
            let objects = encoding.masks.narrow(1, 0, model.system.objects as i64);
            let held = (objects * excess.unsqueeze(1)).sum_dim_intlist([2i64, 3].as_slice(), false, None);
            covered.push(held.sum_dim_intlist([1i64].as_slice(), false, None) / &in_all);
            owned.push(held / in_all.unsqueeze(1));
            present.push(masses.present.to_kind(Kind::Float));
            let aligned = model.aligned_places(&frames, &encoding.positions);
            for (all, part) in [(&mut encoded, aligned), (&mut centroids, masses.centroid)] {
                all.push(part.reshape([chosen.len() as i64, time, -1]));
            }
        }
        let coordinates = model.system.cell.coordinates;
        let (encoded, centroids, offsets) =
            two_measures(coordinates, &on_cpu(&encoded), &on_cpu(&centroids), &on_cpu(&present));
        let mean = |parts: &[Tensor]| on_cpu(parts).mean_dim([0i64].as_slice(), false, Kind::Double);
        let numbers = |x: Tensor| -> Vec<f64> { x.try_into().expect("numbers") };
        EncodedPositions {
            encoded,
            centroids,
            offsets: numbers(offsets),
            present: numbers(mean(&present)),
            owned: numbers(mean(&owned)),
            covered: mean(&covered).double_value(&[]),
            actions: clips.actions(&chosen),
        }
    }

    /// One pixel in the unit of the equation's coordinates: 1, or radians where an object usually is.
    pub fn pixel(&self, system: &System) -> f64 {
        match system.cell.coordinates {
            Coordinates::Position => 1.0,
            Coordinates::Angle => {
                let from_middle = self.centroids.reshape([-1, 2]) - system.side as f64 / 2.0;
                let arm = from_middle.square().sum_dim_intlist([1i64].as_slice(), false, None).sqrt().median();
                1.0 / arm.double_value(&[]).max(1.0)
            }
        }
    }

    /// The usual distance between the two measures of a coordinate, pixels.
    pub(crate) fn disagreement(&self) -> f64 {
        (&self.encoded - &self.centroids).abs().median().double_value(&[])
    }
}

/// The encoder's positions without their offsets, the centroids with these in the place of those that are none, and the offsets
/// `[2 * objects]`. Positions `[clips, time, 2 * objects]`; `present`: 1 where there is a centroid, 0 elsewhere,
/// `[clips * time, objects]`.
fn two_measures(
    coordinates: Coordinates,
    encoded: &Tensor,
    centroids: &Tensor,
    present: &Tensor,
) -> (Tensor, Tensor, Tensor) {
    let present = present.gt(0.5).unsqueeze(2).expand([-1, -1, 2], false).reshape(encoded.size());
    let apart = (encoded - centroids).where_self(&present, &encoded.full_like(f64::NAN));
    // None of an object that never is present.
    let apart = apart.flatten(0, 1).nanmedian_dim(0, false).0.nan_to_num(0.0, None, None);
    let offsets = match coordinates {
        Coordinates::Position => apart,
        Coordinates::Angle => apart.zeros_like(),
    };
    let encoded = encoded - &offsets;
    let centroids = centroids.where_self(&present, &encoded);
    (encoded, centroids, offsets)
}

/// Where the fits are made, and in their precision.
fn on_cpu(parts: &[Tensor]) -> Tensor {
    Tensor::cat(parts, 0).to_device(Device::Cpu).to_kind(Kind::Double)
}

/// What moves under each object's mask in some frames.
struct Masses {
    /// Whether there is enough of it, `[frames, objects]`.
    present: Tensor,
    /// Its centroid `(x, y)` where there is, pixels, `[frames, objects, 2]`.
    centroid: Tensor,
}

impl Masses {
    /// A pixel counts for the object that has most of it: a tenth of another object would draw the centroid towards that.
    fn of(model: &PhysicsNet, masks: &Tensor, excess: &Tensor) -> Self {
        let centres = model.pixel_centres();
        let masks = masks.narrow(1, 0, model.system.objects as i64);
        let owned = masks.square() * masks.gt(MOST) * excess.unsqueeze(1);
        let mass = owned.sum_dim_intlist([2i64, 3].as_slice(), false, None);
        let along = |axis: i64| {
            let by_pixel = owned.sum_dim_intlist([axis].as_slice(), false, None);
            (by_pixel * &centres).sum_dim_intlist([2i64].as_slice(), false, None) / mass.clamp_min(LEAST_MASS)
        };
        Masses { present: mass.ge(LEAST_MASS), centroid: Tensor::stack(&[along(2), along(3)], 2) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An object that is seen 2 pixels to the right of its mask, in frames without one as well.
    #[test]
    fn a_position_without_a_mask_has_no_offset_either() {
        let places = Tensor::arange(12, (Kind::Double, Device::Cpu)).reshape([2, 3, 2]);
        let encoded = &places + Tensor::from_slice(&[2.0, 0.0]);
        // Most frames have no mask: what stands for its centroid there is not counted.
        let present = Tensor::from_slice(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0]).reshape([6, 1]);
        let seen = present.reshape([2, 3, 1]);
        let of = |encoded: &Tensor, centroids: &Tensor, present: &Tensor| {
            two_measures(Coordinates::Position, encoded, centroids, present)
        };
        let (encoded, centroids, offsets) = of(&encoded, &(&places * seen), &present);
        assert_eq!(Vec::<f64>::try_from(offsets).unwrap(), [2.0, 0.0]);
        assert!(encoded.equal(&places) && centroids.equal(&places));
        let (_, _, offsets) = of(&places, &places, &present.zeros_like());
        assert_eq!(Vec::<f64>::try_from(offsets).unwrap(), [0.0, 0.0]);
    }

    /// A rod that the encoder sees farther from the middle than the centroid is: its directions are left as they are.
    #[test]
    fn a_direction_is_not_turned_by_a_distance() {
        let angles = Tensor::arange(12, (Kind::Double, Device::Cpu)) * 0.3 - 0.5;
        let at = |arm: f64| Tensor::stack(&[angles.sin() * arm, -angles.cos() * arm], 1).reshape([2, 6, 2]) + 16.0;
        let present = Tensor::ones([12, 1], (Kind::Double, Device::Cpu));
        let (encoded, centroids, offsets) = two_measures(Coordinates::Angle, &at(8.0), &at(7.0), &present);
        assert!(encoded.equal(&at(8.0)) && centroids.equal(&at(7.0)));
        assert_eq!(Vec::<f64>::try_from(offsets).unwrap(), [0.0, 0.0]);
    }
}
