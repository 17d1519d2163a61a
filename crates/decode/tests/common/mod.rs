//! What ffmpeg decodes, against which the crate's decoders are held.

use std::path::Path;

use md5::{Digest, Md5};
use paig_decode::VideoFile;

/// Times of frames, seconds since the first, and the md5 sums of their samples.
pub type FrameSums = Vec<(f64, String)>;

/// Parses ffmpeg's list of frames (`-f framemd5`).
pub fn parse(list: &str) -> FrameSums {
    let base = list.lines().find_map(|line| line.strip_prefix("#tb 0: ")).expect("a time base");
    let (count, second) = base.split_once('/').expect("a ratio");
    let tick = count.parse::<f64>().unwrap() / second.parse::<f64>().unwrap();
    let frames = list.lines().filter(|line| !line.starts_with('#')).map(|line| {
        let fields: Vec<_> = line.split(',').map(str::trim).collect();
        (fields[2].parse::<f64>().unwrap() * tick, fields[5].to_string())
    });
    let frames: FrameSums = frames.collect();
    let first = frames.first().map_or(0.0, |frame| frame.0);
    frames.into_iter().map(|(time, sum)| (time - first, sum)).collect()
}

/// The same of what this crate decodes.
pub fn decode(path: &Path) -> Result<FrameSums, paig_decode::DecodeError> {
    let video = VideoFile::open_built_in(path)?;
    let sums = video.frames()?.map(|frame| {
        let frame = frame?;
        let seconds = frame.seconds().expect("a time");
        assert_eq!(Some(seconds), video.times().map(|times| times[frame.number()]));
        let sum = Md5::digest(frame.samples());
        Ok((seconds, sum.iter().map(|byte| format!("{byte:02x}")).collect()))
    });
    let listed = sums.collect::<Result<FrameSums, paig_decode::DecodeError>>()?;
    assert_eq!(listed.len(), video.info().frames);
    Ok(listed)
}

/// How the frames differ; none if they are the same. ffmpeg may part equal times by a tick.
pub fn difference(found: &FrameSums, expected: &FrameSums) -> Option<String> {
    if found.len() != expected.len() {
        return Some(format!("{} frames, expected {}", found.len(), expected.len()));
    }
    found.iter().zip(expected).enumerate().find_map(|(number, (found, expected))| {
        let samples = (found.1 != expected.1).then(|| format!("frame {number} differs"));
        let time = (found.0 - expected.0).abs() > 1e-4;
        samples.or_else(|| time.then(|| format!("frame {number} at {} s, expected {}", found.0, expected.0)))
    })
}
