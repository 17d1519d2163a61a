//! Decoded frames: the source of a video and its parallel passes.

use ndarray::{Array4, ArrayView4};
use rayon::prelude::*;

use crate::error::TrackError;
use crate::time_base::StatedTime;

/// Frames held at once by a parallel pass.
const BATCH: usize = 16;

/// Width and height of a frame in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Size {
    pub width: usize,
    pub height: usize,
}

impl Size {
    /// Number of pixels.
    pub fn pixels(self) -> usize {
        self.width * self.height
    }
}

/// Calls that receive a frame's index and its bytes, `[height, width, 3]` row by row, RGB.
pub type Visitor<'a> = dyn FnMut(usize, &[u8]) -> Result<(), TrackError> + 'a;

/// Source of decoded frames. A pass visits frames in order; tracking makes three to five passes and never holds the
/// whole video.
pub trait FrameSource: Sync {
    /// Size of every frame.
    fn size(&self) -> Size;

    /// Number of frames.
    fn frames(&self) -> usize;

    /// What the source states about time.
    fn clock(&self) -> StatedTime {
        StatedTime::default()
    }

    /// Visits the frames for which `wanted` holds, in ascending order.
    ///
    /// # Errors
    /// [`TrackError::Source`] where decoding fails; the visitor's errors are passed on.
    fn visit(&self, wanted: &dyn Fn(usize) -> bool, visitor: &mut Visitor<'_>) -> Result<(), TrackError>;
}

/// From the middle of a pixel, where positions count from, to its corner, where users measure a video from.
pub const HALF_PIXEL: f64 = 0.5;

/// Frames in memory, `[frames, height, width, 3]`, RGB.
#[derive(Debug, Clone)]
pub struct Clip {
    frames: Array4<u8>,
}

impl Clip {
    /// Wraps frames, `[frames, height, width, 3]`.
    ///
    /// # Errors
    /// [`TrackError::Source`] where the last axis is not RGB.
    pub fn new(frames: Array4<u8>) -> Result<Self, TrackError> {
        if frames.shape()[3] != 3 {
            return Err(TrackError::Source(format!("expected 3 channels, found {}", frames.shape()[3])));
        }
        let frames = if frames.is_standard_layout() { frames } else { frames.as_standard_layout().into_owned() };
        Ok(Self { frames })
    }

    /// The frames, `[frames, height, width, 3]`.
    pub fn view(&self) -> ArrayView4<'_, u8> {
        self.frames.view()
    }
}

impl FrameSource for Clip {
    fn size(&self) -> Size {
        Size { width: self.frames.shape()[2], height: self.frames.shape()[1] }
    }

    fn frames(&self) -> usize {
        self.frames.shape()[0]
    }

    fn visit(&self, wanted: &dyn Fn(usize) -> bool, visitor: &mut Visitor<'_>) -> Result<(), TrackError> {
        for (index, frame) in self.frames.outer_iter().enumerate() {
            if wanted(index) {
                let bytes = frame.to_slice().ok_or_else(|| TrackError::Source("frames are not contiguous".into()))?;
                visitor(index, bytes)?;
            }
        }
        Ok(())
    }
}

/// Applies `work` to the wanted frames in parallel and returns the results with their frame indices, in order.
///
/// # Errors
/// Errors of the source; [`TrackError::FrameSize`] for a frame of another size.
pub(crate) fn map_frames<T: Send>(
    video: &dyn FrameSource,
    wanted: &dyn Fn(usize) -> bool,
    work: impl Fn(usize, &[u8]) -> T + Sync,
) -> Result<Vec<(usize, T)>, TrackError> {
    let expected = video.size().pixels() * 3;
    let mut results = Vec::new();
    let mut batch: Vec<(usize, Vec<u8>)> = Vec::with_capacity(BATCH);
    let flush = |batch: &mut Vec<(usize, Vec<u8>)>, results: &mut Vec<(usize, T)>| {
        results.par_extend(batch.par_drain(..).map(|(index, bytes)| (index, work(index, &bytes))));
    };
    video.visit(wanted, &mut |frame, bytes| {
        if bytes.len() != expected {
            return Err(TrackError::FrameSize { frame, expected, found: bytes.len() });
        }
        batch.push((frame, bytes.to_vec()));
        if batch.len() == BATCH {
            flush(&mut batch, &mut results);
        }
        Ok(())
    })?;
    flush(&mut batch, &mut results);
    Ok(results)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pass_keeps_the_order_and_only_the_wanted_frames() {
        let clip = Clip::new(Array4::from_shape_fn((40, 2, 3, 3), |(frame, ..)| frame as u8)).unwrap();
        let found = map_frames(&clip, &|frame| frame % 2 == 1, |_, bytes| bytes[17]).unwrap();
        assert_eq!(found.len(), 20);
        assert!(found.iter().all(|&(frame, value)| frame % 2 == 1 && value as usize == frame));
        assert!(found.is_sorted_by_key(|&(frame, _)| frame));
    }

    #[test]
    fn frames_without_three_channels_are_rejected() {
        assert!(matches!(Clip::new(Array4::zeros((2, 4, 4, 1))), Err(TrackError::Source(_))));
    }
}
