//! What people say of filmed videos: which frames, when these were filmed, scale and axes.

use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Context, Result, ensure};
use clap::Args;
use paig_video::import::crop::CropRectangle;
use paig_video::import::time_base::VideoPart;
use paig_video::import::tracker::TrackerFile;

/// Options of commands that read videos.
#[derive(Debug, Args)]
pub struct SceneOptions {
    /// Only these frames of each video, counted from 0, without the last: 118..202, or 118.. to the end. Several throws
    /// are several parts: 30..62,120..155
    #[arg(long, value_name = "START..END", help_heading = "Frames", conflicts_with = "seconds")]
    frames: Option<String>,
    /// The same in seconds from the first frame, as a player shows them: 1.5..9
    #[arg(long, value_name = "START..END", help_heading = "Frames")]
    seconds: Option<String>,
    /// Frames a second as it was filmed, where the file says something else (slow motion) or nothing (pictures, arrays)
    #[arg(long, help_heading = "Frames")]
    fps: Option<f64>,
    /// How well the time between two frames is known: its standard deviation, per cent
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, help_heading = "Frames")]
    time_percent: f64,
    /// Pixels of the video to a metre
    #[arg(long, value_name = "F", help_heading = "Scale and axes", conflicts_with = "scale")]
    pixels_per_metre: Option<f64>,
    /// The same from two points in the video and their distance in metres
    #[arg(long, value_name = "X1,Y1,X2,Y2,LENGTH", allow_hyphen_values = true, help_heading = "Scale and axes")]
    scale: Option<String>,
    /// How well the scale is known: its standard deviation, per cent
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, help_heading = "Scale and axes")]
    scale_percent: f64,
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
}

/// The same, read.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneFacts {
    pub parts: Vec<VideoPart>,
    pub fps: Option<f64>,
    pub time_percent: f64,
    pub pixels_per_metre: Option<f64>,
    pub scale_percent: f64,
    pub origin: Option<[f64; 2]>,
    pub angle: f64,
    pub y_up: bool,
    pub scale_points: Option<[[f64; 2]; 2]>,
    pub tracker: Option<TrackerFile>,
}

impl SceneOptions {
    /// # Errors
    /// Text that is not of the form that its option's help gives, a Tracker file that cannot be read.
    pub fn read(&self) -> Result<SceneFacts> {
        let tracker = self.tracker.as_deref().map(TrackerFile::read).transpose()?;
        let of_points = self.scale.as_deref().map(|text| {
            let [x1, y1, x2, y2, length] = numbers("scale", text)?;
            let distance = (x2 - x1).hypot(y2 - y1);
            ensure!(distance > 0.0 && length > 0.0, "--scale: the points must differ, and the length must be positive");
            Ok::<_, anyhow::Error>((distance / length, [[x1, y1], [x2, y2]]))
        });
        let of_points = of_points.transpose()?;
        let pixels_per_metre = of_points.map(|(scale, _)| scale).or(self.pixels_per_metre);
        let origin = self.origin.as_deref().map(|text| numbers("origin", text)).transpose()?;
        Ok(SceneFacts {
            parts: parts(self.frames.as_deref(), self.seconds.as_deref())?,
            fps: self.fps.or(tracker.and_then(|file| file.fps)),
            time_percent: self.time_percent,
            pixels_per_metre: pixels_per_metre.or(tracker.map(|file| file.pixels_per_metre)),
            scale_percent: self.scale_percent,
            origin: origin.or(tracker.map(|file| file.origin)),
            angle: self.angle.or(tracker.map(|file| file.angle)).unwrap_or(0.0),
            y_up: self.y_up || tracker.is_some(),
            scale_points: of_points.map(|(_, points)| points),
            tracker,
        })
    }
}

/// A rectangle of a video, `X,Y,WIDTH,HEIGHT` in whole pixels; none of text that is none.
pub fn rectangle(text: &str) -> Option<CropRectangle> {
    let numbers = text.split(',').map(|number| number.trim().parse().ok()).collect::<Option<Vec<u32>>>()?;
    let [x, y, width, height] = numbers[..] else { return None };
    Some(CropRectangle { x, y, width, height })
}

/// So many numbers with commas between them.
fn numbers<const N: usize>(option: &str, text: &str) -> Result<[f64; N]> {
    let finite = |number: &str| number.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    let numbers = text.split(',').map(finite).collect::<Option<Vec<f64>>>();
    let numbers = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok());
    numbers.with_context(|| format!("--{option} {text:?}: expected {N} numbers with commas between them"))
}

/// The parts of a video, with commas between them.
fn parts(frames: Option<&str>, seconds: Option<&str>) -> Result<Vec<VideoPart>> {
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
        Ok(VideoPart::Frames(start.unwrap_or(0), end))
    };
    let by_seconds = |text: &str| {
        let (start, end) = bounds::<f64>("seconds", text)?;
        let finite = start.is_none_or(f64::is_finite) && end.is_none_or(f64::is_finite);
        ensure!(finite, "--seconds {text:?}: not finite");
        Ok(VideoPart::Seconds(start.unwrap_or(0.0), end))
    };
    let (option, text, parts): (_, _, Vec<VideoPart>) = match (frames, seconds) {
        (Some(text), _) => ("frames", text, text.split(',').map(by_frames).collect::<Result<_>>()?),
        (None, Some(text)) => ("seconds", text, text.split(',').map(by_seconds).collect::<Result<_>>()?),
        (None, None) => return Ok(vec![VideoPart::All]),
    };
    let mut bounds: Vec<[f64; 2]> = parts.iter().filter_map(bounds_of).collect();
    bounds.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let apart = bounds.windows(2).all(|pair| pair[0][1] <= pair[1][0]);
    ensure!(apart, "--{option} {text:?}: parts overlap; each frame counts once");
    Ok(parts)
}

/// Where a part of a video begins and ends, frames or seconds.
fn bounds_of(part: &VideoPart) -> Option<[f64; 2]> {
    match *part {
        VideoPart::All => None,
        VideoPart::Frames(start, end) => Some([start as f64, end.map_or(f64::INFINITY, |end| end as f64)]),
        VideoPart::Seconds(start, end) => Some([start, end.unwrap_or(f64::INFINITY)]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_that_overlap_are_refused() {
        for apart in ["0..50", "0..50,50..90", "60..,0..50"] {
            assert!(parts(Some(apart), None).is_ok() && parts(None, Some(apart)).is_ok(), "{apart}");
        }
        for overlapping in ["0..50,10..40", "0..50,49..90", "..50,20..30", "60..,0..61"] {
            assert!(
                parts(Some(overlapping), None).is_err() && parts(None, Some(overlapping)).is_err(),
                "{overlapping}"
            );
        }
    }
}
