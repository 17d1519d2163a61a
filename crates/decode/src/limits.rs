//! Bounds on what a header may claim, checked before anything is allocated for it.

use crate::error::{DecodeError, Result};

/// Largest side of a frame, pixels.
pub const LARGEST_SIDE: u32 = 8192;
/// Most pixels of a frame: 8192 x 4352, the largest picture of HEVC's level 6.2. A decoder holds up to 17 of them.
pub const MOST_PIXELS: u64 = 8192 * 4352;
/// Most frames of a video: 9 hours at 60 frames a second.
pub const MOST_FRAMES: usize = 2_000_000;
/// Most bytes of one coded frame.
pub const LARGEST_PACKET: u64 = 1 << 28;
/// Most bytes of the boxes that describe an mp4; an hour has some megabytes.
pub(crate) const LARGEST_DESCRIPTION: u64 = 1 << 28;
/// Most bytes of decoded frames ahead of the consumer.
pub(crate) const AHEAD_BYTES: usize = 1 << 26;

/// Refuses frames without pixels and beyond the limits.
pub(crate) fn check_size(width: u32, height: u32) -> Result<()> {
    if width == 0 || height == 0 {
        return Err(DecodeError::corrupt(format!("its frames have {width} x {height} pixels")));
    }
    let pixels = u64::from(width) * u64::from(height);
    if width > LARGEST_SIDE || height > LARGEST_SIDE || pixels > MOST_PIXELS {
        return Err(DecodeError::too_large(format!(
            "its frames have {width} x {height} pixels; at most {LARGEST_SIDE} a side and {MOST_PIXELS} in all are read"
        )));
    }
    Ok(())
}

/// Refuses more frames than the limit.
pub(crate) fn check_frames(frames: usize) -> Result<()> {
    if frames > MOST_FRAMES {
        return Err(DecodeError::too_large(format!("it has {frames} frames; at most {MOST_FRAMES} are read")));
    }
    Ok(())
}
