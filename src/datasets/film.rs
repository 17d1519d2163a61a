//! `film.npz`: all frames of the videos that a task's clips were cut from, each once and in their order.
//!
//! Two arrays for each video: `video0`, `video1`, ..: uint8 `[frames, S, S, channels]`, and `numbers0`, `numbers1`, ..: uint64
//! `[frames]`. Films of earlier versions lack the second.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use ndarray::{Array1, Array4, Array5, Ix1, Ix4, s};
use tch::Device;

use super::iterators::Clips;
use super::npz::{self, Archive};
use crate::support::random::fnv1a;

/// Beside the dataset files.
pub const FILM: &str = "film.npz";

/// The frames of each video.
#[derive(Debug, Clone, PartialEq)]
pub struct FilmFile {
    /// `[frames, S, S, channels]`.
    pub videos: Vec<Array4<u8>>,
    /// Which frames of the video they are, counted from 0, `[frames]`; the same one again where a regular clock needed it. Empty
    /// where the file does not say.
    pub numbers: Vec<Array1<u64>>,
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
        let videos = (0..count).map(read).collect::<Result<Vec<_>>>()?;
        let numbers = videos.iter().enumerate().map(|(video, frames)| {
            let name = format!("numbers{video}");
            if !archive.has(&name) {
                return Ok(Array1::default(0));
            }
            let array = archive.array::<u64>(&name, "uint64")?;
            let (found, expected) = (array.shape().to_vec(), frames.dim().0);
            let array = array.into_dimensionality::<Ix1>().ok().filter(|array| array.len() == expected);
            array.with_context(|| {
                format!(
                    "array {name:?} of {} has shape {found:?}, expected [{expected}]; import the video again",
                    path.display()
                )
            })
        });
        let numbers = numbers.collect::<Result<_>>()?;
        Ok(FilmFile { videos, numbers })
    }

    /// Checksum of all frames and their numbers.
    pub fn checksum(&self) -> String {
        let numbers = self.numbers.iter().flatten().flat_map(|number| number.to_le_bytes());
        let sums = self.videos.iter().map(|frames| fnv1a(frames.iter())).chain([fnv1a(&numbers.collect::<Vec<_>>())]);
        let sums: Vec<u8> = sums.flat_map(u64::to_le_bytes).collect();
        format!("{:016x}", fnv1a(&sums))
    }

    /// # Errors
    /// A full disk.
    pub fn write(&self, path: &Path) -> Result<()> {
        npz::write(path, |npz| {
            for (video, frames) in self.videos.iter().enumerate() {
                npz.add_array(format!("video{video}"), frames)?;
            }
            for (video, numbers) in self.numbers.iter().enumerate() {
                npz.add_array(format!("numbers{video}"), numbers)?;
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
