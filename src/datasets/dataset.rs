//! A dataset file that is learned from or scored on: in memory, or, where it is too large for that, on the disk.

use std::path::Path;

use anyhow::Result;
use ndarray::Array2;
use tch::Device;

use super::files::{ClipShape, DatasetFile, FrameIdentity, Split};
use super::iterators::Clips;
use super::reader::Reader;
use super::split_content::SplitContent;
use super::unpacked::UnpackedFrames;
use crate::support::memory;
use crate::support::random::fnv1a;

/// A dataset is held in memory if so many times its frames fit: the arrays, the tensors that are made of them, and as much
/// again for what learns.
const TIMES: u64 = 4;

/// Whether clips are those of before, by what [`Dataset::learned_from`] says of both. Earlier versions said nothing of what
/// acts.
pub fn are_the_same(clips: &str, before: &str) -> bool {
    clips.strip_prefix(before).is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
}

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

    /// Checksums of the clips that a run learns from: those for training and for validation, and of what acts in them.
    pub fn learned_from(&self) -> String {
        let [train, valid, _] = self.checksums();
        let actions = match self {
            Dataset::InMemory(file) => &file.actions,
            Dataset::OnDisk { actions, .. } => actions,
        };
        let bytes = |[train, valid, _]: &[Array2<f32>; 3]| -> Vec<u8> {
            train.iter().chain(valid).flat_map(|action| action.to_le_bytes()).collect()
        };
        let actions = actions.as_ref().map_or(String::new(), |actions| format!(" {:016x}", fnv1a(&bytes(actions))));
        format!("{train:016x} {valid:016x}{actions}")
    }

    /// Checksum of the clips that a run is scored on.
    pub fn scored_on(&self) -> String {
        let [_, _, test] = self.checksums();
        format!("{test:016x}")
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
                Dataset::InMemory(file) => SplitContent::by(file.split(split)),
                Dataset::OnDisk { frames, .. } => frames[split as usize].shown(),
            };
            shown.check(split, path)
        })
    }
}

impl FrameIdentity for Dataset {
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

#[cfg(test)]
mod tests {
    use ndarray::{Array2, Array5};

    use super::*;

    /// Other torques are other clips; a run of before, which says only which frames it saw, goes on.
    #[test]
    fn what_acts_belongs_to_the_clips() {
        let learned_from = |torque: Option<f32>| {
            let frames = || Array5::zeros([2, 3, 4, 4, 1]);
            let actions = torque.map(|torque| [(); 3].map(|()| Array2::from_elem((2, 3), torque)));
            let file = DatasetFile { train: frames(), valid: frames(), test: frames(), actions };
            Dataset::InMemory(file).learned_from()
        };
        let (without, weak, strong) = (learned_from(None), learned_from(Some(1.0)), learned_from(Some(2.0)));
        assert!(are_the_same(&weak, &weak) && are_the_same(&weak, &without) && are_the_same(&without, &without));
        assert!(!are_the_same(&weak, &strong) && !are_the_same(&without, &weak));
        assert!(!are_the_same(&without, &without[..20]));
    }
}
