//! Frames become the arrays of the dataset files.

use std::ops::Range;

use anyhow::{Result, ensure};
use image::RgbImage;
use ndarray::{Array2, Array4, Array5};

use super::hold_out::{Cut, Parts, starts};
use super::request::Request;
use crate::datasets::files::DatasetFile;
use crate::datasets::film::FilmFile;

/// Most bytes of one array.
const MOST_BYTES: usize = 1 << 31;

/// The frames of a take as a model sees them, and what they are for.
pub(super) type Divided<'a> = (&'a [RgbImage], &'a Parts);

/// The training file and the test file.
pub(super) fn files(request: &Request, takes: &[Divided], cut: &Cut) -> Result<(DatasetFile, DatasetFile)> {
    let array = |part: fn(&Parts) -> &Range<usize>, length, stride| array(request, takes, part, length, stride);
    let empty = |length| Array5::zeros((0, length, request.side, request.side, request.channels()));
    let (short, long) = (cut.train_frames, cut.test_frames);
    let train = array(|parts| &parts.train, short, cut.train_stride)?;
    let valid = array(|parts| &parts.valid, short, cut.held_out_stride)?;
    let test = array(|parts| &parts.test, long, cut.held_out_stride)?;
    // Nothing that acted from outside was filmed.
    let actions = |arrays: [&Array5<u8>; 3]| {
        let nothing = |array: &Array5<u8>| Array2::zeros((array.dim().0, array.dim().1));
        request.kind().map(|kind| kind.actions.then(|| arrays.map(nothing)))
    };
    let (none_short, none_long) = (empty(short), empty(long));
    let training_actions = actions([&train, &valid, &none_short])?;
    let test_actions = actions([&none_long, &none_long, &test])?;
    Ok((
        DatasetFile { train, valid, test: none_short, actions: training_actions },
        DatasetFile { train: none_long.clone(), valid: none_long, test, actions: test_actions },
    ))
}

/// All frames of every take.
pub(super) fn film(request: &Request, takes: &[Vec<RgbImage>]) -> Result<FilmFile> {
    let (side, channels) = (request.side, request.channels());
    let array = |frames: &Vec<RgbImage>| {
        let shape = (frames.len(), side, side, channels);
        Ok(Array4::from_shape_vec(shape, levels(frames.iter(), channels))?)
    };
    Ok(FilmFile { videos: takes.iter().map(array).collect::<Result<_>>()? })
}

/// The bytes of frames, of so many channels.
fn levels<'a>(frames: impl Iterator<Item = &'a RgbImage>, channels: usize) -> Vec<u8> {
    frames.flat_map(|frame| frame.pixels()).flat_map(|pixel| pixel.0.into_iter().take(channels)).collect()
}

/// The clips of one part of every take, `[clips, length, S, S, channels]`.
fn array(
    request: &Request,
    takes: &[Divided],
    part: fn(&Parts) -> &Range<usize>,
    length: usize,
    stride: usize,
) -> Result<Array5<u8>> {
    let clips: Vec<&[RgbImage]> = takes
        .iter()
        .flat_map(|&(frames, parts)| {
            let begin = starts(part(parts), length, stride);
            begin.into_iter().map(move |start| &frames[start..start + length])
        })
        .collect();
    let (side, channels) = (request.side, request.channels());
    let bytes = clips.len() * length * side * side * channels;
    ensure!(
        bytes <= MOST_BYTES,
        "{} clips would take {bytes} bytes; at most {MOST_BYTES}: let clips overlap less (--overlap)",
        clips.len()
    );
    let levels = levels(clips.iter().flat_map(|clip| clip.iter()), channels);
    Ok(Array5::from_shape_vec((clips.len(), length, side, side, channels), levels)?)
}
