//! Reading a dataset file, array by array, each checked.

use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use ndarray::{Array2, Array5, Ix2, Ix5};

use super::files::{ClipShape, DatasetFile, Split};
use super::npz;
use crate::support::error::{Error, ErrorKind};

impl DatasetFile {
    /// Reads and checks all arrays: the three of frames and, where expected, the three of actions.
    ///
    /// # Errors
    /// No such file, a damaged file, a missing array, a dtype other than uint8 (actions: than a float), another rank,
    /// frame size, number of channels or clip length than `expected`, a needed split without clips, or actions that are
    /// not finite. Each message says what to do.
    pub fn read(path: &Path, expected: &ClipShape) -> Result<Self> {
        Reader::open(path, expected)?.dataset()
    }
}

/// A dataset file that is being read.
pub(super) struct Reader<'a> {
    pub(super) archive: npz::Archive,
    path: &'a Path,
    expected: &'a ClipShape,
}

impl<'a> Reader<'a> {
    pub(super) fn open(path: &'a Path, expected: &'a ClipShape) -> Result<Self> {
        let there = path.try_exists().with_context(|| format!("the dataset file {path:?} cannot be reached"))?;
        if !there {
            let missing = anyhow!("there is no dataset file {path:?}; {}", expected.get());
            return Err(Error::new(ErrorKind::Missing, missing).into());
        }
        Ok(Reader { archive: npz::Archive::open(path)?, path, expected })
    }

    /// Name of the array of a split's frames; none of a split that need not be there and is not.
    pub(super) fn array_of(&self, split: Split) -> Option<String> {
        let name = format!("{}_x", split.name());
        (self.expected.needed[split as usize] || self.archive.has(&name)).then_some(name)
    }

    /// Refuses frames of another shape.
    pub(super) fn check(&self, split: Split, shape: &[usize]) -> Result<()> {
        let (path, expected) = (self.path, self.expected);
        check(shape, expected, expected.needed[split as usize]).with_context(|| {
            let name = split.name();
            format!("array \"{name}_x\" of {path:?} does not fit task {:?} (expected {expected})", expected.task)
        })
    }

    /// Bytes of all frames, as far as the file says.
    pub(super) fn bytes(&self) -> u64 {
        let bytes = |name: String| self.archive.header(&name).map_or(0, |header| header.bytes);
        Split::ALL.into_iter().filter_map(|split| self.array_of(split)).map(bytes).sum()
    }

    /// The shape of a split that is not there.
    pub(super) fn no_clips(&self) -> [usize; 5] {
        let ClipShape { frames, side, channels, .. } = *self.expected;
        [0, frames, side, side, channels]
    }

    /// All arrays, in memory.
    pub(super) fn dataset(&mut self) -> Result<DatasetFile> {
        let mut read = |split| self.frames(split);
        let (train, valid, test) = (read(Split::Train)?, read(Split::Valid)?, read(Split::Test)?);
        let lengths = [&train, &valid, &test].map(|frames| [frames.dim().0, frames.dim().1]);
        Ok(DatasetFile { train, valid, test, actions: self.actions(lengths)? })
    }

    /// The frames of a split.
    fn frames(&mut self, split: Split) -> Result<Array5<u8>> {
        let Some(name) = self.array_of(split) else {
            return Ok(Array5::zeros(self.no_clips()));
        };
        let array = self.archive.array(&name, "uint8")?;
        self.check(split, array.shape())?;
        Ok(array.into_dimensionality::<Ix5>()?)
    }

    /// What acts from outside in each split, whose numbers of clips and frames are known; none where nothing does.
    pub(super) fn actions(&mut self, lengths: [[usize; 2]; 3]) -> Result<Option<[Array2<f32>; 3]>> {
        if !self.expected.actions {
            return Ok(None);
        }
        let mut read = |split: Split| self.actions_of(split, lengths[split as usize]);
        let actions = (|| Ok::<_, anyhow::Error>([read(Split::Train)?, read(Split::Valid)?, read(Split::Test)?]))();
        let (path, task, again) = (self.path, &self.expected.task, self.expected.get_again());
        actions.map(Some).with_context(|| {
            format!("no actions for the clips of {path:?}: task {task:?} needs one number a frame; {again}")
        })
    }

    fn actions_of(&mut self, split: Split, [clips, frames]: [usize; 2]) -> Result<Array2<f32>> {
        let name = format!("{}_u", split.name());
        if clips == 0 {
            return Ok(Array2::zeros((0, frames)));
        }
        let actions = self.archive.floats(&name)?;
        ensure!(
            actions.shape() == [clips, frames],
            "array {name:?} has shape {:?}, expected [{clips}, {frames}] (clips, frames)",
            actions.shape()
        );
        ensure!(actions.iter().all(|u| u.is_finite()), "array {name:?} holds numbers that are not finite");
        Ok(actions.into_dimensionality::<Ix2>()?)
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
