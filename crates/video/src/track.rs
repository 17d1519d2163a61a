//! Objects of a video, tracked at its own resolution without an equation, as a table and a picture.

use std::io::Write;
use std::path::Path;
use std::sync::mpsc::sync_channel;
use std::thread;

use anyhow::{Context, Result, anyhow, bail, ensure};
use image::{Rgb, RgbImage};
use paig::support::output::FileKind;
use paig::support::significant::significant;
use paig::support::{atomic, picture_file};
use paig_track::{
    CameraMotion, HALF_PIXEL, Hint, MOST_OBJECTS, Point, Region, Role, Segment, Size, StatedTime, TrackError, Tracking,
    TrackingOptions, Visibility, Visitor, segments,
};

use crate::calibration::Calibration;
use crate::import::sources::SourceVideo;

/// Share of a frame's pixels in motion above which the camera, not an object, moves; before a background without marks.
const MOVING_CAMERA: f64 = 0.2;
/// Frames that are decoded while earlier ones are worked on.
const DECODED_AHEAD: usize = 8;
/// Colours of the paths, one for each object.
const COLOURS: [[u8; 3]; 4] = [[230, 60, 50], [40, 120, 220], [50, 170, 80], [240, 160, 30]];

/// Frames of a video for the tracker.
struct TrackerFrames<'a>(&'a SourceVideo);

impl paig_track::FrameSource for TrackerFrames<'_> {
    fn size(&self) -> Size {
        Size { width: self.0.width as usize, height: self.0.height as usize }
    }

    fn frames(&self) -> usize {
        self.0.frames
    }

    fn clock(&self) -> StatedTime {
        self.0.clock.clone()
    }

    fn visit(&self, wanted: &dyn Fn(usize) -> bool, visitor: &mut Visitor<'_>) -> Result<(), paig_track::TrackError> {
        let source = |error: anyhow::Error| paig_track::TrackError::Source(format!("{error:#}"));
        let numbers: Vec<usize> = (0..self.0.frames).filter(|number| wanted(*number)).collect();
        let (ahead, frames) = sync_channel(DECODED_AHEAD);
        let decode = move || {
            let mut decoder = match self.0.decode() {
                Ok(decoder) => decoder,
                Err(error) => return drop(ahead.send(Err(error))),
            };
            for number in numbers {
                // Nobody listens once the visitor has failed.
                if ahead.send(decoder.frame(number).map(|frame| (number, frame))).is_err() {
                    return;
                }
            }
        };
        thread::scope(|scope| {
            scope.spawn(decode);
            frames.into_iter().try_for_each(|decoded| {
                let (number, frame) = decoded.map_err(source)?;
                visitor(number, frame.as_raw())
            })
        })
    }
}

/// Objects of a video, and the pieces in which they move freely.
#[derive(Debug)]
pub struct Followed {
    pub tracking: Tracking,
    pub segments: Vec<Segment>,
}

/// Factor of the second, lower threshold.
const FAINTER: f32 = 3.0;
/// Most movers, and moving regions of a frame, where a large one is not the object.
pub(crate) const SMALLER_MOVERS: usize = 16;

/// The same options with the lower threshold.
pub(crate) fn fainter(options: &TrackingOptions) -> TrackingOptions {
    TrackingOptions { threshold: options.threshold / FAINTER, ..options.clone() }
}

/// # Errors
/// More objects than are told apart.
pub(crate) fn check_objects(objects: usize) -> Result<()> {
    ensure!(objects <= MOST_OBJECTS, "--objects {objects}: at most {MOST_OBJECTS} are told apart; take fewer");
    Ok(())
}

/// Holds points and regions that a person names against the video.
fn check_places(video: &SourceVideo, options: &TrackingOptions) -> Result<()> {
    check_objects(options.objects)?;
    let (width, height) = (video.width, video.height);
    let tracked = options.frames.clone().unwrap_or(0..video.frames);
    for Hint { frame, position } in &options.hints {
        // As a person gives it: from the corner of the first pixel.
        let [x, y] = position.map(|place| place + HALF_PIXEL);
        ensure!(*frame < video.frames, "--at {frame}:{x},{y}: it has {} frames, counted from 0", video.frames);
        ensure!(
            tracked.contains(frame),
            "--at {frame}:{x},{y}: frames {}..{} are tracked; name one of them",
            tracked.start,
            tracked.end
        );
        ensure!(
            (0.0..=f64::from(width)).contains(&x) && (0.0..=f64::from(height)).contains(&y),
            "--at {frame}:{x},{y}: the point is outside the picture of {width} x {height} pixels"
        );
    }
    for Region { first: [x, y], last: [right, bottom] } in &options.ignore {
        ensure!(
            *right < width as usize && *bottom < height as usize,
            "--ignore {x},{y},{},{}: must lie within the frames of {width} x {height}",
            (right - x).saturating_add(1),
            (bottom - y).saturating_add(1)
        );
    }
    Ok(())
}

/// Tracks movers on which all hints are: where there are none, smaller and fainter ones.
fn movers(video: &SourceVideo, options: &TrackingOptions) -> Result<Tracking> {
    let follow = |options: &TrackingOptions| paig_track::track(&TrackerFrames(video), options);
    let rectified = |hint: &Hint| {
        let position = video.calibration().map_or(hint.position, |calibration| calibration.rectified(hint.position));
        Hint { position, ..*hint }
    };
    let options = TrackingOptions { hints: options.hints.iter().map(rectified).collect(), ..options.clone() };
    let tracked = follow(&options);
    let Err(TrackError::HintOnNothing { hint, nearest }) = tracked else { return Ok(tracked?) };
    follow(&TrackingOptions { movers: SMALLER_MOVERS, ..fainter(&options) }).map_err(|_| {
        // As a person gives it.
        let text = |place: [f64; 2]| {
            let [x, y] = video.calibration().map_or(place, |calibration| calibration.filmed(place));
            format!("{:.0},{:.0}", x + HALF_PIXEL, y + HALF_PIXEL)
        };
        let nearest = nearest
            .map_or("nor elsewhere in this frame".into(), |place| format!("the nearest mover is at {}", text(place)));
        let (frame, place) = (hint.frame, text(hint.position));
        anyhow!("--at {frame}:{place}: nothing moves there, {nearest}; name a point on the object where it moves")
    })
}

/// Tracks the objects of a video. Shadows, hands and arms are told apart from objects and left out.
///
/// # Errors
/// Damage, frames outside the video, nothing that moves or can be followed, a hint where nothing moves, a region beyond the picture, a
/// camera that moves so that frames cannot be registered.
pub fn track(video: &SourceVideo, options: &TrackingOptions) -> Result<Followed> {
    check_places(video, options).with_context(|| format!("video {}", video.name()))?;
    let mut tracking = movers(video, options).with_context(|| format!("video {}", video.name()))?;
    ensure!(
        tracking.moving_share <= MOVING_CAMERA || tracking.camera.motion != CameraMotion::Unknown,
        "video {}: {:.0} % of its pixels differ from a still background; the camera seems to move",
        video.name(),
        100.0 * tracking.moving_share
    );
    // Objects come first, so the segments' tracks keep their numbers.
    let segments = segments(&tracking);
    tracking.tracks.retain(|track| track.role == Role::Object);
    if tracking.tracks.is_empty() {
        bail!("video {}: what moves in it looks like shadows, hands or arms alone", video.name());
    }
    Ok(Followed { tracking, segments })
}

/// Beginning of the table's first line.
const HEAD: &str = "object,frame,seconds,x,y,deviation_x,deviation_y,covariance_xy,visibility";
/// Title of the picture's file.
const TITLE: &str = "paig: paths of objects";
/// What [`write_table`] and [`write_picture`] write, as files that the program recognizes.
pub const TABLE: FileKind =
    FileKind { name: "positions of `paig track`", recognizes: |table| table.starts_with(HEAD.as_bytes()) };
pub const PICTURE: FileKind =
    FileKind { name: "a picture of `paig track`", recognizes: |png| picture_file::has_title(png, TITLE) };

/// Writes a table: a row for each object and frame, in pixels of the video from its top left corner, y down; where the
/// camera moves, from that corner of the camera's reference frame.
///
/// Columns: `object` (from 0), `frame` (from 0), `seconds` (as filmed; empty where the video has no times), `x`, `y`, `deviation_x`,
/// `deviation_y` (standard deviations), `covariance_xy`, `visibility`; with a calibration also `x_metres`, `y_metres` (up)
/// and their deviations. Positions are empty where the object is not seen.
///
/// # Errors
/// A file that cannot be written.
pub fn write_table(path: &Path, tracking: &Tracking, calibration: Option<&Calibration>) -> Result<()> {
    let more = if calibration.is_some() { ",x_metres,y_metres,deviation_x_metres,deviation_y_metres" } else { "" };
    atomic::write_file(path, |file| {
        writeln!(file, "{HEAD}{more}")?;
        for (object, track) in tracking.tracks.iter().enumerate() {
            for point in &track.points {
                let seconds =
                    tracking.time.times.as_ref().map_or_else(String::new, |times| format!("{:.6}", times[point.frame]));
                let numbers = numbers(point, tracking.camera.origin);
                let metres = calibration.map_or_else(String::new, |it| metres(it, point, tracking.camera.origin));
                writeln!(file, "{object},{},{seconds},{numbers},{}{metres}", point.frame, word(point.visibility))?;
            }
        }
        Ok(())
    })
}

/// Position, deviations and covariance of a point as five cells.
fn numbers(point: &Point, origin: [f64; 2]) -> String {
    let Some(measurement) = point.measurement else { return ",,,,".into() };
    let [x, y] = [0, 1].map(|axis| measurement.position[axis] - origin[axis] + HALF_PIXEL);
    let [[xx, xy], [_, yy]] = measurement.covariance;
    let deviations = [xx.sqrt(), yy.sqrt(), xy].map(|number| significant(number, 4));
    format!("{x:.4},{y:.4},{}", deviations.join(","))
}

/// Place on the plane and deviations of a point as four cells, each after a comma.
fn metres(calibration: &Calibration, point: &Point, origin: [f64; 2]) -> String {
    let Some(measurement) = point.measurement else { return ",,,,".into() };
    let position = [0, 1].map(|axis| measurement.position[axis] - origin[axis]);
    let [x, y, across, up] = calibration.metres(position, measurement.covariance);
    format!(",{x:.6},{y:.6},{},{}", significant(across, 4), significant(up, 4))
}

fn word(visibility: Visibility) -> &'static str {
    match visibility {
        Visibility::Visible => "visible",
        Visibility::CutOff => "cut off",
        Visibility::Occluded => "occluded",
        Visibility::Absent => "absent",
    }
}

/// Writes a picture: the paths of the objects over the frame in which the first of them is first seen; where the camera
/// moves, over the background.
///
/// # Errors
/// A frame that cannot be decoded, a file that cannot be written.
pub fn write_picture(path: &Path, video: &SourceVideo, tracking: &Tracking) -> Result<()> {
    let seen = tracking.tracks[0].points.iter().find(|point| point.measurement.is_some());
    let mut picture = if tracking.camera.moves() {
        let levels = &tracking.background.levels;
        let (height, width, _) = levels.dim();
        RgbImage::from_fn(width as u32, height as u32, |x, y| {
            Rgb([0, 1, 2].map(|channel| levels[[y as usize, x as usize, channel]].round() as u8))
        })
    } else {
        video.decode()?.frame(seen.map_or(0, |point| point.frame))?
    };
    for (track, colour) in tracking.tracks.iter().zip(COLOURS.into_iter().cycle()) {
        for measurement in track.points.iter().filter_map(|point| point.measurement) {
            dot(&mut picture, measurement.position, Rgb(colour));
        }
    }
    picture_file::write_titled(path, &picture, TITLE)
}

/// A square of nine pixels; what sticks out of the picture is left out.
fn dot(picture: &mut RgbImage, [x, y]: [f64; 2], colour: Rgb<u8>) {
    let (width, height) = picture.dimensions();
    for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
        let (column, row) = (x.round() as i64 + dx, y.round() as i64 + dy);
        if (0..i64::from(width)).contains(&column) && (0..i64::from(height)).contains(&row) {
            picture.put_pixel(column as u32, row as u32, colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use image::codecs::gif::GifEncoder;
    use image::{Delay, DynamicImage, Frame};

    use super::*;

    /// A disc of radius 6 that goes 3 pixels right in each frame and 1 down.
    fn write_gif(path: &Path) {
        let mut encoder = GifEncoder::new(std::fs::File::create(path).unwrap());
        for number in 0..30 {
            let (x, y) = (20.0 + 3.0 * f64::from(number), 30.0 + f64::from(number));
            let frame = RgbImage::from_fn(140, 90, |px, py| {
                let away = (f64::from(px) + HALF_PIXEL - x).hypot(f64::from(py) + HALF_PIXEL - y);
                let level = (255.0 * (6.5 - away).clamp(0.0, 1.0)) as u8;
                Rgb([level.max(40), 40, 40])
            });
            let frame = DynamicImage::ImageRgb8(frame).into_rgba8();
            encoder.encode_frame(Frame::from_parts(frame, 0, 0, Delay::from_numer_denom_ms(40, 1))).unwrap();
        }
    }

    #[test]
    fn a_disc_is_tracked_to_a_tenth_of_a_pixel() {
        let folder = tempfile::tempdir().unwrap();
        let [film, table, picture] = ["a.gif", "a.csv", "a.png"].map(|name| folder.path().join(name));
        write_gif(&film);
        let video = SourceVideo::open(&film).unwrap();
        let Followed { tracking, segments } =
            track(&video, &TrackingOptions { objects: 1, ..TrackingOptions::default() }).unwrap();
        assert_eq!(segments.len(), 1);
        write_table(&table, &tracking, None).unwrap();
        write_picture(&picture, &video, &tracking).unwrap();
        let text = std::fs::read_to_string(&table).unwrap();
        let rows: Vec<Vec<&str>> = text.lines().skip(1).map(|line| line.split(',').collect()).collect();
        let seen: Vec<_> = rows.iter().filter(|row| !row[3].is_empty()).collect();
        assert!(seen.len() >= 28 && rows.len() == 30, "{text}");
        // A template's centroid may lie beside the disc's middle, by the same distance in all frames.
        let number = |cell: &str| cell.parse::<f64>().unwrap();
        let beside =
            |row: &[&str]| [number(row[3]) - 20.0 - 3.0 * number(row[1]), number(row[4]) - 30.0 - number(row[1])];
        let first = beside(seen[0]);
        for row in &seen {
            let [x, y] = beside(row);
            assert!((x - first[0]).abs() < 0.1 && (y - first[1]).abs() < 0.1, "{row:?}");
            assert!(x.hypot(y) < 0.5 && number(row[5]) < 0.2, "{row:?}");
        }
        let seconds: Vec<f64> = rows.iter().map(|row| number(row[2])).collect();
        assert!((seconds[29] - 29.0 * 0.04).abs() < 1e-6, "{seconds:?}");
        assert_eq!(image::open(&picture).unwrap().into_rgb8().dimensions(), (140, 90));
    }

    /// The disc is at 50,40 in frame 10.
    #[test]
    fn places_that_the_video_contradicts_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let film = folder.path().join("a.gif");
        write_gif(&film);
        let video = SourceVideo::open(&film).unwrap();
        let at = |frame, x: f64, y: f64| TrackingOptions {
            frames: Some(0..20),
            hints: vec![Hint { frame, position: [x - HALF_PIXEL, y - HALF_PIXEL] }],
            ..TrackingOptions::default()
        };
        let ignore =
            |last| TrackingOptions { ignore: vec![Region { first: [100, 60], last }], ..TrackingOptions::default() };
        for (options, reason) in [
            (at(10, 110.0, 70.0), "--at 10:110,70: nothing moves there, the nearest mover is at 50,40; name a point"),
            (at(25, 95.0, 55.0), "--at 25:95,55: frames 0..20 are tracked"),
            (at(30, 1.0, 1.0), "it has 30 frames"),
            (at(10, 141.0, 70.0), "outside the picture of 140 x 90"),
            (ignore([140, 70]), "--ignore 100,60,41,11: must lie within the frames of 140 x 90"),
            (ignore([usize::MAX; 2]), "must lie within the frames"),
            (
                TrackingOptions { objects: 1000, ..TrackingOptions::default() },
                "--objects 1000: at most 16 are told apart",
            ),
        ] {
            let error = format!("{:#}", track(&video, &options).unwrap_err());
            assert!(error.contains(reason), "{error}");
        }
        for options in [at(10, 52.0, 41.0), ignore([139, 89])] {
            assert_eq!(track(&video, &options).unwrap().tracking.tracks.len(), 1);
        }
    }

    #[test]
    fn a_calibrated_table_has_metres() {
        let folder = tempfile::tempdir().unwrap();
        let [film, table] = ["a.gif", "a.csv"].map(|name| folder.path().join(name));
        write_gif(&film);
        let tracking = track(&SourceVideo::open(&film).unwrap(), &TrackingOptions::default()).unwrap().tracking;
        // 100 pixels to a metre, y up from the bottom of the picture.
        let corners = [[0.0, 90.0], [140.0, 90.0], [140.0, 0.0], [0.0, 0.0]];
        let calibration = Calibration::new(corners, [1.4, 0.9], None).unwrap();
        write_table(&table, &tracking, Some(&calibration)).unwrap();
        let text = std::fs::read_to_string(&table).unwrap();
        let row: Vec<f64> = text.lines().nth(15).unwrap().split(',').filter_map(|cell| cell.parse().ok()).collect();
        let [_, _, _, x, y, .., x_metres, y_metres, across, _] = row[..] else { panic!("{row:?}") };
        assert!((x_metres - x / 100.0).abs() < 1e-4 && (y_metres - (90.0 - y) / 100.0).abs() < 1e-4, "{row:?}");
        assert!((across - row[5] / 100.0).abs() < 1e-4, "{row:?}");
    }

    #[test]
    fn a_video_in_which_nothing_moves_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let pictures = folder.path().join("still");
        std::fs::create_dir(&pictures).unwrap();
        for number in 0..12 {
            RgbImage::from_pixel(40, 40, Rgb([90; 3])).save(pictures.join(format!("{number}.png"))).unwrap();
        }
        let video = SourceVideo::open(&pictures).unwrap();
        let error = format!("{:#}", track(&video, &TrackingOptions::default()).unwrap_err());
        assert!(error.contains("nothing moves"), "{error}");
    }
}
