//! Results of tracking.

use serde::{Deserialize, Serialize};

use crate::background::StaticScene;
use crate::camera::CameraPath;
use crate::quality::Quality;
use crate::time_base::TimeBase;

/// Whether an object is seen in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Visibility {
    /// Seen as a whole.
    Visible,
    /// Partly beyond the frame's border or in an ignored region.
    CutOff,
    /// Between two frames with a position, but hidden, merged with something else or too faint.
    Occluded,
    /// Before the first or after the last position.
    Absent,
}

/// Origin of a position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Registration of the object's template.
    Template,
    /// Centroid of the moving region, moved by the mean offset between centroid and template.
    Centroid,
}

/// Position of an object in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TrackPoint {
    /// `[x, y]`, pixels; pixel centres have integer coordinates, y points down.
    pub position: [f64; 2],
    /// Covariance `[[xx, xy], [xy, yy]]`, pixels^2.
    pub covariance: [[f64; 2]; 2],
    pub method: Method,
}

/// Object in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Frame of the video.
    pub frame: usize,
    pub visibility: Visibility,
    /// Position where the object is visible or cut off.
    pub measurement: Option<TrackPoint>,
    /// Centroid of the moving region `[x, y]`, pixels: the start of the registration.
    pub centroid: Option<[f64; 2]>,
    /// Residual energy over the template's energy; absent where no registration converged.
    pub misfit: Option<f64>,
    /// Contrast relative to the template; 1 where the object looks as usual.
    pub contrast: Option<f64>,
    /// Diameter of a disc of the moving region's area, pixels.
    pub diameter: Option<f64>,
}

/// Kind of a mover.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    Object,
    /// Looks like a shadow and moves with an object.
    Shadow,
    /// Reaches in from the border for part of the video: a hand or an arm.
    Visitor,
}

/// Track of one mover.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Track {
    pub role: Role,
    /// One point for each tracked frame.
    pub points: Vec<Point>,
    pub quality: Quality,
    /// Median diameter of the moving region, pixels.
    pub diameter: f64,
    /// Side of the cells on which the template is registered, pixels.
    pub bin: usize,
}

/// Result of tracking a video.
#[derive(Debug, Clone)]
pub struct Tracking {
    /// Movers by descending rank; objects come before shadows and visitors.
    pub tracks: Vec<Track>,
    pub background: StaticScene,
    /// Motion of the camera. Positions are given in the frame of the background.
    pub camera: CameraPath,
    /// When the frames were filmed.
    pub time: TimeBase,
    /// Median share of a frame's pixels that differ from the background.
    pub moving_share: f64,
    /// Median change of brightness from the background, levels.
    pub flicker: f64,
}
