//! What a model scores on a set of clips, as it stands in files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::{Deserialize, Serialize};

use crate::network::physics_models::losses::MeanLosses;
use crate::support::atomic;
use crate::support::output::{FileKind, has_keys};
use crate::support::statistics::Spread;

/// What a model makes of a set of clips.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scores {
    pub clips: usize,
    #[serde(flatten)]
    pub losses: MeanLosses,
    /// In the order of time; the first comes right after the input.
    #[serde(default)]
    pub predicted_frames: Vec<PredictedFrame>,
    /// None where the true states are not known.
    pub states: Option<StateErrors>,
}

/// The scores of one predicted frame, averaged over the clips.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PredictedFrame {
    /// Place in the clip, from 0.
    pub frame: usize,
    /// Whether it lies behind the frames that are predicted in training: in T_ext, not in T_pred.
    pub extrapolated: bool,
    /// Summed over the frame.
    pub squared_error: f64,
    /// From -1 to 1; 1 is equal.
    pub ssim: f64,
}

/// The scores of one predicted frame over some runs, each run's averaged over its clips.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FrameSpread {
    /// Place in the clip, from 0.
    pub frame: usize,
    /// In T_ext, not in T_pred.
    pub extrapolated: bool,
    pub squared_error: Spread,
    pub ssim: Spread,
}

impl FrameSpread {
    /// In the order of time, of the predicted frames of one run or of several.
    pub fn of<'a>(runs: impl IntoIterator<Item = &'a [PredictedFrame]>) -> Vec<Self> {
        let mut places: BTreeMap<(usize, bool), Vec<&PredictedFrame>> = BTreeMap::new();
        for scores in runs.into_iter().flatten() {
            places.entry((scores.frame, scores.extrapolated)).or_default().push(scores);
        }
        let spread = |((frame, extrapolated), runs): (_, Vec<&PredictedFrame>)| {
            let squared_error = Spread::of(runs.iter().map(|scores| scores.squared_error))?;
            let ssim = Spread::of(runs.iter().map(|scores| scores.ssim))?;
            Some(FrameSpread { frame, extrapolated, squared_error, ssim })
        };
        places.into_iter().filter_map(spread).collect()
    }
}

/// Root mean squares of distances over clips, frames and objects; pixels, and pixels per time unit (radians where the
/// equation is written in angles).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StateErrors {
    /// The model's object for each true one: the order with the least error of the encoded positions. Errors are those of
    /// this order; which of objects that look alike is which, the model may say otherwise in each clip.
    pub objects: Vec<usize>,
    /// Encoded minus true position of each true object, mean over clips and frames, `[x, y]` or
    /// `[angle]`.
    pub offsets: Vec<Vec<f64>>,
    /// Encoded positions of the first L + T_pred frames.
    pub encoded: f64,
    pub encoded_without_offset: f64,
    /// Rolled-out positions of the T_pred frames after the input.
    pub predicted: f64,
    pub predicted_without_offset: f64,
    /// Of the T_ext frames after those; none where a clip ends before.
    pub extrapolated: Option<f64>,
    pub extrapolated_without_offset: Option<f64>,
    /// Velocity at the last input frame.
    pub initial_velocity: f64,
    /// By which factor the true velocity there, all objects and axes together, best explains the estimated one: below 1
    /// it comes out too small. None where nothing moves.
    #[serde(default)]
    pub initial_velocity_slope: Option<f64>,
    /// Velocity during T_pred.
    pub predicted_velocity: f64,
}

/// What `evaluate --json` writes. The one writer of that file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ScoresFile {
    pub format: u32,
    /// Name of the task.
    pub task: String,
    /// Run folder.
    pub run: PathBuf,
    /// Dataset file, and the part of it.
    pub file: PathBuf,
    pub split: String,
    /// The learned parameters by symbol, lengths in true pixels.
    pub parameters: BTreeMap<String, f64>,
    pub scores: Scores,
}

impl ScoresFile {
    /// The file as one that the program recognizes.
    pub const KIND: FileKind = FileKind {
        name: "scores of `paig evaluate`",
        recognizes: |json| has_keys(json, &["task", "run", "split", "scores"]),
    };

    /// Version of the file's form; to be raised when a reader of today could misread it.
    pub const FORMAT: u32 = 1;

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// A full disk.
    pub fn write(&self, path: &Path) -> Result<()> {
        atomic::write_file(path, |file| Ok(serde_json::to_writer_pretty(file, self)?))
    }
}
