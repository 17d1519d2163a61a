//! Names: which blob of one frame is which of another, by how they look; by their place where they look alike.

use rand::seq::SliceRandom;
use tch::Tensor;

use super::blobs::{self, FrameBlobs, MovingBlob};
use super::motion::{Foreground, MotionDetector};
use crate::datasets::iterators::Clips;
use crate::support::assignment::best_assignment;
use crate::support::random::named_generator;
use crate::support::statistics::upper_median;

/// Frames from which the looks of the objects are learned.
const FRAMES: usize = 500;
/// Blobs that are farther apart than this many of their radii are taken for one object each.
const APART: f64 = 2.5;
/// Clean frames that are needed, and clusterings started.
const LEAST_FRAMES: usize = 20;
const STARTS: usize = 8;
const UPDATES: usize = 10;
/// Two looks are told apart if in few frames the better naming of two blobs is better by less than half of what it
/// usually is. Looks that are equal but for noise are so in 26 % of the frames (the half of a half-normal's median).
const UNSURE: f64 = 0.12;
/// A blob of an object is between these shares of its usual mass, and at most so many of its usual radii wide.
const MASS: [f64; 2] = [0.55, 1.5];
const RADIUS: f64 = 1.35;
/// Objects that look alike are told by their order along an axis, where they are as far apart on it as this, pixels.
const ORDER_GAP: f64 = 1.0;

/// How one object looks.
#[derive(Debug, Clone)]
struct ObjectLook {
    moments: Vec<f64>,
    mass: f64,
    radius: f64,
}

/// How each object looks, and which look alike.
#[derive(Debug)]
pub struct Names {
    looks: Vec<ObjectLook>,
    /// For each object the least of those that look like it.
    class: Vec<usize>,
    /// The axis of the order of those that look alike: 0 is x.
    axis: i64,
}

/// What moves in the frames from which the looks of these clips' objects are learned, and the blobs in each of them.
pub(crate) fn looked_at(
    clips: &Clips,
    motion: &MotionDetector,
    objects: usize,
    seed: u64,
) -> (Foreground, Vec<FrameBlobs>) {
    let places = clips.random_places(FRAMES, seed, u64::MAX);
    let moving = motion.of(clips, &places, &clips.frames(&places));
    let found = blobs::find(&moving, objects);
    (moving, found)
}

fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

/// The blob of each look.
fn named(frame: &[MovingBlob], looks: &[Vec<f64>]) -> Vec<usize> {
    let cost = |look: &Vec<f64>| frame.iter().map(|blob| squared_distance(&blob.look, look)).collect();
    best_assignment(&looks.iter().map(cost).collect::<Vec<_>>())
}

/// How the objects look, by the cheapest of some rounds of k-means in which each frame has a blob of each object.
fn cluster(frames: &[&[MovingBlob]], seed: u64) -> Vec<Vec<f64>> {
    let mut starts: Vec<usize> = (0..frames.len()).collect();
    starts.shuffle(&mut named_generator(seed, "looks"));
    let mut best: Option<(f64, Vec<Vec<f64>>)> = None;
    for &start in starts.iter().take(STARTS) {
        let mut looks: Vec<_> = frames[start].iter().map(|blob| blob.look.clone()).collect();
        for _ in 0..UPDATES {
            looks = mean_looks(frames, &looks);
        }
        let mut cost = 0.0;
        for frame in frames {
            let blobs = named(frame, &looks);
            cost += blobs.iter().zip(&looks).map(|(&b, look)| squared_distance(&frame[b].look, look)).sum::<f64>();
        }
        if best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, looks));
        }
    }
    best.expect("at least one start").1
}

/// Whether two objects are told apart by their looks in too few frames: by how much dearer it is to exchange them.
fn are_alike(frames: &[Vec<MovingBlob>], looks: &[Vec<f64>], [a, b]: [usize; 2]) -> bool {
    let margin = |frame: &Vec<MovingBlob>| {
        let cost = |blob: usize, look: usize| squared_distance(&frame[blob].look, &looks[look]);
        cost(a, b) + cost(b, a) - cost(a, a) - cost(b, b)
    };
    let margins: Vec<f64> = frames.iter().map(margin).collect();
    let half = 0.5 * upper_median(margins.iter().copied()).unwrap_or(0.0);
    margins.iter().filter(|margin| **margin < half).count() as f64 > UNSURE * margins.len() as f64
}

impl Names {
    /// Learns how the objects look from the blobs of some frames. None where too few frames show them apart.
    pub fn learn(frames: &[FrameBlobs], seed: u64) -> Option<Self> {
        let frames: Vec<&[MovingBlob]> =
            frames.iter().map(|frame| &frame.blobs[..]).filter(|frame| is_clean(frame)).collect();
        if frames.len() < LEAST_FRAMES {
            return None;
        }
        let looks = cluster(&frames, seed);
        let by_name =
            |frame: &&[MovingBlob]| named(frame, &looks).into_iter().map(|blob| frame[blob].clone()).collect();
        let frames: Vec<Vec<MovingBlob>> = frames.iter().map(by_name).collect();
        let objects = looks.len();
        let first_alike = |b: usize| (0..b).find(|&a| are_alike(&frames, &looks, [a, b])).unwrap_or(b);
        let class: Vec<usize> = (0..objects).map(first_alike).collect();
        let of_object = |number: fn(&MovingBlob) -> f64, object: usize| {
            // Objects that look alike share their numbers.
            let same = (0..objects).filter(|&other| class[other] == class[object]);
            upper_median(same.flat_map(|other| frames.iter().map(move |frame| number(&frame[other])))).unwrap_or(0.0)
        };
        let looks = looks
            .into_iter()
            .enumerate()
            .map(|(object, moments)| ObjectLook {
                moments,
                mass: of_object(|blob| blob.mass, object),
                radius: of_object(|blob| blob.radius, object),
            })
            .collect();
        let axis = order_axis(&frames, &class);
        Some(Names { looks, class, axis })
    }

    /// How many objects look like one before them.
    pub fn alike(&self) -> usize {
        self.class.iter().enumerate().filter(|(object, class)| object != *class).count()
    }

    /// How many objects look like each other at most; 1 where none do.
    pub(crate) fn largest_group(&self) -> usize {
        let members = |class: usize| self.class.iter().filter(|&&of| of == class).count();
        (0..self.class.len()).map(members).max().unwrap_or(1)
    }

    /// The blob of each object in a frame; none where it cannot be told.
    pub fn of(&self, frame: &[MovingBlob]) -> Vec<Option<usize>> {
        let objects = self.looks.len();
        let looks: Vec<_> = self.looks.iter().map(|look| look.moments.clone()).collect();
        let mut blob_of = named(frame, &looks);
        let mut apart = vec![true; objects];
        let along = |blob: usize| frame[blob].centre[self.axis as usize];
        for class in 0..objects {
            let same: Vec<usize> = (0..objects).filter(|&object| self.class[object] == class).collect();
            let mut blobs: Vec<usize> = same.iter().map(|&object| blob_of[object]).collect();
            blobs.sort_by(|&a, &b| along(a).total_cmp(&along(b)));
            for (place, &object) in same.iter().enumerate() {
                blob_of[object] = blobs[place];
                let gap = |a: usize, b: usize| along(blobs[b]) - along(blobs[a]) >= ORDER_GAP;
                apart[object] =
                    (place == 0 || gap(place - 1, place)) && (place + 1 == same.len() || gap(place, place + 1));
            }
        }
        let sure = |object: usize| {
            let (look, blob) = (&self.looks[object], &frame[blob_of[object]]);
            let usual = blob.mass > MASS[0] * look.mass
                && blob.mass < MASS[1] * look.mass
                && blob.radius < RADIUS * look.radius;
            (usual && apart[object]).then_some(blob_of[object])
        };
        (0..objects).map(sure).collect()
    }

    /// Which pixels are whose, `[frames, objects, S, S]` on the CPU: 1 in the blob that is the object, all 0 for an object
    /// whose blob cannot be told.
    pub fn responsibilities(&self, frames: &[FrameBlobs]) -> Tensor {
        let mut shares = Vec::new();
        for FrameBlobs { blobs, nearest } in frames {
            for blob in self.of(blobs) {
                shares.extend(nearest.iter().map(|&near| f32::from(blob == Some(near as usize))));
            }
        }
        let side = frames.first().map_or(0, |frame| frame.nearest.len().isqrt()) as i64;
        Tensor::from_slice(&shares).reshape([frames.len() as i64, self.looks.len() as i64, side, side])
    }

    /// The largest usual radius of an object's blob, pixels.
    pub(crate) fn largest_radius(&self) -> f64 {
        self.looks.iter().fold(0.0, |largest, look| largest.max(look.radius))
    }
}

/// Whether all blobs are apart from each other.
fn is_clean(frame: &[MovingBlob]) -> bool {
    let pairs = (0..frame.len()).flat_map(|b| (0..b).map(move |a| (a, b)));
    frame.iter().all(|blob| blob.mass > 1.0)
        && pairs.into_iter().all(|(a, b)| {
            let widest = frame[a].radius.max(frame[b].radius);
            squared_distance(&frame[a].centre, &frame[b].centre) > (APART * widest).powi(2)
        })
}

/// The mean descriptor of the blobs that are nearest to each look, one of each frame.
fn mean_looks(frames: &[&[MovingBlob]], looks: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut sums = vec![vec![0.0; looks[0].len()]; looks.len()];
    for frame in frames {
        for (sum, blob) in sums.iter_mut().zip(named(frame, looks)) {
            sum.iter_mut().zip(&frame[blob].look).for_each(|(sum, number)| *sum += number);
        }
    }
    sums.iter_mut().flatten().for_each(|sum| *sum /= frames.len() as f64);
    sums
}

/// The axis along which objects that look alike are farther apart: of all such pairs the one whose median is larger.
fn order_axis(frames: &[Vec<MovingBlob>], class: &[usize]) -> i64 {
    let apart = |axis: usize| {
        let pairs = (0..class.len()).flat_map(|b| (0..b).filter(move |&a| class[a] == class[b]).map(move |a| (a, b)));
        let gaps = pairs.flat_map(|(a, b)| frames.iter().map(move |f| (f[a].centre[axis] - f[b].centre[axis]).abs()));
        upper_median(gaps).unwrap_or(0.0)
    };
    i64::from(apart(1) > apart(0))
}
