//! Settings and hints.

use std::ops::Range;

use serde::{Deserialize, Serialize};

/// Point on the object, given by a person: the path through it is preferred.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Hint {
    /// Frame of the video.
    pub frame: usize,
    /// `[x, y]` in pixels; pixel centres have integer coordinates, y points down.
    pub position: [f64; 2],
}

/// Rectangle in pixels, both corners included.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Region {
    /// Left column and top row.
    pub first: [usize; 2],
    /// Right column and bottom row.
    pub last: [usize; 2],
}

/// Most objects that are told apart.
pub const MOST_OBJECTS: usize = 16;

/// Settings of tracking. The defaults suit videos of 10 to 5000 frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackingOptions {
    /// Frames to track; all where absent.
    pub frames: Option<Range<usize>>,
    /// Most objects to return, at most [`MOST_OBJECTS`].
    pub objects: usize,
    /// Most moving regions kept of a frame, and most paths that are looked for; no fewer than objects.
    pub movers: usize,
    /// Points on the object. Those in frames that are not tracked do not count.
    pub hints: Vec<Hint>,
    /// Regions in which nothing is looked for.
    pub ignore: Vec<Region>,
    /// How many times as slow as it was filmed the video plays; by its tags where absent.
    pub slow_motion: Option<f64>,
    /// Time from the first to the last row of a frame of a rolling shutter, seconds; positions are moved to the time of the
    /// middle row.
    pub readout: Option<f64>,
    /// Standard deviation of the blur of difference images, pixels.
    pub blur: f32,
    /// Threshold of a moving region, as a share of the median peak of the difference images.
    pub threshold: f32,
    /// Least peak of a moving region, in units of the noise.
    pub least_peak: f32,
    /// Memory for the frames from which the background is estimated, bytes.
    pub background_bytes: usize,
    /// Memory for the windows of one object, bytes.
    pub window_bytes: usize,
}

impl TrackingOptions {
    /// Moving regions of a frame and paths that are looked for.
    pub(crate) fn most_movers(&self) -> usize {
        self.movers.max(self.objects.min(MOST_OBJECTS))
    }
}

impl Default for TrackingOptions {
    fn default() -> Self {
        Self {
            frames: None,
            objects: 4,
            movers: 6,
            hints: Vec::new(),
            ignore: Vec::new(),
            slow_motion: None,
            readout: None,
            blur: 1.5,
            threshold: 0.35,
            least_peak: 6.0,
            background_bytes: 128 << 20,
            window_bytes: 512 << 20,
        }
    }
}
