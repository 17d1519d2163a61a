//! Makes a task from videos. See `paig import --help`.

use std::cell::RefCell;
use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use paig::network::system::EquationEntry;
use paig::support::significant::significant;
use paig::tasks::equation_file::EquationFile;
use paig_terminal::progress::PhaseProgress;
use paig_terminal::say;
use paig_video::import::crop::CropChoice;
use paig_video::import::request::ImportRequest;
use paig_video::import::time_base::FrameSpacing;
use paig_video::import::{Imported, import};

use super::camera_options::SpeedOption;
use super::measure::equation;
use super::scene_options::{SceneOptions, rectangle};

/// Turns videos into a task: clips for training, validation and test, the task file, and a contact sheet that shows what
/// will be learned from.
///
/// Read are mp4 and mov (H.264; anything else with ffmpeg on the PATH), gif, a folder of png or jpeg, and npz (uint8,
/// [frames, height, width, 3] or [frames, height, width]). The first three quarters of each video become training clips,
/// the last quarter is held out for validation and test. Of four and more short throws the last quarter is held out.
#[derive(Debug, Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:\n  paig import clip.mp4 --out my-scene\n  paig train --task my-scene/task.toml\n\n  \
                  import drop.mp4 --out drop --frames 118..202 --fps 120 --crop 0,0,400,400 --grey\n  \
                  import swing.mov --out swing --step 3 --scale 12,40,12,300,0.5 --origin 120,300 --y-up\n  \
                  import a.mp4 b.mp4 --out both --tracker a.trk --equation spring\n  \
                  import clip.mov --out swing --side 64 --equation damped_pendulum"
)]
pub struct ImportArguments {
    /// Videos of one scene, all of one size; clips are cut from each
    #[arg(required = true)]
    videos: Vec<PathBuf>,
    /// Folder for the task and its files
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Name of the task [default: that of the folder]
    #[arg(long)]
    name: Option<String>,
    /// Replace the files of an --out that holds something already
    #[arg(long)]
    force: bool,
    /// Keep every n-th frame
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Frames")]
    step: usize,
    /// What is cut out: auto (around what moves), full, or X,Y,WIDTH,HEIGHT in pixels of the upright video. The shorter
    /// side grows to a square; where that sticks out of the video it is black
    #[arg(long, default_value = "auto", value_name = "SQUARE", help_heading = "Picture")]
    crop: String,
    /// Side of the frames that the model sees, pixels: 12 to 512, a multiple of 4, from 40 on of 8
    #[arg(long, default_value_t = 32, help_heading = "Picture")]
    side: usize,
    /// Frames with one channel
    #[arg(long, help_heading = "Picture", conflicts_with = "colour")]
    grey: bool,
    /// Frames with three channels (default)
    #[arg(long, help_heading = "Picture")]
    colour: bool,
    #[command(flatten)]
    scene: SceneOptions,
    #[command(flatten)]
    speed: SpeedOption,
    /// The equation that the objects obey: its name (built in, or of configs/gallery), or a file (.toml) whose
    /// [system.equation] is taken; it can be changed in the new task file
    #[arg(long, default_value = "falling", help_heading = "Task")]
    equation: String,
    /// Things that move [default: 1, or as the equation has it]
    #[arg(long, value_name = "N", help_heading = "Task")]
    objects: Option<usize>,
    /// Frames that the encoder sees before the roll-out
    #[arg(long, value_name = "L", default_value_t = 4, help_heading = "Task")]
    input_steps: usize,
    /// Predicted frames that are trained on
    #[arg(long, value_name = "T_PRED", default_value_t = 6, help_heading = "Task")]
    pred_steps: usize,
    /// Unit of dt, and so of time in all parameters: s, ms or frames
    #[arg(long, value_name = "UNIT", default_value = "s", value_parser = ["s", "ms", "frames"], help_heading = "Task")]
    dt_unit: String,
    /// Frames of a training clip [default: input and predicted frames and two more, where there is room]
    #[arg(long, value_name = "N", help_heading = "Task")]
    clip_frames: Option<usize>,
    /// Frames that a training clip shares with the next one [default: all but one, or fewer of a long video]
    #[arg(long, value_name = "N", help_heading = "Task")]
    overlap: Option<usize>,
}

pub fn run(arguments: ImportArguments) -> Result<()> {
    let request = request(arguments)?;
    let bar: RefCell<Option<PhaseProgress>> = RefCell::default();
    let imported = import(&request, &|done, total| {
        let mut bar = bar.borrow_mut();
        if done == 1 {
            *bar = Some(PhaseProgress::new("frames", total as u64, 0));
        }
        bar.iter().for_each(|bar| bar.step(String::new));
        if done == total {
            bar.take().iter().for_each(PhaseProgress::finish);
        }
    })?;
    summarize(&request, &imported);
    Ok(())
}

fn request(arguments: ImportArguments) -> Result<ImportRequest> {
    let scene = arguments.scene.read()?;
    let EquationFile { equation, objects: of_file, .. } = equation(&arguments.equation)?;
    let objects = arguments.objects.or(of_file);
    Ok(ImportRequest {
        videos: arguments.videos,
        out: arguments.out,
        force: arguments.force,
        name: arguments.name,
        parts: scene.parts,
        step: arguments.step,
        fps: scene.fps,
        slow_motion: arguments.speed.read(scene.fps)?,
        crop: crop(&arguments.crop)?,
        side: arguments.side,
        grey: arguments.grey,
        pixels_per_metre: scene.pixels_per_metre,
        scale_percent: scene.scale_percent,
        time_percent: scene.time_percent,
        origin: scene.origin,
        angle: scene.angle,
        y_up: scene.y_up,
        scale_points: scene.scale_points,
        tracker: scene.tracker,
        time_unit: arguments.dt_unit,
        equation,
        objects,
        input_steps: arguments.input_steps,
        pred_steps: arguments.pred_steps,
        clip_frames: arguments.clip_frames,
        overlap: arguments.overlap,
    })
}

fn crop(text: &str) -> Result<CropChoice> {
    Ok(match text {
        "auto" => CropChoice::Auto,
        "full" => CropChoice::Full,
        _ => {
            let wrong = || format!("--crop {text:?}: expected auto, full, or X,Y,WIDTH,HEIGHT in whole pixels");
            CropChoice::Rectangle(rectangle(text).with_context(wrong)?)
        }
    })
}

fn summarize(request: &ImportRequest, imported: &Imported) {
    for take in &imported.takes {
        let kept = &take.kept;
        let rate = request.step as f64 / kept.interval;
        let clock = match kept.clock {
            FrameSpacing::Given => ", as given",
            FrameSpacing::Regular => ", even",
            FrameSpacing::Resampled { .. } => ", put onto an even clock",
        };
        let (count, seconds) = (kept.frames.len(), kept.interval * kept.frames.len() as f64);
        say!(
            "{}: {} frames of {} x {}, {rate:.3} a second{clock}; kept {count} ({seconds:.2} s from {:.2} s on)",
            take.name,
            take.frames,
            take.width,
            take.height,
            kept.first_seconds
        );
    }
    let (square, side) = (imported.square, request.side);
    say!("crop {0} x {0} from ({1}, {2}) on, seen as {side} x {side}", square.side, square.x, square.y);
    match imported.metres_per_pixel {
        Some(metres) => say!("scale {} m to a pixel of a frame", significant(metres, 5)),
        None => say!(
            "scale not known: what is learned will be in pixels of a frame, what is measured in pixels of the video"
        ),
    }
    let [train, valid, test] = imported.clips;
    let (short, long) = (imported.cut.train_frames, imported.cut.test_frames);
    say!("clips: {train} for training and {valid} for validation of {short} frames, {test} for the test of {long}");
    let equation = match &request.equation {
        EquationEntry::Name(name) => name,
        EquationEntry::Text(_) => "as text in the task file",
    };
    say!("equation {equation}, {} s between frames", significant(imported.interval, 5));
    imported.warnings.iter().for_each(|warning| say!("warning: {warning}"));
    let folder = request.out.display();
    say!("look at {folder}/contact-sheet.png, then: paig train --task {}", imported.task_file.display());
}
