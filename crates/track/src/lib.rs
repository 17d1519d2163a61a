//! Tracks moving objects in decoded video at native resolution.
//!
//! [`track()`] returns, for every mover and frame, a position in pixels with its covariance, a visibility flag and measures
//! of quality. It assumes objects that keep their look.
//!
//! 1. Camera: corners of reduced images show whether it stands. Where it does not, every frame is registered on the edges
//!    of a background pieced together from the frames, and resampled into its frame.
//! 2. Background: median and noise of each pixel over sampled frames, after a fit of each frame's exposure; then once more
//!    from the frames in which no mover covers a pixel.
//! 3. Detection: largest difference over the channels in units of the noise, blurred, thresholded and divided into thick
//!    connected parts.
//! 4. Linking: paths of largest reward with a penalty on changes of velocity, cut at jumps and joined by looks; shadows
//!    and hands get a [`Role`] of their own.
//! 5. Appearance: a template with a soft mask, averaged over aligned frames; every frame is registered to it by robust
//!    Gauss-Newton on its pixels against the known background. Where that fails, the region's centroid stands in.
//! 6. Covariance: normal matrix of the registration, inflated for residuals that correlate within blocks, and scaled to
//!    the noise that high differences of the positions show.
//!
//! Coordinates: x points right, y down, and pixel centres are integers. A position is the template's centroid: a fixed
//! point of the object, not necessarily its centre of mass. Covariances do not include that offset, nor errors that
//! change slowly, such as those of changing light; parameters fitted to a track need a block bootstrap.
//!
//! ```
//! use paig_track::{Clip, TrackingOptions, synthetic::{MovingEllipse, SyntheticScene}, track};
//!
//! let positions: Vec<[f64; 2]> = (0..20).map(|i| [40.0 + 8.0 * f64::from(i), 120.0]).collect();
//! let frames = SyntheticScene::of(MovingEllipse::at(positions)).render();
//! let tracking = track(&Clip::new(frames)?, &TrackingOptions::default())?;
//! let ball = &tracking.tracks[0];
//! let step = |i: usize| ball.points[i].measurement.map(|m| m.position[0]);
//! assert!((step(15).unwrap() - step(5).unwrap() - 80.0).abs() < 0.3);
//! # Ok::<(), paig_track::TrackError>(())
//! ```
#![forbid(unsafe_code)]

mod appearance;
mod background;
mod boundary;
pub mod calibration;
mod camera;
mod candidates;
mod components;
mod corners;
mod covered;
mod detection;
mod difference;
mod edges;
mod error;
mod exposure;
mod grey;
mod linking;
mod mask;
mod mosaic;
mod options;
mod pictures;
mod pieces;
mod plane;
mod points;
mod quality;
mod registration;
mod resting;
mod roles;
mod rolling_shutter;
mod segments;
mod shadow;
mod similarity;
mod start;
mod statistics;
mod steady;
mod still;
mod survey;
pub mod synthetic;
mod template;
#[cfg(test)]
mod test_videos;
mod texture;
mod thick_parts;
mod time_base;
mod track;
mod tracking;
mod video;
mod warp;
mod window;
pub use background::StaticScene;
pub use camera::{CameraMotion, CameraPath};
pub use error::TrackError;
pub use options::{Hint, MOST_OBJECTS, Region, TrackingOptions};
pub use quality::Quality;
pub use segments::{Limit, Segment, segments};
pub use similarity::Similarity;
pub use time_base::{FASTEST, Finding, StatedTime, TimeBase, gravity_line};
pub use track::{Method, Point, Role, Track, TrackPoint, Tracking, Visibility};
pub use tracking::track;
pub use video::{Clip, FrameSource, HALF_PIXEL, Size, Visitor};
