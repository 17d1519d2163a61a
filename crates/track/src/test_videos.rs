//! Rendered scenes as tests read them: as a video of a constant rate, and as reduced images.

use crate::error::TrackError;
use crate::grey::reduced;
use crate::plane::Plane;
use crate::synthetic::SyntheticScene;
use crate::time_base::StatedTime;
use crate::video::{Clip, FrameSource, Size, Visitor};

/// A clip of a constant rate.
pub(crate) struct Filmed {
    clip: Clip,
    /// Frames a second.
    rate: f64,
}

impl Filmed {
    pub(crate) fn new(scene: &SyntheticScene, rate: f64) -> Self {
        Self { clip: Clip::new(scene.render()).unwrap(), rate }
    }
}

impl FrameSource for Filmed {
    fn size(&self) -> Size {
        self.clip.size()
    }

    fn frames(&self) -> usize {
        self.clip.frames()
    }

    fn clock(&self) -> StatedTime {
        StatedTime { times: Some((0..self.frames()).map(|f| f as f64 / self.rate).collect()), ..StatedTime::default() }
    }

    fn visit(&self, wanted: &dyn Fn(usize) -> bool, visitor: &mut Visitor<'_>) -> Result<(), TrackError> {
        self.clip.visit(wanted, visitor)
    }
}

/// All frames in grey, at full size.
pub(crate) fn reduced_images(scene: &SyntheticScene) -> Vec<Plane> {
    let frames = scene.render();
    frames.outer_iter().map(|frame| reduced(frame.to_slice().unwrap(), scene.size, 1)).collect()
}
