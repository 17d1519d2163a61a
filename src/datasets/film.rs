//! `film.npz`: all frames of the videos that a task's clips were cut from, each once and in their order.
//!
//! An array for each video, `video0`, `video1`, ..: uint8 `[frames, S, S, channels]`.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use ndarray::{Array4, Array5, Ix4, s};
use tch::Device;

use super::iterators::Clips;
use super::npz::{self, Archive};

/// Beside the dataset files.
pub const FILM: &str = "film.npz";

/// The frames of each video, `[frames, S, S, channels]`.
#[derive(Debug, Clone, PartialEq)]
pub struct FilmFile {
    pub videos: Vec<Array4<u8>>,
}

impl FilmFile {
    /// Reads the frames of `count` videos, of this side and so many channels.
    ///
    /// # Errors
    /// A missing or damaged file, arrays of another shape.
    pub fn read(path: &Path, count: usize, side: usize, channels: usize) -> Result<Self> {
        let mut archive = Archive::open(path).context("import the video again to make it")?;
        let read = |video: usize| {
            let name = format!("video{video}");
            let array = archive.array::<u8>(&name, "uint8")?;
            let shape = array.shape().to_vec();
            let array = array.into_dimensionality::<Ix4>().ok().filter(|array| {
                let (frames, height, width, found) = array.dim();
                frames > 0 && (height, width, found) == (side, side, channels)
            });
            array.with_context(|| {
                format!(
                    "array {name:?} of {} has shape {shape:?}, expected [frames, {side}, {side}, {channels}]; import the \
                     video again",
                    path.display()
                )
            })
        };
        Ok(FilmFile { videos: (0..count).map(read).collect::<Result<_>>()? })
    }

    /// # Errors
    /// A full disk.
    pub fn write(&self, path: &Path) -> Result<()> {
        npz::write(path, |npz| {
            for (video, frames) in self.videos.iter().enumerate() {
                npz.add_array(format!("video{video}"), frames)?;
            }
            Ok(())
        })
    }

    /// The frames of one video as clips of so many frames that follow each other; the last one ends with the video, and
    /// shares frames with the one before where it must.
    ///
    /// # Errors
    /// A video that is shorter than a clip.
    pub fn clips(&self, video: usize, length: usize, device: Device) -> Result<Clips> {
        let frames = &self.videos[video];
        let (count, height, width, channels) = frames.dim();
        ensure!(length > 0 && count >= length, "a video of {count} frames is shorter than a clip of {length}");
        let mut clips = Array5::zeros((count.div_ceil(length), length, height, width, channels));
        for (place, mut clip) in clips.outer_iter_mut().enumerate() {
            let start = (place * length).min(count - length);
            clip.assign(&frames.slice(s![start..start + length, .., .., ..]));
        }
        Ok(Clips::new(&clips, None, device))
    }
}
