//! Measures videos, or what a run learned from videos. See `paig measure --help`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use paig::support::{atomic, device};
use paig::tasks::equation_file::EquationFile;
use paig_terminal::progress::PhaseProgress;
use paig_terminal::say;
use paig_video::import::crop::CropRectangle;
use paig_video::measure::results::Measurement;
use paig_video::measure::{MeasureRequest, VideoRequest, is_run, measure, measure_videos};

use super::camera_options::CameraOptions;
use super::scene_options::{SceneOptions, rectangle};
use super::track_options::TrackOptions;
use crate::measure_display::print_measurement;

/// Measures the physical parameters of what moves in a video, with 95 % intervals and a verdict.
///
/// Of videos: tracks the objects at the video's own resolution, takes the parts in which they move freely (or --frames),
/// fits the equation to every frame as one long trajectory, predicts the last quarter to judge the fit, and quotes the
/// parameters of the fit to all frames. Seconds, no training.
///
/// Of a run folder: the same with what the run has learned, held against the model's own positions. `paig train` does this at
/// the end of a run on a task that `paig import` made.
///
/// Writes measurement.json, measurement.html, measurement-positions.png, positions.csv and overlay.gif.
#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:\n  paig measure throw.mp4\n  \
                  paig measure swing.mov --equation damped_pendulum --scale 12,40,12,300,0.5\n  \
                  paig measure bounce.mp4 --equation bounce_on_a_floor --frames 31..160 --at 40:210,95\n  \
                  paig measure runs/my-scene/fast/seed=0 --against configs/gallery/free_pendulum.toml"
)]
pub struct MeasureArguments {
    /// Videos of one motion, or one run folder
    #[arg(required = true, value_name = "VIDEO or RUN")]
    paths: Vec<PathBuf>,
    /// The equation: its name (built in, or of configs/gallery), a file (.toml) with [system.equation] as in a task, or auto:
    /// the one that explains the motion best [default: auto, or the run's own]
    #[arg(long, value_name = "NAME or FILE")]
    equation: Option<String>,
    /// File with an equation to be compared with; may be repeated
    #[arg(long, value_name = "FILE")]
    against: Vec<PathBuf>,
    /// Things that move [default: 1, or as the equation has it]
    #[arg(long, value_name = "N", help_heading = "Videos")]
    objects: Option<usize>,
    /// Frame of the equation, X,Y,WIDTH,HEIGHT in pixels of the video: angles are about its middle, walls stand at its
    /// edges [default: the whole picture]
    #[arg(long, value_name = "RECTANGLE", help_heading = "Videos")]
    crop: Option<String>,
    /// The parts and videos are takes of the same thing: each is measured alone, too, and their scatter is part of the intervals
    #[arg(long, help_heading = "Videos")]
    takes: bool,
    #[command(flatten)]
    scene: SceneOptions,
    #[command(flatten)]
    camera: CameraOptions,
    #[command(flatten)]
    objects_shown: TrackOptions,
    /// Folder for the files [default: the run's, or one beside you named after the video]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// cpu, cuda or cuda:n; for a run
    #[arg(long, default_value = "cpu")]
    device: String,
    /// Threads to compute with; 0 for one a core
    #[arg(long, default_value_t = 0)]
    threads: usize,
}

/// In place of an equation's name: chosen.
const AUTO: &str = "auto";

pub fn run(arguments: &MeasureArguments) -> Result<()> {
    let device = device::parse(&arguments.device)?;
    device::set_threads(arguments.threads)?;
    let against = arguments.against.iter().map(|path| EquationFile::read(path)).collect::<Result<Vec<_>>>()?;
    let (measurement, out) = if is_run(&arguments.paths[0]) {
        ensure!(
            arguments.paths.len() == 1,
            "one run folder is measured at a time; {} are given",
            arguments.paths.len()
        );
        let equation = given_equation(arguments)?;
        let out = arguments.out.as_ref().unwrap_or(&arguments.paths[0]);
        (measure(&arguments.paths[0], &MeasureRequest { equation, against }, out, device)?, out.clone())
    } else {
        of_videos(arguments, &against)?
    };
    print_measurement(&measurement);
    say!("look at {}", out.join("measurement.html").display());
    Ok(())
}

fn of_videos(arguments: &MeasureArguments, against: &[EquationFile]) -> Result<(Measurement, PathBuf)> {
    let scene = arguments.scene.read()?;
    let (hints, ignore) = arguments.objects_shown.read()?;
    let request = VideoRequest {
        videos: arguments.paths.clone(),
        parts: scene.parts,
        filming: arguments.camera.read(scene.fps)?,
        crop: arguments.crop.as_deref().map(crop).transpose()?,
        pixels_per_metre: scene.pixels_per_metre,
        scale_percent: scene.scale_percent,
        time_percent: scene.time_percent,
        origin: scene.origin,
        angle: scene.angle,
        y_up: scene.y_up,
        scale_points: scene.scale_points,
        tracker: scene.tracker,
        equation: given_equation(arguments)?,
        objects: arguments.objects,
        hints,
        ignore,
        takes: arguments.takes,
    };
    let out = arguments.out.clone().unwrap_or_else(|| named_after(&arguments.paths[0]));
    let waiting = PhaseProgress::busy("tracking and fitting");
    let measured = measure_videos(&request, against, &out);
    waiting.finish();
    Ok((measured?, out))
}

fn crop(text: &str) -> Result<CropRectangle> {
    rectangle(text).with_context(|| format!("--crop {text:?}: expected X,Y,WIDTH,HEIGHT in whole pixels"))
}

/// A folder in the present one.
fn named_after(video: &Path) -> PathBuf {
    let stem = video.file_stem().unwrap_or(video.as_os_str());
    PathBuf::from(atomic::named_after(stem, "-measurement", 0))
}

/// None where it is to be chosen, or is a run's own.
fn given_equation(arguments: &MeasureArguments) -> Result<Option<EquationFile>> {
    arguments.equation.as_deref().filter(|name| *name != AUTO).map(equation).transpose()
}

/// An equation by its name or from a file.
pub(super) fn equation(named: &str) -> Result<EquationFile> {
    if named.ends_with(".toml") {
        return EquationFile::read(Path::new(named));
    }
    EquationFile::named(named)
}
