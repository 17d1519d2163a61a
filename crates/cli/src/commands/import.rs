//! Makes a task from videos. See `paig import --help`.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use paig::network::system::EquationEntry;
use paig::support::significant::significant;
use paig::tasks::equation_file::EquationFile;
use paig_terminal::progress::Progress;
use paig_terminal::say;
use paig_video::import::crop::{CropChoice, Rectangle};
use paig_video::import::request::Request;
use paig_video::import::time_base::{Clock, Part};
use paig_video::import::tracker::TrackerFile;
use paig_video::import::{Imported, import};

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
                  import clip.mov --out swing --side 64 --equation configs/gallery/damped_pendulum.toml"
)]
pub struct Arguments {
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
    /// Only these frames of each video, counted from 0, without the last: 118..202, or 118.. to the end. Several throws
    /// are several parts: 30..62,120..155
    #[arg(long, value_name = "START..END", help_heading = "Frames", conflicts_with = "seconds")]
    frames: Option<String>,
    /// The same in seconds from the first frame, as a player shows them: 1.5..9
    #[arg(long, value_name = "START..END", help_heading = "Frames")]
    seconds: Option<String>,
    /// Keep every n-th frame
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Frames")]
    step: usize,
    /// Frames a second as it was filmed, where the file says something else (slow motion) or nothing (pictures, arrays)
    #[arg(long, help_heading = "Frames")]
    fps: Option<f64>,
    /// What is cut out: auto (around what moves), full, or X,Y,WIDTH,HEIGHT in pixels of the upright video. The shorter
    /// side grows to a square; where that sticks out of the video it is black
    #[arg(long, default_value = "auto", value_name = "SQUARE", help_heading = "Picture")]
    crop: String,
    /// Side of the frames that the model sees, pixels: 12 to 512, a multiple of 4, from 40 on of 8
    #[arg(long, default_value_t = 32, help_heading = "Picture")]
    side: usize,
    /// Frames with one channel
    #[arg(long, help_heading = "Picture", overrides_with = "colour")]
    grey: bool,
    /// Frames with three channels (default)
    #[arg(long, help_heading = "Picture")]
    colour: bool,
    /// Pixels of the video to a metre
    #[arg(long, value_name = "F", help_heading = "Scale and axes", conflicts_with = "scale")]
    pixels_per_metre: Option<f64>,
    /// The same from two points in the video and their distance in metres
    #[arg(long, value_name = "X1,Y1,X2,Y2,LENGTH", allow_hyphen_values = true, help_heading = "Scale and axes")]
    scale: Option<String>,
    /// How well the scale is known: its standard deviation, per cent
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, help_heading = "Scale and axes")]
    scale_percent: f64,
    /// How well the time between two frames is known: its standard deviation, per cent
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, help_heading = "Frames")]
    time_percent: f64,
    /// Origin of the scene's axes, pixels of the video, from its top left corner [default: that corner]
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true, help_heading = "Scale and axes")]
    origin: Option<String>,
    /// Angle of the x axis, degrees, counter-clockwise [default: 0]
    #[arg(long, value_name = "DEG", help_heading = "Scale and axes")]
    angle: Option<f64>,
    /// The y axis points up
    #[arg(long, help_heading = "Scale and axes")]
    y_up: bool,
    /// File of the program Tracker (.trk, .trz): its scale, axes and time between frames are taken where no option says
    /// them
    #[arg(long, value_name = "FILE", help_heading = "Scale and axes")]
    tracker: Option<PathBuf>,
    /// The equation that the objects obey: its name, or a file (.toml) whose [system.equation] is taken, such as one of
    /// configs/gallery; it can be changed in the new task file
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

pub fn run(arguments: Arguments) -> Result<()> {
    let request = request(arguments)?;
    let bar: RefCell<Option<Progress>> = RefCell::default();
    let imported = import(&request, &|done, total| {
        let mut bar = bar.borrow_mut();
        if done == 1 {
            *bar = Some(Progress::new("frames", total as u64, 0));
        }
        bar.iter().for_each(|bar| bar.step(String::new));
        if done == total {
            bar.take().iter().for_each(Progress::finish);
        }
    })?;
    summarize(&request, &imported);
    Ok(())
}

/// An equation by its name or from a file, and how many objects that file speaks of.
fn equation(named: String) -> Result<(EquationEntry, Option<usize>)> {
    if !named.ends_with(".toml") {
        return Ok((EquationEntry::Name(named), None));
    }
    let file = EquationFile::read(Path::new(&named))?;
    Ok((file.equation, file.objects))
}

fn request(arguments: Arguments) -> Result<Request> {
    let tracker = arguments.tracker.as_deref().map(TrackerFile::read).transpose()?;
    let of_points = arguments.scale.as_deref().map(|text| {
        let [x1, y1, x2, y2, length] = numbers("scale", text)?;
        let distance = (x2 - x1).hypot(y2 - y1);
        ensure!(distance > 0.0 && length > 0.0, "--scale: the points must differ, and the length must be positive");
        Ok::<_, anyhow::Error>(distance / length)
    });
    let pixels_per_metre = of_points.transpose()?.or(arguments.pixels_per_metre);
    let (equation, of_file) = equation(arguments.equation)?;
    let objects = arguments.objects.or(of_file);
    let origin = arguments.origin.as_deref().map(|text| numbers("origin", text)).transpose()?;
    Ok(Request {
        videos: arguments.videos,
        out: arguments.out,
        force: arguments.force,
        name: arguments.name,
        parts: parts(arguments.frames.as_deref(), arguments.seconds.as_deref())?,
        step: arguments.step,
        fps: arguments.fps.or(tracker.and_then(|file| file.fps)),
        crop: crop(&arguments.crop)?,
        side: arguments.side,
        grey: arguments.grey,
        pixels_per_metre: pixels_per_metre.or(tracker.map(|file| file.pixels_per_metre)),
        scale_percent: arguments.scale_percent,
        time_percent: arguments.time_percent,
        origin: origin.or(tracker.map(|file| file.origin)),
        angle: arguments.angle.or(tracker.map(|file| file.angle)).unwrap_or(0.0),
        y_up: arguments.y_up || tracker.is_some(),
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
            let numbers = text.split(',').map(|number| number.trim().parse().ok()).collect::<Option<Vec<u32>>>();
            let [x, y, width, height] = numbers.with_context(wrong)?[..] else { bail!(wrong()) };
            CropChoice::Rectangle(Rectangle { x, y, width, height })
        }
    })
}

/// So many numbers with commas between them.
fn numbers<const N: usize>(option: &str, text: &str) -> Result<[f64; N]> {
    let finite = |number: &str| number.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    let numbers = text.split(',').map(finite).collect::<Option<Vec<f64>>>();
    let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
    numbers.with_context(|| format!("--{option} {text:?}: expected {N} numbers with commas between them"))
}

/// The parts of a video, with commas between them.
fn parts(frames: Option<&str>, seconds: Option<&str>) -> Result<Vec<Part>> {
    fn bounds<T: FromStr>(option: &str, text: &str) -> Result<(Option<T>, Option<T>)> {
        let wrong = || format!("--{option} {text:?}: expected START..END, START.. or ..END");
        let (start, end) = text.split_once("..").with_context(wrong)?;
        let bound = |text: &str| match text.trim() {
            "" => Ok(None),
            text => text.parse().ok().map(Some).with_context(wrong),
        };
        Ok((bound(start)?, bound(end)?))
    }
    let by_frames = |text: &str| {
        let (start, end) = bounds("frames", text)?;
        Ok(Part::Frames(start.unwrap_or(0), end))
    };
    let by_seconds = |text: &str| {
        let (start, end) = bounds::<f64>("seconds", text)?;
        let finite = start.is_none_or(f64::is_finite) && end.is_none_or(f64::is_finite);
        ensure!(finite, "--seconds {text:?}: not finite");
        Ok(Part::Seconds(start.unwrap_or(0.0), end))
    };
    match (frames, seconds) {
        (Some(text), _) => text.split(',').map(by_frames).collect(),
        (None, Some(text)) => text.split(',').map(by_seconds).collect(),
        (None, None) => Ok(vec![Part::All]),
    }
}

fn summarize(request: &Request, imported: &Imported) {
    for take in &imported.takes {
        let kept = &take.kept;
        let rate = request.step as f64 / kept.interval;
        let clock = match kept.clock {
            Clock::Given => ", as given",
            Clock::Regular => "",
            Clock::Resampled { .. } => " on average, varying",
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
