//! When frames were filmed: time stamps, and what contradicts them.
//!
//! Fits use the time of each frame. Stamps may be wrong: pictures are repeated or blended where a video was converted to
//! another rate, frames are dropped, slow motion is stored at an ordinary rate. Stamps, pictures and tracks each show a
//! part of that; every finding states its consequence in one line.

mod finding;
mod gravity;
mod motion;
mod repeats;
mod stamps;

pub use finding::Finding;
pub use gravity::gravity_line;
pub use stamps::FASTEST;

use crate::pictures::Change;
use crate::track::Track;

/// What a file states about time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StatedTime {
    /// Presentation time of every frame, seconds, ascending; absent where the source has no times.
    pub times: Option<Vec<f64>>,
    /// Frame rate that a header claims, frames a second.
    pub claimed_rate: Option<f64>,
    /// Frame rate at which the camera recorded by a tag or a person, frames a second.
    pub capture_rate: Option<f64>,
    /// Pieces of the recording that are shown: presentation time at which each begins, seconds, and its speed.
    pub pieces: Vec<(f64, f64)>,
}

/// When frames were filmed, and what was found of it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TimeBase {
    /// Time of every frame of the video, seconds; absent where the source has no times.
    pub times: Option<Vec<f64>>,
    /// Factor by which the file's times were divided: how many times as slow as filmed the file plays.
    pub slow_motion: f64,
    /// Frames that show nothing new: repetitions and blends of others. They have no positions.
    pub stale: Vec<usize>,
    /// Frames before which time or motion breaks: a fit must not reach across.
    pub breaks: Vec<usize>,
    pub findings: Vec<Finding>,
}

impl TimeBase {
    /// Time base of a file. `slow_motion` is how many times as slow as filmed it plays, where a person knows it.
    pub fn new(clock: &StatedTime, slow_motion: Option<f64>) -> Self {
        let mut base = Self { times: clock.times.clone(), slow_motion: 1.0, ..Self::default() };
        stamps::read(&mut base, clock, slow_motion);
        base
    }

    /// Adds what the pictures show: repetitions and blends.
    pub(crate) fn look(&mut self, changes: &[Change]) {
        repeats::find(self, changes);
    }

    /// Adds what a track shows: dropped frames and changes of speed. Breaks of the track's pieces are not looked at.
    pub(crate) fn follow(&mut self, track: &Track) {
        motion::find(self, track);
    }

    /// Time of a frame, seconds; its number where there are no times.
    pub fn time(&self, frame: usize) -> f64 {
        self.times.as_ref().and_then(|times| times.get(frame).copied()).unwrap_or(frame as f64)
    }

    /// One line for each finding.
    pub fn lines(&self) -> Vec<String> {
        self.findings.iter().map(Finding::line).collect()
    }
}
