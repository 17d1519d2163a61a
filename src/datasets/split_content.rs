//! Whether the clips of a split show anything to learn from.

use std::path::Path;

use anyhow::{Result, ensure};
use ndarray::Array5;

use super::files::Split;

/// What there is to see in the clips of a split.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SplitContent {
    brightest: u8,
    moves: bool,
}

impl SplitContent {
    pub(super) fn by(clips: &Array5<u8>) -> Self {
        let mut shown = SplitContent::default();
        let frame_bytes = clips.dim().2 * clips.dim().3 * clips.dim().4;
        let all = clips.as_slice().expect("row-major");
        all.chunks_exact((clips.dim().1 * frame_bytes).max(1)).for_each(|clip| shown.add(clip, frame_bytes));
        shown
    }

    /// Takes in the bytes of one more clip.
    pub(super) fn add(&mut self, clip: &[u8], frame_bytes: usize) {
        self.brightest = self.brightest.max(clip.iter().max().copied().unwrap_or(0));
        self.moves = self.moves || clip.chunks_exact(frame_bytes).any(|frame| frame != &clip[..frame_bytes]);
    }

    /// # Errors
    /// Frames that are (all but) black, as those saved from 0..1 are, or clips in which nothing ever moves.
    pub(super) fn check(self, split: Split, path: &Path) -> Result<()> {
        let (name, SplitContent { brightest, moves }) = (split.name(), self);
        ensure!(
            brightest > 1,
            "array \"{name}_x\" of {path:?}: no pixel is brighter than {brightest} of 255; multiply frames in 0..1 by 255 \
             before they are saved as uint8"
        );
        ensure!(moves, "array \"{name}_x\" of {path:?}: nothing moves, all frames of a clip are the same");
        Ok(())
    }
}
