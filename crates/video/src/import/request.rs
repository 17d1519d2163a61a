//! What is to be imported, and how.

use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};

use super::crop::CropChoice;
use super::stated::Stated;
use super::time_base::VideoPart;
use super::tracker::TrackerFile;
use paig::network::cells::{CellKind, Equations};
use paig::network::system::EquationEntry;
use paig::tasks;

/// What is to be imported, and how.
#[derive(Debug, Clone)]
pub struct ImportRequest {
    pub videos: Vec<PathBuf>,
    /// Folder for the files.
    pub out: PathBuf,
    /// Writes into a folder that holds something already.
    pub force: bool,
    /// Name of the task; made from the folder's if not given.
    pub name: Option<String>,
    /// Parts of each video that show one motion from its beginning to its end, one after the other.
    pub parts: Vec<VideoPart>,
    /// Every how many-th frame is kept.
    pub step: usize,
    /// Frames a second, in place of the video's own times.
    pub fps: Option<f64>,
    /// How many times as slow as it was filmed each video plays; by its tags where absent. Not with `fps`.
    pub slow_motion: Option<f64>,
    pub crop: CropChoice,
    /// Side of the frames that a model sees, pixels.
    pub side: usize,
    pub grey: bool,
    /// See [`Video`](paig::tasks::video::Video).
    pub pixels_per_metre: Option<f64>,
    pub scale_percent: f64,
    pub time_percent: f64,
    pub origin: Option<[f64; 2]>,
    pub angle: f64,
    pub y_up: bool,
    /// Points in the videos between which the scale was measured, and the Tracker file that some of this is of: both are held
    /// against the videos.
    pub scale_points: Option<[[f64; 2]; 2]>,
    pub tracker: Option<TrackerFile>,
    /// Unit of `dt`: `s`, `ms` or `frames`.
    pub time_unit: String,
    pub equation: EquationEntry,
    pub objects: Option<usize>,
    pub input_steps: usize,
    pub pred_steps: usize,
    /// Frames of a training clip, and how many of them the next one shares.
    pub clip_frames: Option<usize>,
    pub overlap: Option<usize>,
}

/// What stands where the folder is to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FolderState {
    /// Nothing.
    New,
    /// An empty folder.
    Empty,
    /// A folder that is replaced.
    Replaced,
}

impl ImportRequest {
    /// These videos into this folder: all frames, what moves cut out in colour, as a ball that falls; the defaults of the
    /// program `import`.
    pub fn of(videos: Vec<PathBuf>, out: PathBuf) -> Self {
        ImportRequest {
            videos,
            out,
            force: false,
            name: None,
            parts: vec![VideoPart::All],
            step: 1,
            fps: None,
            slow_motion: None,
            crop: CropChoice::Auto,
            side: 32,
            grey: false,
            pixels_per_metre: None,
            scale_percent: 0.0,
            time_percent: 0.0,
            origin: None,
            angle: 0.0,
            y_up: false,
            scale_points: None,
            tracker: None,
            time_unit: "s".into(),
            equation: EquationEntry::Name("falling".into()),
            objects: None,
            input_steps: 4,
            pred_steps: 6,
            clip_frames: None,
            overlap: None,
        }
    }

    /// What is held against the videos.
    pub(super) fn stated(&self) -> Stated {
        Stated {
            pixels_per_metre: self.pixels_per_metre,
            scale_percent: self.scale_percent,
            time_percent: self.time_percent,
            origin: self.origin,
            angle: self.angle,
            fps: self.fps,
            scale_points: self.scale_points,
            tracker: self.tracker,
        }
    }

    /// Channels of a frame as a model sees it.
    pub fn channels(&self) -> usize {
        if self.grey { 1 } else { 3 }
    }

    /// The equation that the objects obey.
    pub(super) fn kind(&self) -> Result<Arc<CellKind>> {
        self.equation.kind(self.objects.unwrap_or(1), &Equations::default())
    }

    /// Fewest frames of a clip: what the encoder sees and what is predicted.
    pub(super) fn least_frames(&self) -> usize {
        self.input_steps.saturating_add(self.pred_steps)
    }

    /// Bytes of such a frame.
    pub(super) fn frame_bytes(&self) -> usize {
        self.side * self.side * self.channels()
    }

    /// The task's name: the given one, or the folder's with what may not stand in a name replaced.
    pub(super) fn task_name(&self) -> Result<String> {
        let name = match &self.name {
            Some(name) => name.clone(),
            None => {
                let folder =
                    self.out.file_name().context("--out has no name of its own; give the task's with --name")?;
                let letter = |c: char| if c.is_ascii_alphanumeric() || c == '_' { c.to_ascii_lowercase() } else { '-' };
                folder.to_string_lossy().chars().map(letter).take(64).collect::<String>().trim_matches('-').into()
            }
        };
        let why = || match &self.name {
            Some(_) => "--name",
            None => "the name of the folder --out makes no task's name; give one with --name",
        };
        tasks::check_name(&name).with_context(why)?;
        ensure!(tasks::builtin(&name).is_none(), "{name:?} is the name of a built-in task; choose another with --name");
        Ok(name)
    }

    /// What stands in the folder's place. Nothing that someone has there is written over unasked.
    pub(super) fn place(&self) -> Result<FolderState> {
        let out = &self.out;
        if !out.exists() {
            return Ok(FolderState::New);
        }
        ensure!(out.is_dir(), "{} is a file; --out is a folder", out.display());
        let empty = fs::read_dir(out).with_context(|| format!("cannot read {}", out.display()))?.next().is_none();
        if !empty && !self.force {
            bail!("{} holds something already; choose another --out, or replace its files with --force", out.display());
        }
        Ok(if empty { FolderState::Empty } else { FolderState::Replaced })
    }
}
