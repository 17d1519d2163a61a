//! What moves: where a frame differs from what stands behind it, by more than its noise.

use tch::{Kind, Tensor};

use crate::datasets::iterators::Clips;

/// Frames from which what stands behind is measured.
const FRAMES: usize = 2000;
const COMPARED_FRAMES: usize = 200;
/// A frame's level of noise is the median difference of its pixels; what moves differs by more than this many of them.
const LEVELS: f64 = 3.0;
/// The still background is left for each clip's own where that explains the frames this much better, and there is
/// something to explain: a summed difference of so much.
const BETTER: f64 = 0.6;
const WORTH_EXPLAINING: f64 = 0.03;
/// Difference beyond the noise, summed over channels, at which a pixel counts as moving to 63 %.
const SATURATION: f64 = 0.1;

/// What stands behind the objects.
#[derive(Debug)]
enum Background {
    /// The same in all clips: the median over the dataset, `[channels, S, S]`.
    Still(Tensor),
    /// Another one in each clip: the median over its frames.
    OfEachClip,
}

/// Tells what moves in the frames of one dataset.
#[derive(Debug)]
pub struct Motion {
    background: Background,
    /// The median over the dataset, `[channels, S, S]`.
    pub median: Tensor,
}

/// What moves in some frames.
#[derive(Debug)]
pub struct Moving {
    /// Frames minus what stands behind them, `[frames, channels, S, S]`, and the same averaged over 3x3 pixels.
    pub sharp: Tensor,
    pub difference: Tensor,
    /// Its size summed over channels, beyond the noise, at least 0: `[frames, S, S]`.
    pub excess: Tensor,
    /// Whether a pixel moves, in \[0, 1): `[frames, S, S]`.
    pub share: Tensor,
}

impl Motion {
    /// Measures what stands behind the objects of these clips.
    pub fn measure(clips: &Clips, seed: u64) -> Self {
        let _guard = tch::no_grad_guard();
        let median = clips.median_frame(FRAMES, seed);
        let places = clips.random_places(COMPARED_FRAMES, seed, 0);
        let frames = clips.frames(&places);
        let level = |background: &Tensor| {
            noise_level(&sizes(&smoothed(&(&frames - background)))).mean(Kind::Double).double_value(&[])
        };
        let (still, of_clip) = (level(&median), level(&clips.clip_medians(&places)));
        let own = still > WORTH_EXPLAINING && of_clip < BETTER * still;
        let background = if own { Background::OfEachClip } else { Background::Still(median.shallow_clone()) };
        Motion { background, median }
    }

    /// What moves in these frames of the clips, by their place in the sequence of all frames; `frames` are their pixels
    /// `[frames, channels, S, S]`.
    pub fn of(&self, clips: &Clips, places: &[i64], frames: &Tensor) -> Moving {
        let _guard = tch::no_grad_guard();
        let sharp = match &self.background {
            Background::Still(median) => frames - median,
            Background::OfEachClip => frames - clips.clip_medians(places),
        };
        let difference = smoothed(&sharp);
        let size = sizes(&difference);
        let noise = noise_level(&size).unsqueeze(-1).unsqueeze(-1);
        let excess = (size - noise * LEVELS).clamp_min(0.0);
        let share = 1.0 - (&excess / -SATURATION).exp();
        Moving { sharp, difference, excess, share }
    }
}

/// Averaged over 3x3 pixels noise falls to a third, an object stays.
fn smoothed(difference: &Tensor) -> Tensor {
    difference.avg_pool2d(3, 1, 1, false, false, None)
}

fn sizes(differences: &Tensor) -> Tensor {
    differences.abs().sum_dim_intlist([1i64].as_slice(), false, None)
}

/// The median over each frame's pixels, `[frames]`.
fn noise_level(sizes: &Tensor) -> Tensor {
    sizes.flatten(1, 2).median_dim(1, false).0
}
