//! Dataset files: `.npz` with `train_x`, `valid_x` and `test_x`, uint8 `[clips, frames, S, S, channels]`, 0..255; where
//! something acts on the objects from outside, also `train_u`, `valid_u` and `test_u`, float32 `[clips, frames]`: number
//! t acts from frame t to frame t + 1, so the last one acts after the clip. A training file may lack `test_x`, a test file
//! `train_x` and `valid_x`.
//!
//! The authors' files and ours are the same format. Original: `nn/datasets/generators.py`, `nn/datasets/iterators.py`.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use ndarray::{Array2, Array5, ArrayView4, Axis, Ix2, Ix5};

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

/// What the clips of a file must look like.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ClipShape {
    /// Name of the task, for messages.
    pub task: String,
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
    /// The command that makes such clips.
    fn command(&self) -> String {
        match tasks::builtin(&self.task) {
            Some(task) => format!("`generate --task {}`", task.name),
            None => "`generate --task` and the task's file".into(),
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

    /// Reads and checks all arrays: the three of frames and, where expected, the three of actions.
    ///
    /// # Errors
    /// No such file, a damaged file, a missing array, a dtype other than uint8 (actions: than a float), another rank,
    /// frame size, number of channels or clip length than `expected`, a needed split without clips, or actions that are
    /// not finite. Each message says what to do.
    pub fn read(path: &Path, expected: &ClipShape) -> Result<Self> {
        let there = path.try_exists().with_context(|| format!("the dataset file {path:?} cannot be reached"))?;
        if !there {
            let or = if tasks::builtin(&expected.task).is_some() { "the authors' file" } else { "your own file" };
            bail!("there is no dataset file {path:?}; make it with {}, or put {or} there", expected.command());
        }
        let mut archive = npz::Archive::open(path)?;
        let mut read = |split: Split| {
            let name = format!("{}_x", split.name());
            let needed = expected.needed[split as usize];
            if !needed && !archive.has(&name) {
                return Ok(Array5::zeros((0, expected.frames, expected.side, expected.side, expected.channels)));
            }
            let array = archive.array(&name, "uint8")?;
            check(array.shape(), expected, needed).with_context(|| {
                format!("array {name:?} of {path:?} does not fit task {:?} (expected {expected})", expected.task)
            })?;
            Ok::<_, anyhow::Error>(array.into_dimensionality::<Ix5>()?)
        };
        let mut dataset =
            Self { train: read(Split::Train)?, valid: read(Split::Valid)?, test: read(Split::Test)?, actions: None };
        if expected.actions {
            let mut read = |split: Split| dataset.read_actions(&mut archive, split);
            let actions = (|| Ok::<_, anyhow::Error>([read(Split::Train)?, read(Split::Valid)?, read(Split::Test)?]))();
            dataset.actions = Some(actions.with_context(|| {
                let (task, command) = (&expected.task, expected.command());
                format!(
                    "no actions for the clips of {path:?}: task {task:?} needs one number a frame; make the file again with \
                     {command} and --force"
                )
            })?);
        }
        Ok(dataset)
    }

    /// What acts from outside in the clips of one split, whose frames are known.
    fn read_actions(&self, archive: &mut npz::Archive, split: Split) -> Result<Array2<f32>> {
        let name = format!("{}_u", split.name());
        let (clips, frames, ..) = self.split(split).dim();
        if clips == 0 {
            return Ok(Array2::zeros((0, frames)));
        }
        let actions = archive.floats(&name)?;
        ensure!(
            actions.shape() == [clips, frames],
            "array {name:?} has shape {:?}, expected [{clips}, {frames}] (clips, frames)",
            actions.shape()
        );
        ensure!(actions.iter().all(|u| u.is_finite()), "array {name:?} holds numbers that are not finite");
        Ok(actions.into_dimensionality::<Ix2>()?)
    }

    /// Refuses training clips that show nothing to learn from. `path` is named in the message.
    ///
    /// # Errors
    /// Frames that are (all but) black, as those saved from 0..1 are, or clips in which nothing ever moves.
    pub fn check_motion(&self, path: &Path) -> Result<()> {
        for split in [Split::Train, Split::Valid] {
            let (name, clips) = (split.name(), self.split(split));
            let brightest = clips.iter().max().copied().unwrap_or(0);
            ensure!(
                brightest > 1,
                "array \"{name}_x\" of {path:?}: no pixel is brighter than {brightest} of 255; multiply frames in 0..1 by \
                 255 before they are saved as uint8"
            );
            let moves = |clip: ArrayView4<u8>| clip.outer_iter().any(|frame| frame != clip.index_axis(Axis(0), 0));
            ensure!(
                clips.outer_iter().any(moves),
                "array \"{name}_x\" of {path:?}: nothing moves, all frames of a clip are the same"
            );
        }
        Ok(())
    }

    /// Writes the file, compressed, replacing what is there only once all is on the disk.
    ///
    /// # Errors
    /// No space, no permission; the message names the file, and no part of it is left.
    pub fn write(&self, path: &Path) -> Result<()> {
        npz::write_whole(path, &self.compressed(path)?)
    }

    /// The bytes of the file to be written to `path`.
    pub(crate) fn compressed(&self, path: &Path) -> Result<Vec<u8>> {
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

    /// A checksum of each split's frames, which ties a states file to its dataset.
    pub fn checksums(&self) -> [u64; 3] {
        Split::ALL.map(|split| fnv1a(self.split(split)))
    }
}

impl std::fmt::Display for ClipShape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let or = self.or_frames.map_or(String::new(), |frames| format!(" or {frames}"));
        write!(f, "[clips, {}{or}, {}, {}, {}]", self.frames, self.side, self.side, self.channels)
    }
}

fn check(shape: &[usize], expected: &ClipShape, needed: bool) -> Result<()> {
    let [clips, frames, height, width, channels] = *shape else {
        bail!("it has shape {shape:?}: {} dimensions, expected 5", shape.len());
    };
    ensure!(clips > 0 || !needed, "it has no clips; make the dataset again with at least one clip in each split");
    ensure!(
        (height, width, channels) == (expected.side, expected.side, expected.channels),
        "its frames are {height} x {width} x {channels}, expected {1} x {1} x {0}; is it another task's file?",
        expected.channels,
        expected.side
    );
    let advice = match expected.or_frames {
        None if frames == expected.frames => return Ok(()),
        Some(other) if [expected.frames, other].contains(&frames) => return Ok(()),
        None => "; training files hold short clips and test files long ones, are they swapped?".to_string(),
        Some(other) => format!(" or {other}"),
    };
    bail!("its clips have {frames} frames, expected {}{advice}", expected.frames)
}
