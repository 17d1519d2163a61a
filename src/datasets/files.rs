//! Dataset files: `.npz` with `train_x`, `valid_x` and `test_x`, uint8 `[clips, frames, S, S, channels]`, 0..255.
//!
//! The authors' files and ours are the same format. Original: `nn/datasets/generators.py`, `nn/datasets/iterators.py`.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use ndarray::{Array5, Ix5};

use super::npz;
use crate::tasks::Task;

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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClipShape {
    /// Key of the task, for messages.
    pub task: &'static str,
    pub frames: usize,
    /// Side S, pixels.
    pub side: usize,
    pub channels: usize,
}

impl ClipShape {
    /// Clips of the task's training file.
    pub fn training(task: &Task) -> Self {
        Self { task: task.key, frames: task.train_frames, side: task.side, channels: task.channels }
    }

    /// Clips of the task's long test file.
    pub fn test(task: &Task) -> Self {
        Self { frames: task.test_frames, ..Self::training(task) }
    }
}

/// Frames of a dataset, `[clips, frames, S, S, channels]`, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct DatasetFile {
    pub train: Array5<u8>,
    pub valid: Array5<u8>,
    pub test: Array5<u8>,
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

    /// Reads and checks all three arrays.
    ///
    /// # Errors
    /// No such file, a damaged file, a missing array, a dtype other than uint8, another rank, frame size, number of
    /// channels or clip length than `expected`, or a split without clips. Each message says what to do.
    pub fn read(path: &Path, expected: &ClipShape) -> Result<Self> {
        if !path.exists() {
            bail!(
                "there is no dataset file {path:?}; make it with `generate --task {}`, or put the authors' file there",
                expected.task
            );
        }
        let mut archive = npz::Archive::open(path)?;
        let mut read = |split: Split| {
            let name = format!("{}_x", split.name());
            let array = archive.array(&name, "uint8")?;
            check(array.shape(), expected).with_context(|| {
                format!("array {name:?} of {path:?} does not fit task {:?} (expected {expected})", expected.task)
            })?;
            Ok::<_, anyhow::Error>(array.into_dimensionality::<Ix5>()?)
        };
        Ok(Self { train: read(Split::Train)?, valid: read(Split::Valid)?, test: read(Split::Test)? })
    }

    /// Writes the file, compressed, replacing what is there only once all is on the disk.
    ///
    /// # Errors
    /// No space, no permission; the message names the file, and no part of it is left.
    pub fn write(&self, path: &Path) -> Result<()> {
        npz::write(path, |npz| {
            for split in Split::ALL {
                npz.add_array(format!("{}_x", split.name()), self.split(split))?;
            }
            Ok(())
        })
    }

    /// A checksum of each split's bytes, which ties a states file to its dataset.
    pub fn checksums(&self) -> [u64; 3] {
        Split::ALL.map(|split| checksum(self.split(split).iter()))
    }
}

/// 64-bit FNV-1a.
pub(super) fn checksum<'a>(bytes: impl Iterator<Item = &'a u8>) -> u64 {
    bytes.fold(0xcbf2_9ce4_8422_2325, |sum, byte| (sum ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3))
}

impl std::fmt::Display for ClipShape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "[clips, {}, {}, {}, {}]", self.frames, self.side, self.side, self.channels)
    }
}

fn check(shape: &[usize], expected: &ClipShape) -> Result<()> {
    let [clips, frames, height, width, channels] = *shape else {
        bail!("it has shape {shape:?}: {} dimensions, expected 5", shape.len());
    };
    ensure!(clips > 0, "it has no clips; make the dataset again with at least one clip in each split");
    ensure!(
        (height, width, channels) == (expected.side, expected.side, expected.channels),
        "its frames are {height} x {width} x {channels}, expected {1} x {1} x {0}; is it another task's file?",
        expected.channels,
        expected.side
    );
    ensure!(
        frames == expected.frames,
        "its clips have {frames} frames, expected {}; training files hold short clips and test files long ones, \
         are they swapped?",
        expected.frames
    );
    Ok(())
}
