//! A measurement as its files show it.

use super::explain::Explained;
use super::pictures::Pictures;
use super::recording::RecordedSystem;
use super::results::Measurement;

/// A measured subject.
pub(super) struct MeasuredSubject<'a> {
    pub measurement: &'a Measurement,
    pub scene: &'a RecordedSystem,
    /// Observed positions of each recording, pixels of a frame.
    pub pixels: Vec<&'a [f64]>,
    pub explained: &'a Explained,
    pub pictures: Vec<Pictures>,
}
