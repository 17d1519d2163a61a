//! Random numbers of a clip: a generator of its own for each thing that is drawn by chance, so that the same motion is
//! seen under every look, and one effect more or less changes nothing about the others.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::datasets::files::Split;

/// What a clip's random numbers are for.
#[derive(Debug, Clone, Copy)]
pub enum Purpose {
    Motion,
    /// Which background, or from which time on.
    Background,
    Distractors,
    Flicker,
    Gradient,
    Shake,
    Noise,
    SaltAndPepper,
    /// By how much a forecast is wrong.
    Forecast,
}

/// Stands beside the purposes: what all clips of a dataset have in common.
const DATASET: u64 = 15;

/// The random numbers of one clip.
#[derive(Debug, Clone, Copy)]
pub struct Streams {
    pub seed: u64,
    pub split: Split,
    /// Number of the clip in its split.
    pub index: usize,
    /// Which of several films of the same motion: 0 in a dataset.
    pub take: usize,
}

impl Streams {
    /// A stream of the seed's generator for each (purpose, split, take, index); the motion is the same in all takes.
    pub fn of(&self, purpose: Purpose) -> ChaCha8Rng {
        let take = if matches!(purpose, Purpose::Motion) { 0 } else { self.take };
        let number = (purpose as u64) << 60 | (self.split as u64) << 56 | (take as u64) << 48 | self.index as u64;
        stream(self.seed, number)
    }
}

/// The random numbers of what all clips of a dataset have in common.
pub(crate) fn of_dataset(seed: u64) -> ChaCha8Rng {
    stream(seed, DATASET << 60)
}

fn stream(seed: u64, number: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(number);
    rng
}
