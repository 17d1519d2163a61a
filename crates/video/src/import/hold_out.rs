//! What is trained on and what is held out. A take is a part of a video that shows one motion from its beginning to its
//! end. Of each take the first three quarters of the frames are trained on, the last quarter is held out, its first half for
//! validation and its second for the test. Takes that are too short for that are held out whole, the last quarter of those
//! that hold a clip.
//! No clip reaches from one part into another.

use std::ops::Range;

use anyhow::{Result, ensure};

/// Frames of a clip beyond those that are trained on, where there is room for them: as in the paper's data.
const FRAMES_BEYOND: usize = 2;
/// Takes from which on some can be held out whole: two to learn from, one for validation, one for the test.
const LEAST_TAKES: usize = 4;

/// Frames of a take, by their place among those that are kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HoldOut {
    pub train: Range<usize>,
    pub valid: Range<usize>,
    pub test: Range<usize>,
}

impl HoldOut {
    pub fn of(frames: usize) -> Self {
        let held_out = frames * 3 / 4;
        let test = held_out + (frames - held_out) / 2;
        HoldOut { train: 0..held_out, valid: held_out..test, test: test..frames }
    }

    /// The parts of takes with so many frames, of which `needed` make a clip.
    pub fn of_all(takes: &[usize], needed: usize) -> Vec<Self> {
        let each: Vec<_> = takes.iter().map(|&frames| HoldOut::of(frames)).collect();
        if takes.len() < LEAST_TAKES || each.iter().any(|parts| parts.valid.len() >= needed) {
            return each;
        }
        // One that holds no clip would leave validation or test empty.
        let long: Vec<usize> = (0..takes.len()).filter(|take| takes[*take] >= needed).collect();
        let held_out = (long.len() / 4).max(2).min(long.len());
        let (valid, test) = (long.len() - held_out, long.len() - held_out.div_ceil(2));
        let whole = |(take, &frames): (usize, &usize)| match long.iter().position(|it| *it == take) {
            Some(place) if place >= test => HoldOut { train: 0..0, valid: 0..0, test: 0..frames },
            Some(place) if place >= valid => HoldOut { train: 0..0, valid: 0..frames, test: frames..frames },
            _ => HoldOut { train: 0..frames, valid: frames..frames, test: frames..frames },
        };
        takes.iter().enumerate().map(whole).collect()
    }

    /// The same with each border moved past frames that are one and the same: a regular clock may show a frame twice.
    /// `numbers` are those that the take's frames have in their video.
    pub fn apart(&self, numbers: &[usize]) -> Self {
        let past = |border: usize| {
            let begins = |place: &usize| *place == 0 || numbers[*place] != numbers[place - 1];
            (border..numbers.len()).find(begins).unwrap_or(numbers.len())
        };
        let (valid, test) = (past(self.train.end), past(self.valid.end));
        HoldOut { train: 0..valid, valid: valid..test, test: test..self.frames() }
    }

    /// Frames of the take.
    pub fn frames(&self) -> usize {
        self.test.end
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
    /// Lengths for takes with these parts: at least `least` each, what the encoder sees and what is predicted.
    /// Without a given overlap every frame begins a training clip, or every so many-th if there would be more than `most`
    /// clips.
    ///
    /// # Errors
    /// Too few frames for one clip in each part, a given length below `least`, an overlap of a whole clip.
    pub fn choose(
        parts: &[HoldOut],
        least: usize,
        clip: Option<usize>,
        overlap: Option<usize>,
        most: usize,
    ) -> Result<Self> {
        if let Some(clip) = clip {
            ensure!(
                clip >= least,
                "--clip-frames {clip}: must be at least input and predicted frames together, {least}"
            );
        }
        // The shortest part that can hold a clip decides, so that all of those are trained on and tested.
        let needed = clip.unwrap_or(least);
        let shortest = |part: fn(&HoldOut) -> &Range<usize>| {
            parts.iter().map(|it| part(it).len()).filter(|frames| *frames >= needed).min().unwrap_or(0)
        };
        let (train, valid, test) = (shortest(|it| &it.train), shortest(|it| &it.valid), shortest(|it| &it.test));
        let train_frames =
            clip.unwrap_or_else(|| least.saturating_add(FRAMES_BEYOND).min(train).min(valid).min(test).max(least));
        ensure!(
            valid.min(test) >= train_frames,
            "{} frames are too few for clips of {train_frames}: the last quarter is held out, half of it for validation and \
             half for the test, so some {} are needed, or {LEAST_TAKES} throws and more (--frames 30..62,120..155,..). Use a \
             longer part, a smaller --step, fewer --input-steps and --pred-steps, or another video",
            parts.iter().map(HoldOut::frames).max().unwrap_or(0),
            train_frames.saturating_mul(8)
        );
        ensure!(
            train >= train_frames,
            "no part to train on has the {train_frames} frames of a clip; the longest has {}. Use longer parts (--frames), a \
             smaller --step or fewer --input-steps and --pred-steps",
            parts.iter().map(|it| it.train.len()).max().unwrap_or(0)
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
            let HoldOut { train, valid, test } = HoldOut::of(frames);
            assert_eq!((train.start, train.end, valid.end, test.end), (0, valid.start, test.start, frames));
            assert_eq!(train.end, 3 * frames / 4);
        }
    }

    #[test]
    fn short_takes_are_held_out_whole() {
        // Ten throws of 24 frames: eight to learn from, one for validation, one for the test.
        let parts = HoldOut::of_all(&[24; 10], 10);
        let held_out = |part: fn(&HoldOut) -> &Range<usize>| parts.iter().map(|it| part(it).len()).collect::<Vec<_>>();
        assert_eq!(held_out(|it| &it.train), [24, 24, 24, 24, 24, 24, 24, 24, 0, 0]);
        assert_eq!(held_out(|it| &it.valid), [0, 0, 0, 0, 0, 0, 0, 0, 24, 0]);
        assert_eq!(held_out(|it| &it.test), [0, 0, 0, 0, 0, 0, 0, 0, 0, 24]);
        let cut = Cut::choose(&parts, 10, None, None, 2000).unwrap();
        assert_eq!((cut.train_frames, cut.test_frames), (12, 16));
        // The shortest throw decides, also among those that are trained on; none of these may be too short.
        let of_throws = |frames: [usize; 4]| Cut::choose(&HoldOut::of_all(&frames, 10), 10, None, None, 2000);
        assert_eq!(of_throws([11, 11, 12, 12]).unwrap().train_frames, 11);
        let refused = of_throws([9, 9, 12, 12]).unwrap_err().to_string();
        assert!(refused.contains("no part to train on has the 10 frames of a clip; the longest has 9"), "{refused}");
        // One without a clip is not held out; it teaches nothing, either.
        let parts = HoldOut::of_all(&[12, 12, 12, 12, 9], 10);
        let lengths = parts.iter().map(|it| [it.train.len(), it.valid.len(), it.test.len()]).collect::<Vec<_>>();
        assert_eq!(lengths, [[12, 0, 0], [12, 0, 0], [0, 12, 0], [0, 0, 12], [9, 0, 0]]);
        // Three are too few; of one that is long enough a quarter is held out, as of the others.
        assert!(Cut::choose(&HoldOut::of_all(&[24; 3], 10), 10, None, None, 2000).is_err());
        assert_eq!(HoldOut::of_all(&[24, 24, 24, 100], 10)[0], HoldOut::of(24));
    }

    #[test]
    fn a_frame_that_is_shown_twice_is_in_one_part() {
        // Frame 5 would end the training frames and begin the validation's.
        let numbers = [0, 1, 2, 3, 4, 5, 5, 6, 7, 7];
        let parts = HoldOut { train: 0..6, valid: 6..9, test: 9..10 };
        assert_eq!(parts.apart(&numbers), HoldOut { train: 0..7, valid: 7..10, test: 10..10 });
        let whole = HoldOut { train: 0..0, valid: 0..10, test: 10..10 };
        assert_eq!(whole.apart(&numbers), whole);
        assert_eq!(HoldOut::of(8).apart(&[0, 1, 2, 3, 4, 5, 6, 7]), HoldOut::of(8));
    }

    #[test]
    fn clips_fit_into_their_parts() {
        let choose = |takes: &[usize], clip: Option<usize>, overlap| {
            let parts = HoldOut::of_all(takes, clip.unwrap_or(10));
            Cut::choose(&parts, 10, clip, overlap, 2000)
        };
        let cut = choose(&[160], None, None).unwrap();
        assert_eq!(cut, Cut { train_frames: 12, test_frames: 13, train_stride: 1, held_out_stride: 3 });
        assert_eq!(choose(&[84], None, None).unwrap().train_frames, 10);
        // One that is too short for clips of its own decides nothing.
        let of_three = choose(&[160, 120, 30], None, None).unwrap();
        assert_eq!((of_three.train_frames, of_three.test_frames), (12, 12));
        assert!(choose(&[76], None, None).is_err());
        assert!(choose(&[160], Some(9), None).is_err());
        assert!(choose(&[160], None, Some(12)).is_err());
        assert_eq!(choose(&[160], None, Some(0)).unwrap().train_stride, 12);
        let of_many = choose(&[12_000], None, None).unwrap();
        assert_eq!((of_many.test_frames, of_many.train_stride), (24, 5));
        assert_eq!(starts(&(120..140), 12, 6), [120, 126]);
        assert!(starts(&(120..130), 12, 6).is_empty());
    }
}
