//! Dataset files: `.npz` with `train_x`, `valid_x` and `test_x`, uint8 `[clips, frames, S, S, channels]`, 0..255; where
//! something acts on the objects from outside, also `train_u`, `valid_u` and `test_u`, float32 `[clips, frames]`: number
//! t acts from frame t to frame t + 1, so the last one acts after the clip. A training file may lack `test_x`, a test file
//! `train_x` and `valid_x`.
//!
//! The authors' files and ours are the same format. Original: `nn/datasets/generators.py`, `nn/datasets/iterators.py`.

use std::path::Path;

use anyhow::Result;
use ndarray::{Array2, Array5};

use super::npz;
use crate::support::random::fnv1a;
use crate::tasks::{self, Task};

/// The three parts of a dataset.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Split {
    Train,
    Valid,
    Test,
}

impl Split {
    pub const ALL: [Self; 3] = [Self::Train, Self::Valid, Self::Test];

    /// `train`, `valid`, `test`: the stem of the array names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Valid => "valid",
            Self::Test => "test",
        }
    }
}

/// Where a task's clips come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// `generate`.
    Generated,
    /// Videos, by `import`.
    Filmed,
    /// Somebody's own program.
    Own,
}

/// What the clips of a file must look like.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ClipShape {
    /// Name of the task, and where its clips come from, for messages.
    pub task: String,
    pub origin: Origin,
    pub frames: usize,
    /// Another length that will do.
    pub or_frames: Option<usize>,
    /// Side S, pixels.
    pub side: usize,
    pub channels: usize,
    /// Whether the file holds what acts from outside.
    pub actions: bool,
    /// Whether each split, in the order of [`Split::ALL`], must be there and hold clips. One that is not there is read as
    /// one without clips.
    pub needed: [bool; 3],
}

impl ClipShape {
    /// Clips of the task's training file.
    pub fn training(task: &Task) -> Self {
        Self {
            task: task.name.clone(),
            origin: match (&task.scene, task.video()) {
                (Some(_), _) => Origin::Generated,
                (None, Some(_)) => Origin::Filmed,
                (None, None) => Origin::Own,
            },
            frames: task.train_frames,
            or_frames: None,
            side: task.system.side,
            channels: task.system.channels,
            actions: task.system.cell.actions,
            needed: [true, true, false],
        }
    }

    /// Clips of the task's long test file.
    pub fn test(task: &Task) -> Self {
        Self { frames: task.test_frames, needed: [false, false, true], ..Self::training(task) }
    }

    /// Clips of either file, of which one split is wanted.
    pub fn of_either(task: &Task, wanted: Split) -> Self {
        let needed = Split::ALL.map(|split| split == wanted);
        Self { or_frames: Some(task.test_frames), needed, ..Self::training(task) }
    }
}

impl ClipShape {
    /// How to get such a file.
    pub(super) fn get(&self) -> String {
        match (self.origin, tasks::builtin(&self.task)) {
            (Origin::Generated, Some(_)) => format!("make it with {}, or put the authors' file there", self.command()),
            (Origin::Generated, None) => format!("make it with {}, or put your own file there", self.command()),
            (Origin::Filmed, _) => "`paig import` the videos again".into(),
            (Origin::Own, _) => "save your clips there (docs/own-data.md), or `paig import` a video".into(),
        }
    }

    /// How to make the file again with what it lacks.
    pub(super) fn get_again(&self) -> String {
        match self.origin {
            Origin::Generated => format!("make the file again with {} and --force", self.command()),
            Origin::Filmed => "import the videos again with this equation (--equation) and --force".into(),
            Origin::Own => "save them beside the frames (docs/own-data.md)".into(),
        }
    }

    fn command(&self) -> String {
        match tasks::builtin(&self.task) {
            Some(task) => format!("`paig generate --task {}`", task.name),
            None => "`paig generate --task` and the task's file".into(),
        }
    }
}

/// Frames of a dataset, `[clips, frames, S, S, channels]`, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct DatasetFile {
    pub train: Array5<u8>,
    pub valid: Array5<u8>,
    pub test: Array5<u8>,
    /// What acts from outside, `[clips, frames]` for each split in the order of [`Split::ALL`]; none for most tasks.
    pub actions: Option<[Array2<f32>; 3]>,
}

impl DatasetFile {
    /// The frames of one split.
    pub fn split(&self, split: Split) -> &Array5<u8> {
        match split {
            Split::Train => &self.train,
            Split::Valid => &self.valid,
            Split::Test => &self.test,
        }
    }

    /// What acts from outside in the clips of one split, `[clips, frames]`.
    pub fn actions(&self, split: Split) -> Option<&Array2<f32>> {
        self.actions.as_ref().map(|actions| &actions[split as usize])
    }

    /// Writes the file, compressed, replacing what is there only once all is on the disk.
    ///
    /// # Errors
    /// No space, no permission; the message names the file, and no part of it is left.
    pub fn write(&self, path: &Path) -> Result<()> {
        npz::write_whole(path, &self.compressed(path)?)
    }

    /// The bytes of the file to be written to `path`.
    pub fn compressed(&self, path: &Path) -> Result<Vec<u8>> {
        npz::compressed(path, |npz| {
            for split in Split::ALL {
                npz.add_array(format!("{}_x", split.name()), self.split(split))?;
                if let Some(actions) = self.actions(split) {
                    npz.add_array(format!("{}_u", split.name()), actions)?;
                }
            }
            Ok(())
        })
    }
}

impl FrameIdentity for DatasetFile {
    fn lengths(&self, split: Split) -> [usize; 2] {
        let (clips, frames, ..) = self.split(split).dim();
        [clips, frames]
    }

    fn checksums(&self) -> [u64; 3] {
        Split::ALL.map(|split| fnv1a(self.split(split)))
    }
}

/// What ties other files to the frames of a dataset.
pub trait FrameIdentity {
    /// Clips of a split, and frames of each.
    fn lengths(&self, split: Split) -> [usize; 2];

    /// A checksum of each split's frames.
    fn checksums(&self) -> [u64; 3];
}

impl std::fmt::Display for ClipShape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let or = self.or_frames.map_or(String::new(), |frames| format!(" or {frames}"));
        write!(f, "[clips, {}{or}, {}, {}, {}]", self.frames, self.side, self.side, self.channels)
    }
}
