//! What the page shows of a video before it is measured: its frames as pictures, its times, what moves in it. Made by a process
//! of its own, which a damaged video may end.

use std::fs;
use std::io::Write;
use std::ops::Range;
use std::path::Path;
use std::thread;

use anyhow::{Context, Result, anyhow};
use image::codecs::jpeg::JpegEncoder;
use image::{RgbImage, imageops};
use paig::support::atomic;
use paig_track::TrackingOptions;
use paig_video::import::sources::{FrameReader, SourceVideo};
use paig_video::track::track;
use serde::{Deserialize, Serialize};

use crate::examples;
use crate::project::Project;
use crate::proposals::{Proposals, propose};

/// Longer side of the pictures, pixels, and of the small ones of the strip.
const SIDE: u32 = 1280;
const SMALL_SIDE: u32 = 160;
/// Of the pictures, per cent.
const QUALITY: u8 = 85;
/// Pictures of the strip.
pub const STRIP: usize = 24;
/// Most frames of which pictures are made.
const MOST_FRAMES: usize = 5000;
/// Most movers that are proposed.
const MOST_MOVERS: usize = 6;
/// Frames between two notes of progress.
const NOTED: usize = 8;

const VIDEO: &str = "video.json";
const PROGRESS: &str = "progress.json";
const PROPOSALS: &str = "proposals.json";

/// Facts of a video.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct VideoFacts {
    pub width: u32,
    pub height: u32,
    pub frames: usize,
    /// Frames with a picture: the first ones.
    pub shown: usize,
    /// Every so many frames there is a picture for the strip.
    pub strip_step: usize,
    /// Seconds from the first frame; none where the file has no times.
    pub times: Option<Vec<f64>>,
    pub remarks: Vec<String>,
}

/// Pictures that are made so far.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PreviewProgress {
    pub pictures: usize,
}

/// What is known so far.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProjectPreview {
    pub facts: Option<VideoFacts>,
    pub made: PreviewProgress,
    pub proposals: Option<Proposals>,
}

impl ProjectPreview {
    /// What a process has left in a folder until now.
    pub fn read(folder: &Path) -> Self {
        ProjectPreview {
            facts: read(&folder.join(VIDEO)),
            made: read(&folder.join(PROGRESS)).unwrap_or_default(),
            proposals: read(&folder.join(PROPOSALS)),
        }
    }

    /// The longest free motion that was found, first frame and the one after the last.
    pub fn free_motion(&self) -> Option<[usize; 2]> {
        let proposals = self.proposals.as_ref()?;
        let piece = &proposals.pieces[proposals.best?];
        Some([piece.start, piece.end])
    }
}

fn read<T: serde::de::DeserializeOwned>(path: &Path) -> Option<T> {
    serde_json::from_slice(&fs::read(path).ok()?).ok()
}

fn write(path: &Path, value: &impl Serialize) -> Result<()> {
    atomic::write_file(path, |file| Ok(serde_json::to_writer(file, value)?))
}

/// Makes the video of a generated example, where the project is one, then the pictures and the proposals.
///
/// # Errors
/// A video that cannot be read, a full disk.
pub fn prepare(folder: &Path) -> Result<()> {
    let project = Project::at(folder)?;
    if let Some(key) = &project.record()?.example
        && project.source().is_err()
    {
        let made = examples::made(key).with_context(|| format!("there is no example {key:?}"))?;
        let film = made.film()?;
        let path = project.source_folder()?.join(format!("{key}.avi"));
        atomic::write_file(&path, |file| Ok(file.write_all(&film)?))?;
        project.write_settings(&made.settings())?;
    }
    let out = project.preview_folder();
    fs::create_dir_all(&out)?;
    for stale in [VIDEO, PROGRESS, PROPOSALS] {
        let path = out.join(stale);
        if path.exists() {
            fs::remove_file(path)?;
        }
    }
    let path = project.source()?;
    let video = SourceVideo::open(&path)?.timed(None);
    let facts = VideoFacts {
        width: video.width,
        height: video.height,
        frames: video.frames,
        shown: video.frames.min(MOST_FRAMES),
        strip_step: video.frames.min(MOST_FRAMES).div_ceil(STRIP).max(1),
        times: video.times.clone(),
        remarks: video.remarks.clone(),
    };
    write(&out.join(VIDEO), &facts)?;
    let mut frames = video.decode()?;
    // The first frame is shown before the tracker takes all cores.
    pictures(frames.as_mut(), &facts, 0..1, &out)?;
    thread::scope(|scope| {
        let tracking = scope.spawn(|| proposals(&video));
        pictures(frames.as_mut(), &facts, 1..facts.shown, &out)?;
        let proposals = tracking.join().map_err(|_| anyhow!("the tracker failed"))?;
        write(&out.join(PROPOSALS), &proposals)
    })
}

/// A video in which nothing can be followed is shown all the same.
fn proposals(video: &SourceVideo) -> Proposals {
    let options = TrackingOptions { objects: MOST_MOVERS, ..TrackingOptions::default() };
    match track(video, &options) {
        Ok(followed) => propose(&followed, (video.width, video.height)),
        Err(error) => Proposals::none(format!("{error:#}")),
    }
}

fn pictures(frames: &mut dyn FrameReader, facts: &VideoFacts, numbers: Range<usize>, out: &Path) -> Result<()> {
    for number in numbers {
        let frame = frames.frame(number)?;
        write_picture(&out.join(format!("{number}.jpg")), &frame, SIDE)?;
        if number % facts.strip_step == 0 {
            write_picture(&out.join(format!("small-{number}.jpg")), &frame, SMALL_SIDE)?;
        }
        if number % NOTED == 0 || number + 1 == facts.shown {
            write(&out.join(PROGRESS), &PreviewProgress { pictures: number + 1 })?;
        }
    }
    Ok(())
}

/// A picture of at most this side.
fn write_picture(path: &Path, frame: &RgbImage, side: u32) -> Result<()> {
    let (width, height) = frame.dimensions();
    let smaller = side < width.max(height);
    let resized = smaller.then(|| {
        let factor = f64::from(side) / f64::from(width.max(height));
        let [width, height] = [width, height].map(|it| ((f64::from(it) * factor).round() as u32).max(1));
        imageops::thumbnail(frame, width, height)
    });
    let mut bytes = Vec::new();
    let encoder = JpegEncoder::new_with_quality(&mut bytes, QUALITY);
    resized.as_ref().unwrap_or(frame).write_with_encoder(encoder)?;
    // Half a picture is never shown: the page asks for those that are noted as made.
    fs::write(path, bytes).with_context(|| format!("cannot write {}", path.display()))
}
