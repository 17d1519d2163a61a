//! Frames become the arrays of the dataset files.

use std::ops::Range;

use anyhow::{Result, ensure};
use image::RgbImage;
use ndarray::{Array1, Array2, Array4, Array5};

use super::hold_out::{Cut, HoldOut, starts};
use super::request::ImportRequest;
use paig::datasets::files::DatasetFile;
use paig::datasets::film::FilmFile;

/// Most bytes of one array.
const MOST_BYTES: usize = 1 << 31;

/// The frames of a take as a model sees them, and what they are for.
pub(super) type Divided<'a> = (&'a [RgbImage], &'a HoldOut);

/// The training file and the test file; `dt` is the time from frame to frame.
pub(super) fn files(
    request: &ImportRequest,
    takes: &[Divided],
    cut: &Cut,
    dt: f64,
) -> Result<(DatasetFile, DatasetFile)> {
    let clips = |part: fn(&HoldOut) -> &Range<usize>, length, stride| PartClips::of(takes, part, length, stride);
    let (short, long) = (cut.train_frames, cut.test_frames);
    let train = clips(|parts| &parts.train, short, cut.train_stride);
    let valid = clips(|parts| &parts.valid, short, cut.held_out_stride);
    let test = clips(|parts| &parts.test, long, cut.held_out_stride);
    let (none_short, none_long) = (PartClips::none(short), PartClips::none(long));
    let kind = request.kind()?;
    let file = |clips: [&PartClips; 3]| -> Result<DatasetFile> {
        let [train, valid, test] = clips.map(|clips| clips.pixels(request));
        // Nothing that acted from outside was filmed.
        let held = |clips: &PartClips| clips.times(if kind.tells_time() { dt } else { 0.0 });
        Ok(DatasetFile { train: train?, valid: valid?, test: test?, actions: kind.actions.then(|| clips.map(held)) })
    };
    Ok((file([&train, &valid, &none_short])?, file([&none_long, &none_long, &test])?))
}

/// Clips of one part of every take.
struct PartClips<'a> {
    frames: Vec<&'a [RgbImage]>,
    /// Where each begins in its take, frames.
    begins: Vec<usize>,
    /// Frames of a clip.
    length: usize,
}

/// All frames of every take, which have these numbers in their video.
pub(super) fn film(request: &ImportRequest, takes: &[Vec<RgbImage>], numbers: Vec<Array1<u64>>) -> Result<FilmFile> {
    let (side, channels) = (request.side, request.channels());
    let array = |frames: &Vec<RgbImage>| {
        let shape = (frames.len(), side, side, channels);
        Ok(Array4::from_shape_vec(shape, levels(frames.iter(), channels))?)
    };
    Ok(FilmFile { videos: takes.iter().map(array).collect::<Result<_>>()?, numbers })
}

/// The bytes of frames, of so many channels.
fn levels<'a>(frames: impl Iterator<Item = &'a RgbImage>, channels: usize) -> Vec<u8> {
    frames.flat_map(|frame| frame.pixels()).flat_map(|pixel| pixel.0.into_iter().take(channels)).collect()
}

impl<'a> PartClips<'a> {
    fn none(length: usize) -> Self {
        PartClips { frames: Vec::new(), begins: Vec::new(), length }
    }

    fn of(takes: &[Divided<'a>], part: fn(&HoldOut) -> &Range<usize>, length: usize, stride: usize) -> Self {
        let clips = takes.iter().flat_map(|&(frames, parts)| {
            let begins = starts(part(parts), length, stride);
            begins.into_iter().map(move |begin| (&frames[begin..begin + length], begin))
        });
        let (frames, begins) = clips.unzip();
        PartClips { frames, begins, length }
    }

    /// `[clips, length, S, S, channels]`.
    fn pixels(&self, request: &ImportRequest) -> Result<Array5<u8>> {
        let (clips, side, channels) = (self.frames.len(), request.side, request.channels());
        let bytes = clips * self.length * side * side * channels;
        ensure!(
            bytes <= MOST_BYTES,
            "{clips} clips would take {bytes} bytes; at most {MOST_BYTES}: let clips overlap less (--overlap)"
        );
        let levels = levels(self.frames.iter().flat_map(|clip| clip.iter()), channels);
        Ok(Array5::from_shape_vec((clips, self.length, side, side, channels), levels)?)
    }

    /// The time of each frame since its take's first one, `[clips, length]`, where one lasts `dt`.
    fn times(&self, dt: f64) -> Array2<f32> {
        let time = |(clip, frame): (usize, usize)| ((self.begins[clip] + frame) as f64 * dt) as f32;
        Array2::from_shape_fn((self.begins.len(), self.length), time)
    }
}
