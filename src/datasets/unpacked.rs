//! Frames that are too many for the memory: unpacked once into a file without a name, and read from there when they are
//! wanted. The file is gone when the process is, whatever ends it.

use std::fs::File;
use std::io::Write;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};

use super::files::Split;
use super::reader::Reader;
use super::split_content::SplitContent;
use crate::support::random::Fnv1a;
use crate::support::storage;

/// The frames of one split, uint8 `[clips, time, S, S, channels]`.
#[derive(Debug, Clone)]
pub struct UnpackedFrames {
    file: Arc<File>,
    /// Where the first frame begins, bytes.
    first: u64,
    shape: [usize; 5],
    checksum: u64,
    shown: SplitContent,
}

impl UnpackedFrames {
    /// Unpacks the three splits of a dataset file, beside it or, where nothing can be written there, into the system's folder
    /// for such files.
    pub(super) fn of(reader: &Reader, path: &Path) -> Result<[Self; 3]> {
        let folder = path.parent().unwrap_or(Path::new("."));
        let file = storage::nameless(folder).with_context(|| {
            format!("{path:?} is too large for the memory, and there is no place to unpack it: make its folder writable, or \
                     set TMPDIR")
        })?;
        let (file, mut end) = (Arc::new(file), 0);
        let mut unpack = |split| {
            let frames = Self::unpack(reader, split, &file, end)?;
            end += frames.shape.iter().product::<usize>() as u64;
            Ok::<_, anyhow::Error>(frames)
        };
        Ok([unpack(Split::Train)?, unpack(Split::Valid)?, unpack(Split::Test)?])
    }

    fn unpack(reader: &Reader, split: Split, file: &Arc<File>, first: u64) -> Result<Self> {
        let mut frames = UnpackedFrames {
            file: file.clone(),
            first,
            shape: reader.no_clips(),
            checksum: 0,
            shown: SplitContent::default(),
        };
        let mut checksum = Fnv1a::default();
        let Some(name) = reader.array_of(split) else {
            return Ok(UnpackedFrames { checksum: checksum.sum(), ..frames });
        };
        reader.archive.stream(&name, |header, bytes| {
            let shape: Vec<usize> = header.shape.iter().map(|count| *count as usize).collect();
            reader.check(split, &shape)?;
            frames.shape.copy_from_slice(&shape);
            let mut clip = vec![0; frames.frame_bytes() * frames.time()];
            let damaged = || format!("cannot read array {name:?}: the file is damaged; delete it and get it again");
            for _ in 0..frames.clips() {
                bytes.read_exact(&mut clip).with_context(damaged)?;
                checksum.add(&clip);
                frames.shown.add(&clip, frames.frame_bytes());
                (&**file).write_all(&clip).context("no space to unpack the dataset")?;
            }
            // The archive's own checksum is compared where its data end.
            ensure!(bytes.read(&mut [0]).with_context(damaged)? == 0, "{}", damaged());
            Ok(())
        })?;
        Ok(UnpackedFrames { checksum: checksum.sum(), ..frames })
    }

    pub fn clips(&self) -> usize {
        self.shape[0]
    }

    /// Frames in a clip.
    pub fn time(&self) -> usize {
        self.shape[1]
    }

    /// S, S and the channels.
    pub(crate) fn frame_shape(&self) -> [usize; 3] {
        [self.shape[2], self.shape[3], self.shape[4]]
    }

    fn frame_bytes(&self) -> usize {
        self.frame_shape().iter().product()
    }

    pub(super) fn checksum(&self) -> u64 {
        self.checksum
    }

    pub(super) fn shown(&self) -> SplitContent {
        self.shown
    }

    /// The bytes of `frames` consecutive frames from each of these places in the sequence of all frames.
    ///
    /// # Errors
    /// A disk that fails.
    ///
    /// # Panics
    /// Places beyond the last frame.
    pub fn read(&self, firsts: impl ExactSizeIterator<Item = usize>, frames: usize) -> Result<Vec<u8>> {
        let (size, all) = (self.frame_bytes(), self.clips() * self.time());
        let mut bytes = vec![0; firsts.len() * frames * size];
        for (first, piece) in firsts.zip(bytes.chunks_exact_mut((frames * size).max(1))) {
            assert!(first + frames <= all, "frame {first} of {all}");
            let at = self.first + (first * size) as u64;
            self.file.read_exact_at(piece, at).context("cannot read the frames that were unpacked to the disk")?;
        }
        Ok(bytes)
    }
}
