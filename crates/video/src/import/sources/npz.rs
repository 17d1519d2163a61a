//! An array of frames in an npz: uint8 `[frames, height, width, channels]` or `[frames, height, width]`, 0 to 255.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use image::{Rgb, RgbImage};
use ndarray::{Array4, Axis, Ix4};
use paig_track::StatedTime;

use super::{FrameReader, SourceFacts, check_size};
use paig::datasets::npz::Archive;

/// Most bytes of an array; it is read as a whole.
const MOST_BYTES: u64 = 1 << 31;

/// The frames, `[frames, height, width, channels]`.
#[derive(Debug)]
pub(super) struct FrameArray {
    frames: Array4<u8>,
}

impl FrameArray {
    /// Reads the only array of the file, or the one named `frames` or `video`.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let mut archive = Archive::open(path)?;
        let known = |name: &&String| ["frames", "video"].contains(&name.as_str());
        let name = match archive.names() {
            [name] => name.clone(),
            names => names.iter().find(known).cloned().with_context(|| {
                format!("it has the arrays {names:?}; save the frames as the only one, or name them \"frames\"")
            })?,
        };
        let bytes = archive.header(&name)?.bytes;
        ensure!(
            bytes <= MOST_BYTES,
            "array {name:?} takes {bytes} bytes; at most {MOST_BYTES} are read: cut the video up"
        );
        let array = archive.array::<u8>(&name, "uint8")?;
        let array = if array.ndim() == 3 { array.insert_axis(Axis(3)) } else { array };
        let shape = array.shape().to_vec();
        let [_, height, width, channels] = shape[..] else {
            bail!("array {name:?} has shape {shape:?}; expected [frames, height, width, channels]");
        };
        ensure!(
            [1, 3].contains(&channels),
            "array {name:?} has {channels} channels in its last place; expected 1 or 3"
        );
        check_size(u32::try_from(width)?, u32::try_from(height)?)?;
        Ok(FrameArray { frames: array.into_dimensionality::<Ix4>()? })
    }

    /// An array has no times.
    pub(super) fn facts(&self) -> SourceFacts {
        let (frames, height, width, _) = self.frames.dim();
        SourceFacts { size: (width as u32, height as u32), frames, clock: StatedTime::default(), remarks: Vec::new() }
    }
}

impl FrameReader for &FrameArray {
    fn frame(&mut self, number: usize) -> Result<RgbImage> {
        let frame = self.frames.index_axis(Axis(0), number);
        let (height, width, channels) = frame.dim();
        Ok(RgbImage::from_fn(width as u32, height as u32, |x, y| {
            Rgb([0, 1, 2].map(|channel| frame[[y as usize, x as usize, channel.min(channels - 1)]]))
        }))
    }
}
