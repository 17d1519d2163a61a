//! What moves: where a frame differs from what stands behind it, by more than its noise.

use tch::{Kind, Tensor};

use crate::datasets::iterators::Clips;

/// Frames from which what stands behind is measured.
pub const FRAMES: usize = 2000;
const COMPARED_FRAMES: usize = 200;
/// A frame's level of noise is the median difference of its pixels; what moves differs by more than this many of them.
const LEVELS: f64 = 3.0;
/// Where more than this share of the pixels never changes, the level is that of the others: black bars beside a filmed strip
/// have no noise. It counts up to this; what differs more there is an object that hardly leaves its place.
const STILL_SHARE: f64 = 0.5;
const QUIET: f64 = 0.1;
/// The still background is left for each clip's own where that explains the frames this much better, and there is
/// something to explain: a summed difference of so much.
const BETTER: f64 = 0.6;
const WORTH_EXPLAINING: f64 = 0.03;
/// Difference beyond the noise, summed over channels, at which a pixel counts as moving to 63 %.
const SATURATION: f64 = 0.1;

/// What of a pixel's share must move for it to count as moving, where it does or does not.
const MOVES: f64 = 0.5;

/// A pixel is a speckle where it differs by so much, summed over channels, and by so many levels of noise, while the median
/// of the 3x3 pixels about it differs by less than the third number. Frames are speckled where more than this share of all
/// that differs so much are speckles (of objects only corners are), and more than this share of all pixels: a tiny object
/// may be all speckle.
const SPECKLE: f64 = 0.3;
const SPECKLE_LEVELS: f64 = 6.0;
const AROUND_SPECKLE: f64 = 0.1;
const SPECKLED: f64 = 0.06;
const SPECKLED_PIXELS: f64 = 0.002;

/// What stands behind the objects.
#[derive(Debug)]
enum BackgroundEstimate {
    /// The same in all clips: the median over the dataset, `[channels, S, S]`.
    Still(Tensor),
    /// Another one in each clip: the median over its frames.
    OfEachClip,
}

/// Tells what moves in the frames of one dataset.
#[derive(Debug)]
pub struct MotionDetector {
    background: BackgroundEstimate,
    /// Whether single pixels differ for no reason: then neighbours vote instead of being averaged.
    speckled: bool,
    /// Places of the pixels that say how noisy a frame is, where these are not all.
    noisy: Option<Tensor>,
    /// The median over the dataset, `[channels, S, S]`.
    pub median: Tensor,
}

/// What moves in some frames.
#[derive(Debug)]
pub struct Foreground {
    /// Frames minus what stands behind them, `[frames, channels, S, S]`.
    pub sharp: Tensor,
    /// The same averaged over 3x3 pixels, or their median.
    pub difference: Tensor,
    /// Its size summed over channels, beyond the noise, at least 0: `[frames, S, S]`.
    pub excess: Tensor,
    /// Whether a pixel moves, in \[0, 1): `[frames, S, S]`.
    pub share: Tensor,
}

impl Foreground {
    /// Which pixels count as moving, yes or no: `[frames, 1, S, S]`.
    pub fn moves(&self) -> Tensor {
        self.share.gt(MOVES).unsqueeze(1)
    }
}

impl MotionDetector {
    /// Measures what stands behind the objects of these clips.
    pub fn measure(clips: &Clips, seed: u64) -> Self {
        let _guard = tch::no_grad_guard();
        let median = clips.median_frame(FRAMES, seed);
        let places = clips.random_places(COMPARED_FRAMES, seed, 0);
        let frames = clips.frames(&places);
        let difference = &frames - &median;
        let noisy = changing_pixels(&difference);
        let speckled = are_speckled(&difference, noisy.as_ref());
        let level = |background: &Tensor| {
            let size = sizes(&smoothed(&(&frames - background), speckled));
            noise_level(&size, noisy.as_ref()).mean(Kind::Double).double_value(&[])
        };
        let (still, of_clip) = (level(&median), level(&clips.clip_medians(&places)));
        let own = still > WORTH_EXPLAINING && of_clip < BETTER * still;
        let background =
            if own { BackgroundEstimate::OfEachClip } else { BackgroundEstimate::Still(median.shallow_clone()) };
        MotionDetector { background, speckled, noisy, median }
    }

    /// What moves in these frames of the clips, by their place in the sequence of all frames; `frames` are their pixels
    /// `[frames, channels, S, S]`.
    pub fn of(&self, clips: &Clips, places: &[i64], frames: &Tensor) -> Foreground {
        let _guard = tch::no_grad_guard();
        let sharp = match &self.background {
            BackgroundEstimate::Still(median) => frames - median,
            BackgroundEstimate::OfEachClip => frames - clips.clip_medians(places),
        };
        let difference = smoothed(&sharp, self.speckled);
        let size = sizes(&difference);
        let noise = noise_level(&size, self.noisy.as_ref()).unsqueeze(-1).unsqueeze(-1);
        let excess = (size - noise * LEVELS).clamp_min(0.0);
        let share = 1.0 - (&excess / -SATURATION).exp();
        Foreground { sharp, difference, excess, share }
    }
}

/// Averaged over 3x3 pixels noise falls to a third, an object stays. Single pixels that are far off leave nothing in the
/// median, and the small corners of objects neither.
fn smoothed(difference: &Tensor, speckled: bool) -> Tensor {
    if speckled { neighbours_median(difference) } else { neighbours_mean(difference) }
}

/// The mean of the 3x3 pixels about each, of those that are in the frame, `[frames, channels, S, S]`.
fn neighbours_mean(x: &Tensor) -> Tensor {
    // By rows and by columns: libtorch's pooling of windows that overlap takes ten times as long.
    let along = |x: Tensor, axis: i64, padding: [i64; 4]| {
        let (length, padded) = (x.size()[axis as usize], x.constant_pad_nd(padding));
        padded.narrow(axis, 0, length) + padded.narrow(axis, 1, length) + padded.narrow(axis, 2, length)
    };
    let sum = |x: Tensor| along(along(x, 3, [1, 1, 0, 0]), 2, [0, 0, 1, 1]);
    let one = x.slice(0, 0, 1, 1).slice(1, 0, 1, 1).ones_like();
    sum(x.contiguous()) / sum(one)
}

/// The median of the 3x3 pixels about each, `[frames, channels, S, S]`.
fn neighbours_median(x: &Tensor) -> Tensor {
    let size = x.size();
    let columns = x.contiguous().im2col([3, 3], [1, 1], [1, 1], [1, 1]);
    columns.reshape([size[0], size[1], 9, size[2] * size[3]]).median_dim(2, false).0.reshape(&size)
}

/// Whether single pixels differ for no reason.
fn are_speckled(difference: &Tensor, noisy: Option<&Tensor>) -> bool {
    let size = sizes(difference);
    let noise = noise_level(&size, noisy).unsqueeze(-1).unsqueeze(-1);
    let differs = size.gt_tensor(&(noise * SPECKLE_LEVELS).clamp_min(SPECKLE));
    let alone = sizes(&neighbours_median(difference)).lt(AROUND_SPECKLE).logical_and(&differs);
    let share = |x: &Tensor| x.to_kind(Kind::Double).mean(Kind::Double).double_value(&[]);
    share(&alone) > SPECKLED * share(&differs) && share(&alone) > SPECKLED_PIXELS
}

/// Places of the pixels that differ from the median in any of these frames, `[count]`; none where they are most of all.
fn changing_pixels(difference: &Tensor) -> Option<Tensor> {
    let changes = sizes(difference).amax([0i64].as_slice(), false).flatten(0, -1).gt(0.0);
    let still = 1.0 - changes.to_kind(Kind::Double).mean(Kind::Double).double_value(&[]);
    (still > STILL_SHARE && still < 1.0).then(|| changes.nonzero().squeeze_dim(1))
}

fn sizes(differences: &Tensor) -> Tensor {
    differences.abs().sum_dim_intlist([1i64].as_slice(), false, None)
}

/// The median over each frame's pixels, or over those at the places given, `[frames]`.
fn noise_level(sizes: &Tensor, noisy: Option<&Tensor>) -> Tensor {
    let sizes = sizes.flatten(1, 2);
    let Some(places) = noisy else { return sizes.median_dim(1, false).0 };
    let level = sizes.index_select(1, places).median_dim(1, false).0;
    let quiet = level.le(QUIET);
    level * quiet
}

#[cfg(test)]
mod tests {
    use tch::{Device, Kind, Tensor};

    use super::neighbours_mean;

    /// At the edges fewer pixels are averaged, as libtorch's pooling does it.
    #[test]
    fn neighbours_are_averaged_within_the_frame() {
        let x = (Tensor::arange(2 * 3 * 7 * 7, (Kind::Float, Device::Cpu)) * 0.7).sin().reshape([2, 3, 7, 7]);
        let pooled = x.avg_pool2d(3, 1, 1, false, false, None);
        // Nine numbers of size 1, summed in float32 in another order.
        assert!((neighbours_mean(&x) - pooled).abs().max().double_value(&[]) < 1e-6);
        let channels_last = x.permute([0, 2, 3, 1]).contiguous().permute([0, 3, 1, 2]);
        assert_eq!(neighbours_mean(&channels_last), neighbours_mean(&x));
    }
}
