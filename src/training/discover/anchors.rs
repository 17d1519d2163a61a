//! Colour anchors: what moves, clustered by colour into as many groups as there are objects.
//!
//! Left to itself the encoder may split a scene by place (the left ball, the right ball) rather than by identity. Where
//! objects differ in colour their groups tell which pixel is whose. Nothing but the training frames is looked at.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use tch::{Kind, Tensor};

use crate::support::random::named_generator;

/// Pixels that are clustered, and how much they must move to be taken.
const SAMPLES: i64 = 5000;
const MOVES: f64 = 0.5;
/// Keeps the colour direction of a faint pixel short, in units of a colour channel.
const FAINT: f64 = 0.02;
/// Squared distance of colour directions at which a group's responsibility falls to 1/e.
const WIDTH: f64 = 0.1;
/// Clusterings started, the best of which is taken, and the updates of each.
const STARTS: usize = 8;
const UPDATES: usize = 20;
/// Groups that explain less of the variance than this do not tell the objects apart.
const EXPLAINED: f64 = 0.8;

/// The colour directions of the groups.
#[derive(Debug)]
pub struct Anchors {
    /// `[objects, channels]`, of length at most 1.
    colours: Tensor,
}

/// Direction of the difference between frames and median in colour space, `[frames, channels, S, S]`.
fn directions(frames: &Tensor, median: &Tensor) -> Tensor {
    let difference = frames - median;
    let length = difference.square().sum_dim_intlist([1i64].as_slice(), true, None).sqrt();
    difference / (length + FAINT)
}

impl Anchors {
    /// Clusters the moving pixels of `frames` (`[frames, channels, S, S]`, `moving` `[frames, S, S]`) into `objects`
    /// groups. None where colours do not tell the objects apart.
    pub fn find(frames: &Tensor, median: &Tensor, moving: &Tensor, objects: usize, seed: u64) -> Option<Self> {
        let _guard = tch::no_grad_guard();
        let channels = frames.size()[1];
        let pixels = directions(frames, median).permute([0, 2, 3, 1]).reshape([-1, channels]);
        let places = moving.flatten(0, 2).gt(MOVES).nonzero().squeeze_dim(-1);
        let count = places.size()[0];
        if count < objects as i64 {
            return None;
        }
        // Every n-th moving pixel.
        let stride = (count / SAMPLES).max(1);
        let samples = pixels.index_select(0, &places.slice(0, 0, count, stride)).to_device(tch::Device::Cpu);
        let mut random = named_generator(seed, "colour anchors");
        let clusterings = (0..STARTS).map(|_| cluster(&samples, objects, &mut random));
        let (colours, within) = clusterings.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let mean = samples.mean_dim([0i64].as_slice(), true, None);
        let total = (&samples - mean).square().sum(Kind::Double).double_value(&[]);
        (1.0 - within / total > EXPLAINED).then(|| Anchors { colours: colours.to_device(frames.device()) })
    }

    /// Each object's responsibility for each pixel, summing to 1: `[frames, objects, S, S]`.
    pub fn responsibilities(&self, frames: &Tensor, median: &Tensor) -> Tensor {
        let directions = directions(frames, median).unsqueeze(1);
        let colours = self.colours.unsqueeze(0).unsqueeze(-1).unsqueeze(-1);
        let squared = (directions - colours).square().sum_dim_intlist([2i64].as_slice(), false, None);
        (squared / -WIDTH).softmax(1, frames.kind())
    }
}

/// Squared distances `[samples, groups]`.
fn squared_distances(samples: &Tensor, groups: &Tensor) -> Tensor {
    (samples.unsqueeze(1) - groups.unsqueeze(0)).square().sum_dim_intlist([2i64].as_slice(), false, None)
}

/// k-means from a k-means++ start: the groups' centres and the sum of squares within them.
fn cluster(samples: &Tensor, groups: usize, random: &mut ChaCha8Rng) -> (Tensor, f64) {
    let count = samples.size()[0];
    let mut centres = samples.narrow(0, random.random_range(0..count), 1);
    while centres.size()[0] < groups as i64 {
        let (nearest, _) = squared_distances(samples, &centres).min_dim(1, false);
        let cumulative = nearest.to_kind(Kind::Double).cumsum(0, Kind::Double);
        let drawn = random.random::<f64>() * cumulative.double_value(&[count - 1]);
        let place = cumulative.lt(drawn).sum(Kind::Int64).int64_value(&[]).min(count - 1);
        centres = Tensor::cat(&[&centres, &samples.narrow(0, place, 1)], 0);
    }
    for _ in 0..UPDATES {
        let nearest = squared_distances(samples, &centres).argmin(1, false);
        let members = nearest.one_hot(groups as i64).to_kind(samples.kind());
        let sizes = members.sum_dim_intlist([0i64].as_slice(), false, None).clamp_min(1.0).unsqueeze(1);
        centres = members.transpose(0, 1).matmul(samples) / sizes;
    }
    let (nearest, _) = squared_distances(samples, &centres).min_dim(1, false);
    (centres, nearest.sum(Kind::Double).double_value(&[]))
}
