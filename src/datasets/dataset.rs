//! A dataset file that is learned from or scored on: in memory, or, where it is too large for that, on the disk.

use std::path::Path;

use anyhow::Result;
use ndarray::Array2;
use tch::Device;

use super::files::{ClipShape, DatasetFile, Frames, Split};
use super::iterators::Clips;
use super::reader::Reader;
use super::shown::Shown;
use super::unpacked::UnpackedFrames;
use crate::support::memory;

/// A dataset is held in memory if so many times its frames fit: the arrays, the tensors that are made of them, and as much
/// again for what learns.
const TIMES: u64 = 4;

/// An open dataset.
#[derive(Debug)]
pub enum Dataset {
    InMemory(DatasetFile),
    OnDisk { frames: [UnpackedFrames; 3], actions: Option<[Array2<f32>; 3]> },
}

impl Dataset {
    /// Opens a dataset file and checks all of it.
    ///
    /// # Errors
    /// As for [`DatasetFile::read`]; one too large for the memory also where it cannot be unpacked.
    pub fn open(path: &Path, expected: &ClipShape) -> Result<Self> {
        Self::open_within(path, expected, memory::available().unwrap_or(u64::MAX))
    }

    /// The same where so many bytes of memory are free.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn open_within(path: &Path, expected: &ClipShape, free: u64) -> Result<Self> {
        let mut reader = Reader::open(path, expected)?;
        if reader.bytes().saturating_mul(TIMES) <= free {
            return Ok(Dataset::InMemory(reader.dataset()?));
        }
        let frames = UnpackedFrames::of(&reader, path)?;
        let lengths = frames.each_ref().map(|frames| [frames.clips(), frames.time()]);
        Ok(Dataset::OnDisk { frames, actions: reader.actions(lengths)? })
    }

    pub fn is_on_disk(&self) -> bool {
        matches!(self, Dataset::OnDisk { .. })
    }

    /// Checksums of the clips that a run learns from: those for training and for validation.
    pub fn learned_from(&self) -> String {
        let [train, valid, _] = self.checksums();
        format!("{train:016x} {valid:016x}")
    }

    /// The clips of one split, to be served on a device.
    pub fn clips(&self, split: Split, device: Device) -> Clips {
        match self {
            Dataset::InMemory(file) => Clips::new(file.split(split), file.actions(split), device),
            Dataset::OnDisk { frames, actions } => {
                let actions = actions.as_ref().map(|actions| &actions[split as usize]);
                Clips::on_disk(frames[split as usize].clone(), actions, device)
            }
        }
    }

    /// Refuses training clips that show nothing to learn from. `path` is named in the message.
    ///
    /// # Errors
    /// Frames that are (all but) black, as those saved from 0..1 are, or clips in which nothing ever moves.
    pub fn check_motion(&self, path: &Path) -> Result<()> {
        [Split::Train, Split::Valid].into_iter().try_for_each(|split| {
            let shown = match self {
                Dataset::InMemory(file) => Shown::by(file.split(split)),
                Dataset::OnDisk { frames, .. } => frames[split as usize].shown(),
            };
            shown.check(split, path)
        })
    }
}

impl Frames for Dataset {
    fn lengths(&self, split: Split) -> [usize; 2] {
        match self {
            Dataset::InMemory(file) => file.lengths(split),
            Dataset::OnDisk { frames, .. } => [frames[split as usize].clips(), frames[split as usize].time()],
        }
    }

    fn checksums(&self) -> [u64; 3] {
        match self {
            Dataset::InMemory(file) => file.checksums(),
            Dataset::OnDisk { frames, .. } => frames.each_ref().map(UnpackedFrames::checksum),
        }
    }
}
