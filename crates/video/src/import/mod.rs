//! Filmed videos become a task: frames are chosen, cut out, scaled and cut into clips.
//!
//! A video is decoded frame by frame and never held as a whole; only the small frames that a model sees are. It is decoded
//! once, or twice where the crop is to be found from what moves. Of H.264 only the given parts are, each from the last frame
//! before it at which decoding can begin.

mod clips;
mod contact_sheet;
pub mod crop;
pub mod hold_out;
pub mod motion;
pub(crate) mod names;
mod reel;
pub mod request;
mod scaling;
pub mod sources;
pub mod stated;
mod task_file;
pub mod time_base;
pub mod tracker;
mod warnings;

use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use self::contact_sheet::write_contact_sheet;
use self::crop::Square;
use self::hold_out::{Cut, HoldOut};
use self::motion::MovingArea;
use self::names::{SHEET, TASK, TEST, TRAIN};
use self::reel::{Reel, VideoTake};
use self::request::{FolderState, ImportRequest};
use self::time_base::Kept;
use paig::Error;
use paig::datasets::film::FILM;
use paig::network::System;
use paig::network::cells::Equations;
use paig::network::system::SystemTable;
use paig::runs::metrics;
use paig::support::atomic;
use paig::support::guard::ensure_no_run;
use paig::support::output::FileSet;

/// Most frames that are kept of all videos.
const MOST_KEPT: usize = 50_000;
/// Most training clips, and bytes of them, that are cut without being asked for: neighbouring ones hardly differ.
const MOST_TRAINING_CLIPS: usize = 2000;
const MOST_TRAINING_BYTES: usize = 1 << 29;

/// What was made.
#[derive(Debug, Clone, PartialEq)]
pub struct Imported {
    pub task_file: PathBuf,
    pub takes: Vec<ImportedTake>,
    pub square: Square,
    pub metres_per_pixel: Option<f64>,
    pub cut: Cut,
    /// Seconds between two frames.
    pub interval: f64,
    /// Clips for training, validation and test.
    pub clips: [usize; 3],
    /// What a person should look at before training.
    pub warnings: Vec<String>,
}

/// What was used of one take.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportedTake {
    pub name: String,
    pub width: u32,
    pub height: u32,
    /// Frames of the video, and of them those that were kept.
    pub frames: usize,
    pub kept: Kept,
}

/// The files of an imported task.
const FILES: FileSet = FileSet {
    name: "a task of `paig import`",
    files: &[TRAIN, TEST, FILM, SHEET, TASK],
    recognizes: |text| {
        let lines = || text.split(|byte| *byte == b'\n');
        lines().any(|line| line.starts_with(task_file::MADE_BY.as_bytes()) || line.starts_with(b"[video]"))
    },
};

/// Whether an import writes a file of this name.
fn is_written(name: &OsStr) -> bool {
    FILES.files.iter().any(|file| name == *file)
}

/// Refuses to write over a video, or a picture among those of one.
fn spare_videos(request: &ImportRequest) -> Result<()> {
    let real = |path: &Path| path.canonicalize().ok();
    let written: Vec<_> = FILES.files.iter().filter_map(|name| real(&request.out.join(name))).collect();
    for video in &request.videos {
        let Some(there) = real(video) else { continue };
        ensure!(
            !written.contains(&there) && real(&request.out) != Some(there),
            "{} would be written over; choose another --out",
            video.display()
        );
    }
    Ok(())
}

/// Told how far an import is: frames decoded, of all.
pub type ImportProgress<'a> = &'a dyn Fn(usize, usize);

/// Makes `train.npz`, `test.npz`, `film.npz`, `task.toml` and `contact-sheet.png` in the folder `request.out`.
///
/// # Errors
/// A video that cannot be read, a crop or a part outside of it, nothing that moves, too few frames, a folder that holds
/// something already, a system that cannot be. Nothing is written then.
pub fn import(request: &ImportRequest, progress: ImportProgress) -> Result<Imported, Error> {
    Ok(imported(request, progress)?)
}

fn imported(request: &ImportRequest, progress: ImportProgress) -> Result<Imported> {
    ensure!(!request.videos.is_empty(), "no video given");
    ensure!(request.fps.is_none_or(|fps| fps.is_finite() && fps > 0.0), "--fps: must be a positive number");
    let (place, name) = (request.place()?, request.task_name()?);
    ensure_no_run(&request.out)?;
    check_system(request)?;
    if place == FolderState::Replaced {
        spare_videos(request)?;
        FILES.check(&request.out)?;
    }
    let mut reel = Reel::open(request, request.clip_frames.unwrap_or(request.least_frames()))?;
    let doubtful = reel.videos().map(|video| request.stated().check(video)).collect::<Result<Vec<_>>>()?.concat();
    let parts = |reel: &Reel| reel.takes.iter().map(|take| take.parts.clone()).collect::<Vec<_>>();
    let cut = cut(request, &parts(&reel));
    // Where too little is left, that may be why.
    let cut = if reel.left_out.is_empty() { cut } else { cut.with_context(|| reel.left_out.join("; ")) }?;
    reel.leave_out_short(cut.train_frames);
    let parts = parts(&reel);
    // Of the takes that are left, as what is written down of the videos: each has a clock of its own.
    let dt = reel.dt(request)?;
    let square = reel.square(request, progress)?;
    let record = reel.record(request, square);
    let text = task_file::text(request, &name, dt, &cut, &record)?;
    let (film, sheet) = reel.decode(request, square, progress)?;
    let ratio = reel.film_ratio(request);
    let filmed: Vec<Vec<_>> = film.iter().map(|frames| frames.iter().step_by(ratio).cloned().collect()).collect();
    let moving: Vec<_> = filmed.iter().map(|frames| MovingArea::measure(frames)).collect();
    ensure!(
        moving.iter().any(MovingArea::any),
        "nothing moves in the frames as a model sees them; look at another part of the video (--frames) or of the frames \
         (--crop), or raise --side"
    );
    let takes: Vec<_> = filmed.iter().map(Vec::as_slice).zip(&parts).collect();
    let (train, test) = clips::files(request, &takes, &cut, dt)?;
    let film = clips::film(request, &film, reel.film_numbers())?;
    let counts = [&train.train, &train.valid, &test.test].map(|clips| clips.dim().0);
    let fill = |folder: &Path| {
        train.write(&folder.join(TRAIN))?;
        test.write(&folder.join(TEST))?;
        film.write(&folder.join(FILM))?;
        write_contact_sheet(&folder.join(SHEET), &sheet)?;
        // The last one: a folder with a task is complete.
        atomic::write_file(&folder.join(TASK), |file| Ok(file.write_all(text.as_bytes())?))
    };
    match place {
        FolderState::New => atomic::write_folder(&request.out, fill)?,
        FolderState::Empty => fill(&request.out)?,
        FolderState::Replaced => atomic::replace_folder(&request.out, &is_written, fill)?,
    }
    let used = reel.takes.iter().map(|VideoTake { video, kept, .. }| ImportedTake {
        name: video.name(),
        width: video.width,
        height: video.height,
        frames: video.frames,
        kept: kept.clone(),
    });
    let found = warnings::of(request, &reel, square, &cut, &moving, counts);
    let warnings = each_once([doubtful, reel.left_out.clone(), found].concat());
    Ok(Imported {
        task_file: request.out.join(TASK),
        takes: used.collect(),
        square,
        metres_per_pixel: record.metres_per_pixel(request.side),
        cut,
        interval: record.frame_seconds,
        clips: counts,
        warnings,
    })
}

/// Lines in their order without those that repeat an earlier one.
pub(crate) fn each_once(lines: Vec<String>) -> Vec<String> {
    let mut once: Vec<String> = Vec::new();
    lines.into_iter().for_each(|line| once.extend((!once.contains(&line)).then_some(line)));
    once
}

/// Refuses a system that cannot be before a video is opened.
fn check_system(request: &ImportRequest) -> Result<System> {
    let kind = request.kind()?;
    metrics::check_parameters(&kind.parameters).context("the equation")?;
    let table = SystemTable {
        side: request.side,
        channels: request.channels(),
        objects: request.objects.or(kind.objects).unwrap_or(1),
        input_steps: request.input_steps,
        pred_steps: request.pred_steps,
        dt: 1.0,
        equation: request.equation.clone(),
        wall_margin: None,
    };
    table.system(0.0, &Equations::default())
}

/// How long clips are and how they overlap.
fn cut(request: &ImportRequest, parts: &[HoldOut]) -> Result<Cut> {
    let least = request.least_frames();
    let clip_bytes = request.frame_bytes().saturating_mul(request.clip_frames.unwrap_or(least).max(least));
    let most = MOST_TRAINING_CLIPS.min(MOST_TRAINING_BYTES / clip_bytes);
    Cut::choose(parts, least, request.clip_frames, request.overlap, most)
}
