//! Errors of tracking.

use thiserror::Error;

use crate::options::Hint;

/// Reasons why a video yields no track.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum TrackError {
    /// The background needs several frames of one scene.
    #[error("expected at least {least} frames, found {found}")]
    TooFewFrames { least: usize, found: usize },
    /// The blur and the windows need some room.
    #[error("expected frames of at least {least}x{least} pixels, found {width}x{height}")]
    FrameTooSmall { least: usize, width: usize, height: usize },
    /// A decoded frame does not hold `height * width * 3` bytes.
    #[error("frame {frame}: expected {expected} bytes, found {found}")]
    FrameSize { frame: usize, expected: usize, found: usize },
    /// The source delivered fewer frames than it announced.
    #[error("expected frame {frame}, found the end of the video")]
    MissingFrame { frame: usize },
    /// The range of frames in the options lies outside the video.
    #[error("frames {first}..{end} lie outside the video of {frames} frames")]
    Range { first: usize, end: usize, frames: usize },
    /// The camera moves, and the frames cannot be registered on one background.
    #[error("the camera moves: {reason} (look at frame {frame})")]
    Camera { frame: usize, reason: String },
    /// No pixel differs from the background by more than the noise.
    #[error("nothing moves: the largest difference from the background is {peak:.1} times the noise")]
    NothingMoves { peak: f32 },
    /// Blobs exist, but no two of them join into a path.
    #[error("nothing can be followed: no path joins two of the {blobs} moving regions")]
    NoPath { blobs: usize },
    /// A hint is on no moving region. Positions are pixels of the video; pixel centres are integers.
    #[error("nothing moves at {:.0},{:.0} in frame {}{}", hint.position[0], hint.position[1], hint.frame, nearest_words(*nearest))]
    HintOnNothing {
        hint: Hint,
        /// Middle of the nearest moving region of the frame; none where nothing moves in it.
        nearest: Option<[f64; 2]>,
    },
    /// The source failed to decode.
    #[error("reading the video failed: {0}")]
    Source(String),
}

fn nearest_words(nearest: Option<[f64; 2]>) -> String {
    nearest.map_or_else(String::new, |[x, y]| format!("; the nearest moving region is at {x:.0},{y:.0}"))
}
