//! Filmed videos: import, tracks, measurements.

use std::path::PathBuf;

use anyhow::Result;
use paig::network::system::EquationEntry;
use paig::support::device;
use paig::tasks::equation_file::EquationFile;
use paig_track::{HALF_PIXEL, Hint, Region, TrackingOptions};
use paig_video::import::crop::{CropChoice, CropRectangle};
use paig_video::import::request::ImportRequest;
use paig_video::import::sources::SourceVideo;
use paig_video::import::time_base::VideoPart;
use paig_video::measure as measuring;
use pyo3::prelude::*;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::attend::attended;

/// The arguments of `paig.import_video`; what is left out is as in the program.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Import {
    videos: Vec<PathBuf>,
    out: PathBuf,
    force: bool,
    name: Option<String>,
    frames: Option<Vec<(usize, Option<usize>)>>,
    seconds: Option<(f64, Option<f64>)>,
    step: usize,
    fps: Option<f64>,
    /// `auto` where none is given.
    crop: Option<Crop>,
    side: usize,
    grey: bool,
    pixels_per_metre: Option<f64>,
    scale_percent: f64,
    time_percent: f64,
    origin: Option<[f64; 2]>,
    angle: f64,
    y_up: bool,
    time_unit: String,
    equation: EquationEntry,
    objects: Option<usize>,
    input_steps: usize,
    pred_steps: usize,
    clip_frames: Option<usize>,
    overlap: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "lowercase")]
enum Crop {
    Full,
    #[serde(untagged)]
    Rectangle([u32; 4]),
}

impl Import {
    fn request(self) -> ImportRequest {
        let parts = match (self.frames, self.seconds) {
            (Some(frames), _) => frames.into_iter().map(|(start, end)| VideoPart::Frames(start, end)).collect(),
            (None, Some((start, end))) => vec![VideoPart::Seconds(start, end)],
            (None, None) => vec![VideoPart::All],
        };
        let crop = match self.crop {
            None => CropChoice::Auto,
            Some(Crop::Full) => CropChoice::Full,
            Some(Crop::Rectangle([x, y, width, height])) => {
                CropChoice::Rectangle(CropRectangle { x, y, width, height })
            }
        };
        ImportRequest {
            force: self.force,
            name: self.name,
            parts,
            step: self.step,
            fps: self.fps,
            crop,
            side: self.side,
            grey: self.grey,
            pixels_per_metre: self.pixels_per_metre,
            scale_percent: self.scale_percent,
            time_percent: self.time_percent,
            origin: self.origin,
            angle: self.angle,
            y_up: self.y_up,
            time_unit: self.time_unit,
            equation: self.equation,
            objects: self.objects,
            input_steps: self.input_steps,
            pred_steps: self.pred_steps,
            clip_frames: self.clip_frames,
            overlap: self.overlap,
            ..ImportRequest::of(self.videos, self.out)
        }
    }
}

/// Makes a task from videos. Returns what was made.
#[pyfunction]
#[pyo3(signature = (request, listener = None))]
pub fn import_video(py: Python, request: &str, listener: Option<&Bound<PyAny>>) -> PyResult<String> {
    attended(py, listener, |reporter| {
        let request = serde_json::from_str::<Import>(request)?.request();
        let made = paig_video::import::import(&request, &|done, total| {
            reporter.leave_if_stopped();
            reporter.tell(json!({"event": "frames", "step": done, "of": total}));
        })?;
        let take = |take: &paig_video::import::ImportedTake| {
            json!({
                "name": take.name, "width": take.width, "height": take.height, "frames": take.frames,
                "kept": take.kept.frames.len(), "first_seconds": take.kept.first_seconds,
            })
        };
        let square = made.square;
        Ok(json!({
            "task_file": made.task_file, "takes": made.takes.iter().map(take).collect::<Vec<_>>(),
            "crop": [square.x, square.y, i64::from(square.side)], "metres_per_pixel": made.metres_per_pixel,
            "interval": made.interval, "clips": made.clips, "warnings": made.warnings,
        })
        .to_string())
    })
}

/// The arguments of `paig.track`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TrackKeywords {
    video: PathBuf,
    objects: usize,
    frames: Option<(usize, Option<usize>)>,
    /// Frame, x, y.
    at: Vec<(usize, f64, f64)>,
    /// Left, top, width, height.
    ignore: Vec<[usize; 4]>,
}

impl TrackKeywords {
    fn options(&self, frames: usize) -> TrackingOptions {
        let hint = |&(frame, x, y): &(usize, f64, f64)| Hint { frame, position: [x - HALF_PIXEL, y - HALF_PIXEL] };
        let region = |&[x, y, width, height]: &[usize; 4]| Region {
            first: [x, y],
            last: [x + width.saturating_sub(1), y + height.saturating_sub(1)],
        };
        TrackingOptions {
            frames: self.frames.map(|(start, end)| start..end.unwrap_or(frames)),
            objects: self.objects,
            hints: self.at.iter().map(hint).collect(),
            ignore: self.ignore.iter().map(region).collect(),
            ..TrackingOptions::default()
        }
    }
}

/// Follows objects through a video. Returns `{"width": .., "height": .., "times": .., "tracks": ..}`; positions count from the
/// video's top left corner.
#[pyfunction]
pub fn track(py: Python, request: &str) -> PyResult<String> {
    attended(py, None, |_| {
        let given: TrackKeywords = serde_json::from_str(request)?;
        let video = SourceVideo::open(&given.video)?;
        let tracking = paig_video::track::track(&video, &given.options(video.frames))?.tracking;
        let track = |track: &paig_track::Track| -> Result<Value> {
            let mut value = serde_json::to_value(track)?;
            let points = value["points"].as_array_mut().into_iter().flatten();
            for (point, from) in points.zip(&track.points) {
                if let Some(measurement) = from.measurement {
                    point["measurement"]["position"] = json!(measurement.position.map(|place| place + HALF_PIXEL));
                }
            }
            Ok(value)
        };
        let tracks = tracking.tracks.iter().map(track).collect::<Result<Vec<_>>>()?;
        let times = video.times.as_deref();
        Ok(json!({"width": video.width, "height": video.height, "times": times, "tracks": tracks}).to_string())
    })
}

/// The arguments of `Run.measure`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MeasureKeywords {
    run: PathBuf,
    out: Option<PathBuf>,
    equation: Option<LabelledEquation>,
    against: Vec<LabelledEquation>,
    device: String,
    threads: usize,
}

/// An equation with a name for people.
#[derive(Deserialize)]
struct LabelledEquation {
    name: String,
    equation: EquationEntry,
}

impl From<LabelledEquation> for EquationFile {
    fn from(LabelledEquation { name, equation }: LabelledEquation) -> Self {
        EquationFile { name, summary: String::new(), equation, objects: None, side: None, dt: None }
    }
}

/// Measures a run's videos. Returns `measurement.json`.
#[pyfunction]
pub fn measure(py: Python, request: &str) -> PyResult<String> {
    attended(py, None, |_| {
        let given: MeasureKeywords = serde_json::from_str(request)?;
        let device = device::parse(&given.device)?;
        device::set_threads(given.threads)?;
        let request = measuring::MeasureRequest {
            equation: given.equation.map(Into::into),
            against: given.against.into_iter().map(Into::into).collect(),
        };
        let out = given.out.as_ref().unwrap_or(&given.run);
        Ok(serde_json::to_string(&measuring::measure(&given.run, &request, out, device)?)?)
    })
}
