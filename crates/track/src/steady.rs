//! A video of a moving camera as a standing one would film it.

use crate::camera::CameraPath;
use crate::error::TrackError;
use crate::mosaic::Mosaic;
use crate::time_base::StatedTime;
use crate::video::{FrameSource, Size, Visitor};

/// Frames resampled into the frame of the background. Where a frame does not reach, the background shows.
pub(crate) struct Steady<'a> {
    pub(crate) video: &'a dyn FrameSource,
    pub(crate) camera: &'a CameraPath,
    pub(crate) mosaic: &'a Mosaic,
}

impl Steady<'_> {
    /// A frame in the frame of the background, `[height, width, 3]`.
    pub(crate) fn frame(&self, frame: usize, bytes: &[u8]) -> Vec<u8> {
        let Some(pose) = self.camera.pose(frame) else { return bytes.to_vec() };
        self.mosaic.completed(bytes, self.video.size(), &pose.inverse())
    }
}

impl FrameSource for Steady<'_> {
    fn size(&self) -> Size {
        self.mosaic.size
    }

    fn frames(&self) -> usize {
        self.video.frames()
    }

    fn clock(&self) -> StatedTime {
        self.video.clock()
    }

    fn visit(&self, wanted: &dyn Fn(usize) -> bool, visitor: &mut Visitor<'_>) -> Result<(), TrackError> {
        self.video.visit(wanted, &mut |frame, bytes| {
            let expected = self.video.size().pixels() * 3;
            if bytes.len() != expected {
                return Err(TrackError::FrameSize { frame, expected, found: bytes.len() });
            }
            visitor(frame, &self.frame(frame, bytes))
        })
    }
}
