//! What is measured: one motion or several of the same kind, each filmed once.

use std::ops::Range;
use std::sync::Arc;

use paig::network::System;
use paig::network::cells::{CellKind, Coordinates};
use paig::network::system::SystemTable;
use paig::tasks::video::Video;

use super::fit::Observations;
use super::results::SceneRecord;
use super::scale::Scale;

/// Systematic error of tracked positions, pixels of the video.
const SYSTEMATIC: f64 = 0.1;

/// Videos of one system and what is known of them before anything is fitted.
#[derive(Debug, Clone)]
pub struct RecordedSystem {
    /// Where the videos come from, their scale and axes.
    pub record: Video,
    /// The equation with the frame in whose pixels its positions are.
    pub system: System,
    pub scale: Scale,
    /// Time between two frames, in the unit of the system's `dt`.
    pub dt: f64,
    /// Frames of the pieces with which a fit begins.
    pub piece: usize,
    /// Whether an even drift of all that is seen is looked for: the tracker holds the camera still by itself.
    pub may_drift: bool,
    pub recordings: Vec<Recording>,
}

/// Share of the frames that are held out to judge a fit.
const HELD_OUT: f64 = 0.25;

/// Frames of so many that a fit to be judged is made to.
pub fn learned_from(frames: usize) -> usize {
    frames - (HELD_OUT * frames as f64).round() as usize
}

/// One video, or the part of it that shows the motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// For people.
    pub name: String,
    /// When its first frame is shown, seconds from the beginning of the video.
    pub first_seconds: f64,
    /// When each frame was filmed, in the unit of the system's `dt`, from 0 on.
    pub times: Vec<f64>,
    /// Number of each frame in the video, from 0 on; empty where it is not known.
    pub numbers: Vec<u64>,
    /// Frames that may be learned from; those after them are held out to judge the fit.
    pub trained: usize,
    /// Whether those frames teach the parameters, or only say how the motion begins.
    pub teaches: bool,
}

/// Positions of the objects in every frame of every recording, found by one means.
#[derive(Debug, Clone)]
pub struct Observation {
    /// For people: what found them.
    pub by: String,
    pub recordings: Vec<Positions>,
}

/// Positions of all objects in every frame of one recording; not numbers where an object is not seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Positions {
    /// `(x, y)` of each object, pixels of a frame, frame by frame.
    pub pixels: Vec<f64>,
    /// The same in the equation's coordinates.
    pub coordinates: Vec<f64>,
    /// Precision of each coordinate relative to the others'.
    pub weights: Vec<f64>,
}

impl Positions {
    /// Of one precision.
    pub fn even(pixels: Vec<f64>, coordinates: Vec<f64>) -> Self {
        let weights = vec![1.0; coordinates.len()];
        Positions { pixels, coordinates, weights }
    }
}

impl RecordedSystem {
    /// Geometry, scale and an equation, for a file.
    pub(super) fn record_of(&self, cell: &Arc<CellKind>) -> SceneRecord {
        let system = System { cell: cell.clone(), ..self.system.clone() };
        SceneRecord { system: SystemTable::from(&system), video: Video { sources: Vec::new(), ..self.record.clone() } }
    }

    /// From the unit of a coordinate to pixels of the video, or radians.
    pub fn per_coordinate(&self) -> (f64, &'static str) {
        match self.system.cell.coordinates {
            Coordinates::Position => (self.scale.video_pixels, "px"),
            Coordinates::Angle => (1.0, "rad"),
        }
    }

    /// Systematic error of tracked positions in the unit of a coordinate; of angles none is assumed.
    pub fn systematic_error(&self) -> f64 {
        match self.system.cell.coordinates {
            Coordinates::Position => SYSTEMATIC / self.scale.video_pixels,
            Coordinates::Angle => 0.0,
        }
    }

    /// What a fit is made to; the part that is held out is not part of it.
    pub fn tracks(&self, observation: &Observation) -> Vec<Observations> {
        let track = |(recording, positions): (&Recording, &Positions)| Observations {
            positions: positions.coordinates.clone(),
            times: recording.times.clone(),
            weights: positions.weights.clone(),
            trained: recording.trained,
            teaches: recording.teaches,
        };
        self.recordings.iter().zip(&observation.recordings).map(track).collect()
    }
}

impl RecordedSystem {
    /// The same with only these frames of the only recording.
    pub fn cut(&mut self, frames: Range<usize>) {
        let recording = &mut self.recordings[0];
        recording.first_seconds += self.scale.seconds * recording.times[frames.start];
        let first = recording.times[frames.start];
        recording.times = recording.times[frames.clone()].iter().map(|time| time - first).collect();
        if !recording.numbers.is_empty() {
            recording.numbers = recording.numbers[frames.clone()].to_vec();
        }
        recording.trained = learned_from(frames.len());
    }
}

impl Observation {
    /// The same with only these of all frames of the only recording.
    pub fn cut(&mut self, frames: &Range<usize>, all: usize) {
        let Positions { pixels, coordinates, weights } = &mut self.recordings[0];
        for numbers in [pixels, coordinates, weights] {
            let size = numbers.len() / all;
            *numbers = numbers[size * frames.start..size * frames.end].to_vec();
        }
    }
}

/// The same tracks with nothing held out of those that teach.
pub fn whole(tracks: &[Observations]) -> Vec<Observations> {
    let whole = |track: &Observations| {
        let frames = track.times.len();
        Observations { trained: if track.teaches { frames } else { track.trained }, ..track.clone() }
    };
    tracks.iter().map(whole).collect()
}
