//! Clips of one video: the first three quarters of its frames are trained on, the last quarter is held out, its first half
//! for validation and its second for the test. No clip reaches from one part into another.

use std::ops::Range;

use anyhow::{Result, ensure};

/// Frames of a clip beyond those that are trained on, where there is room for them: as in the paper's data.
const FRAMES_BEYOND: usize = 2;
/// Frames of a video, by their place among those that are kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parts {
    pub train: Range<usize>,
    pub valid: Range<usize>,
    pub test: Range<usize>,
}

impl Parts {
    pub fn of(frames: usize) -> Self {
        let held_out = frames * 3 / 4;
        let test = held_out + (frames - held_out) / 2;
        Parts { train: 0..held_out, valid: held_out..test, test: test..frames }
    }
}

/// Lengths of clips, and how they overlap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cut {
    /// Frames of a training or validation clip, and of a test clip.
    pub train_frames: usize,
    pub test_frames: usize,
    /// Frames from the beginning of one training clip to that of the next.
    pub train_stride: usize,
    pub held_out_stride: usize,
}

impl Cut {
    /// Lengths for videos with so many kept frames: at least `least` each, what the encoder sees and what is predicted.
    /// Without a given overlap every frame begins a training clip, or every so many-th if there would be more than `most`
    /// clips.
    ///
    /// # Errors
    /// Too few frames for one clip in each part, a given length below `least`, an overlap of a whole clip.
    pub fn choose(
        videos: &[usize],
        least: usize,
        clip: Option<usize>,
        overlap: Option<usize>,
        most: usize,
    ) -> Result<Self> {
        let parts: Vec<_> = videos.iter().map(|&frames| Parts::of(frames)).collect();
        if let Some(clip) = clip {
            ensure!(
                clip >= least,
                "--clip-frames {clip}: must be at least input and predicted frames together, {least}"
            );
        }
        // The shortest video that can hold a clip in each part decides, so that all of those are tested.
        let needed = clip.unwrap_or(least);
        let lengths =
            parts.iter().map(|it| (it.valid.len(), it.test.len())).filter(|(valid, test)| needed <= *valid.min(test));
        let (valid, test) = lengths.reduce(|a, b| (a.0.min(b.0), a.1.min(b.1))).unwrap_or_default();
        let train_frames = clip.unwrap_or_else(|| (least + FRAMES_BEYOND).min(valid).min(test).max(least));
        ensure!(
            valid.min(test) >= train_frames,
            "{} frames are too few for clips of {train_frames}: the last quarter is held out, half of it for validation and \
             half for the test, so some {} are needed. Use a longer part, a smaller --step, fewer --input-steps and \
             --pred-steps, or another video",
            videos.iter().max().unwrap_or(&0),
            8 * train_frames
        );
        let overlap_of_training = overlap.unwrap_or(train_frames - 1);
        ensure!(
            overlap_of_training < train_frames,
            "--overlap {overlap_of_training}: must be less than the {train_frames} frames of a clip"
        );
        let starts: usize = parts.iter().map(|it| (it.train.len() + 1).saturating_sub(train_frames)).sum();
        let train_stride = match overlap {
            Some(overlap) => train_frames - overlap,
            None => starts.div_ceil(most.max(1)).max(1),
        };
        // Longer clips show how far a prediction holds, but there should be more than one.
        let test_frames = (2 * test / 3).clamp(train_frames, 2 * train_frames);
        Ok(Cut { train_frames, test_frames, train_stride, held_out_stride: train_stride.max(train_frames / 4) })
    }
}

/// Where clips of `length` frames begin within a part.
pub fn starts(part: &Range<usize>, length: usize, stride: usize) -> Vec<usize> {
    let Some(last) = part.end.checked_sub(length) else { return Vec::new() };
    (part.start..=last).step_by(stride).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_follow_each_other() {
        for frames in 0..200 {
            let Parts { train, valid, test } = Parts::of(frames);
            assert_eq!((train.start, train.end, valid.end, test.end), (0, valid.start, test.start, frames));
            assert_eq!(train.end, 3 * frames / 4);
        }
    }

    #[test]
    fn clips_fit_into_their_parts() {
        let cut = Cut::choose(&[160], 10, None, None, 2000).unwrap();
        assert_eq!(cut, Cut { train_frames: 12, test_frames: 13, train_stride: 1, held_out_stride: 3 });
        assert_eq!(Cut::choose(&[84], 10, None, None, 2000).unwrap().train_frames, 10);
        // One that is too short for clips of its own decides nothing.
        let of_three = Cut::choose(&[160, 120, 30], 10, None, None, 2000).unwrap();
        assert_eq!((of_three.train_frames, of_three.test_frames), (12, 12));
        assert!(Cut::choose(&[76], 10, None, None, 2000).is_err());
        assert!(Cut::choose(&[160], 10, Some(9), None, 2000).is_err());
        assert!(Cut::choose(&[160], 10, None, Some(12), 2000).is_err());
        assert_eq!(Cut::choose(&[160], 10, None, Some(0), 2000).unwrap().train_stride, 12);
        let of_many = Cut::choose(&[12_000], 10, None, None, 2000).unwrap();
        assert_eq!((of_many.test_frames, of_many.train_stride), (24, 5));
        assert_eq!(starts(&(120..140), 12, 6), [120, 126]);
        assert!(starts(&(120..130), 12, 6).is_empty());
    }
}
