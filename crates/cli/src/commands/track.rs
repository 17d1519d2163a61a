//! Tracks the objects of a video. See `paig track --help`.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use clap::Args;
use paig::support::output::check_apart;
use paig_terminal::progress::PhaseProgress;
use paig_terminal::say;
use paig_track::TrackingOptions;
use paig_track::calibration::depth_line;
use paig_video::track::{Followed, PICTURE, TABLE, track, write_picture, write_table};

use super::camera_options::CameraOptions;
use super::track_options::TrackOptions;

/// Tracks the objects that move in a video, at its own resolution and without an equation: positions with standard deviations.
///
/// The camera may stand, tremble or turn with an object; one that travels past things at several depths is refused. Shadows,
/// hands and arms are told apart from objects and left out. Positions are pixels of the video from its top left corner, y
/// down; where the camera moves, those of its reference frame. What is found of the time base, and the pieces in which
/// objects move freely, are listed. With --plane the table has columns in metres, too, y up from the first corner.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  paig track clip.mp4\n  paig track clip.mp4 --objects 2 --frames 30..200 --out positions.csv\n  \
                  paig track clip.mp4 --at 12:340,220 --ignore 0,0,200,80"
)]
pub struct TrackArguments {
    /// The video
    video: PathBuf,
    /// Table of positions to write
    #[arg(long, value_name = "FILE", default_value = "positions.csv")]
    out: PathBuf,
    /// Picture of the paths over a frame to write, PNG
    #[arg(long, value_name = "FILE", default_value = "paths.png")]
    picture: PathBuf,
    /// Most objects
    #[arg(long, value_name = "N", default_value_t = 1)]
    objects: usize,
    /// Only these frames, counted from 0, without the last: 118..202
    #[arg(long, value_name = "START..END")]
    frames: Option<String>,
    #[command(flatten)]
    camera: CameraOptions,
    #[command(flatten)]
    objects_shown: TrackOptions,
}

pub fn run(arguments: &TrackArguments) -> Result<()> {
    ensure!(arguments.objects > 0, "--objects must be at least 1");
    let camera = arguments.camera.read(None)?;
    let out = TABLE.check(&arguments.out, &[&arguments.video])?;
    let picture = PICTURE.check(&arguments.picture, &[&arguments.video])?;
    check_apart(&[&out, &picture])?;
    let video = camera.open(&arguments.video)?;
    let (hints, ignore) = arguments.objects_shown.read()?;
    let calibration = camera.calibration(&video)?;
    let options = TrackingOptions {
        frames: arguments.frames.as_deref().map(|text| frames(text, video.frames)).transpose()?,
        objects: arguments.objects,
        slow_motion: camera.slow_motion,
        readout: camera.readout,
        hints,
        ignore,
        ..TrackingOptions::default()
    };
    let waiting = PhaseProgress::busy("tracking");
    let tracking = track(&video, &options);
    waiting.finish();
    let Followed { tracking, segments } = tracking?;
    video.remarks.iter().for_each(|remark| say!("warning: {remark}"));
    say!("camera: {}", tracking.camera.line());
    tracking.time.lines().iter().for_each(|line| say!("time: {line}"));
    say!("{:<8}{:>10}{:>12}{:>14}{:>14}{:>10}", "object", "frames", "diameter", "deviation x", "deviation y", "misfit");
    for (object, track) in tracking.tracks.iter().enumerate() {
        let seen = track.points.iter().filter(|point| point.measurement.is_some()).count();
        let [x, y] = track.quality.deviation;
        say!("{object:<8}{seen:>10}{:>9.1} px{x:>11.3} px{y:>11.3} px{:>10.3}", track.diameter, track.quality.misfit);
    }
    for segment in &segments {
        let std::ops::Range { start, end } = segment.frames;
        say!("object {}, frames {start}..{end}: {}", segment.track, segment.reason());
    }
    // A calibrated plane may be seen at an angle.
    let depth = tracking.tracks.iter().filter(|_| calibration.is_none()).find_map(depth_line);
    depth.iter().for_each(|line| say!("scale: {line}"));
    write_table(&out, &tracking, calibration.as_ref())?;
    write_picture(&picture, &video, &tracking)?;
    say!("positions in {}, paths in {}", arguments.out.display(), arguments.picture.display());
    Ok(())
}

fn frames(text: &str, count: usize) -> Result<std::ops::Range<usize>> {
    let wrong = || format!("--frames {text:?}: expected START..END, START.. or ..END");
    let (start, end) = text.split_once("..").with_context(wrong)?;
    let bound = |text: &str, usual: usize| if text.is_empty() { Some(usual) } else { text.parse().ok() };
    let range = bound(start, 0).with_context(wrong)?..bound(end, count).with_context(wrong)?;
    ensure!(range.start < range.end && range.end <= count, "--frames {text:?}: the video has {count} frames");
    Ok(range)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_read() {
        assert_eq!((frames("3..", 9).unwrap(), frames("..4", 9).unwrap()), (3..9, 0..4));
        assert!(frames("4..2", 9).is_err());
    }
}
