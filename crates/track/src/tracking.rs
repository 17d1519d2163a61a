//! Tracking of a video from its frames to its tracks.

use std::ops::Range;

use crate::appearance::{RegistrationStart, registered};
use crate::background::{KeptFrames, StaticScene};
use crate::camera::{self, CameraEstimate, CameraPath};
use crate::candidates::{PathCandidate, candidates, changed, occupied};
use crate::detection::{Detection, detect, threshold};
use crate::error::TrackError;
use crate::options::{Hint, TrackingOptions};
use crate::points::points;
use crate::quality;
use crate::roles::roles;
use crate::rolling_shutter;
use crate::start::{ExpectedPath, course};
use crate::statistics::median;
use crate::steady::Steady;
use crate::survey::Survey;
use crate::time_base::TimeBase;
use crate::track::{Point, Role, Track, Tracking, Visibility};
use crate::video::{FrameSource, Size, map_frames};
use crate::window::{Layout, Window};

/// Fewest frames of a video.
const LEAST_FRAMES: usize = 8;
/// Smallest side of a frame, pixels.
const LEAST_SIDE: usize = 16;
/// Rank, relative to the best mover's, below which a mover is dropped.
const NEGLIGIBLE: f64 = 0.05;
/// Rounds of background estimation after the first.
const BACKGROUND_ROUNDS: usize = 1;
/// Change of the background, as a share of the object's area, that calls for another detection.
const CHANGED: f64 = 0.05;

/// Tracks the movers of a video.
///
/// # Errors
/// [`TrackError::TooFewFrames`], [`TrackError::FrameTooSmall`] and [`TrackError::Range`] for unsuitable videos and ranges,
/// [`TrackError::Camera`] for a camera that moves so that frames cannot be registered, [`TrackError::NothingMoves`] and
/// [`TrackError::NoPath`] where there is no mover, [`TrackError::HintOnNothing`], and errors of the source.
pub fn track(video: &dyn FrameSource, options: &TrackingOptions) -> Result<Tracking, TrackError> {
    let size = video.size();
    if size.width.min(size.height) < LEAST_SIDE {
        return Err(TrackError::FrameTooSmall { least: LEAST_SIDE, width: size.width, height: size.height });
    }
    let range = options.frames.clone().unwrap_or(0..video.frames());
    if range.start > range.end || range.end > video.frames() {
        return Err(TrackError::Range { first: range.start, end: range.end, frames: video.frames() });
    }
    if range.len() < LEAST_FRAMES {
        return Err(TrackError::TooFewFrames { least: LEAST_FRAMES, found: range.len() });
    }
    let chosen = KeptFrames::chosen(&range, size, options.background_bytes);
    let mut survey = Survey::read(video, range.clone(), Survey::stride(range.len()), &chosen)?;
    let kept = std::mem::take(&mut survey.kept);
    let CameraEstimate { camera, mosaic } = camera::find(video, &survey, &kept, range)?;
    let kept = kept.into_iter().filter(|(frame, _)| camera.frames.contains(frame));
    let mut time = TimeBase::new(&video.clock(), options.slow_motion);
    time.look(&survey.changes);
    let tracking = match mosaic {
        None => {
            let samples = KeptFrames::new(size, kept.collect());
            follow(video, samples, camera, options)?
        }
        Some(mosaic) => {
            let steady = Steady { video, camera: &camera, mosaic: &mosaic };
            let kept = kept.map(|(frame, bytes)| (frame, steady.frame(frame, &bytes))).collect();
            let samples = KeptFrames::new(mosaic.size, kept);
            let hint = |hint: &Hint| {
                let position = camera.pose(hint.frame).map_or(hint.position, |pose| pose.apply(hint.position));
                Hint { position, ..*hint }
            };
            let options = TrackingOptions { hints: options.hints.iter().map(hint).collect(), ..options.clone() };
            let filmed = |error: TrackError| match error {
                TrackError::HintOnNothing { hint, nearest } => {
                    let place =
                        |place: [f64; 2]| camera.pose(hint.frame).map_or(place, |pose| pose.inverse().apply(place));
                    let hint = Hint { position: place(hint.position), ..hint };
                    TrackError::HintOnNothing { hint, nearest: nearest.map(place) }
                }
                error => error,
            };
            let mut tracking = follow(&steady, samples, camera.clone(), &options).map_err(filmed)?;
            for track in &mut tracking.tracks {
                let reach = 0.5 * track.diameter;
                track.points.iter_mut().for_each(|point| within_frame(point, &camera, video.size(), reach));
            }
            tracking
        }
    };
    let mut tracking = timed(tracking, time);
    if let Some(readout) = options.readout {
        let Tracking { tracks, camera, time, .. } = &mut tracking;
        tracks.iter_mut().for_each(|track| rolling_shutter::correct(track, camera, time, size, readout));
    }
    Ok(tracking)
}

/// Adds what the first track shows of the time base, and removes the positions of frames that show nothing new.
fn timed(mut tracking: Tracking, mut time: TimeBase) -> Tracking {
    time.breaks.extend(&tracking.camera.cuts);
    for point in tracking.tracks.iter_mut().flat_map(|track| &mut track.points) {
        if time.stale.binary_search(&point.frame).is_ok() && point.measurement.take().is_some() {
            point.visibility = Visibility::Occluded;
        }
    }
    if let Some(first) = tracking.tracks.iter().find(|track| track.role == Role::Object) {
        time.follow(first);
    }
    Tracking { time, ..tracking }
}

/// Removes the position of an object that reaches beyond its frame, or whose frame is not registered.
fn within_frame(point: &mut Point, camera: &CameraPath, size: Size, reach: f64) {
    let (Some(measurement), Some(pose)) = (point.measurement, camera.pose(point.frame)) else { return };
    let [x, y] = pose.inverse().apply(measurement.position);
    let (right, bottom) = (size.width as f64 - 1.0 - reach, size.height as f64 - 1.0 - reach);
    if !(reach..=right).contains(&x) || !(reach..=bottom).contains(&y) {
        (point.measurement, point.visibility) = (None, Visibility::CutOff);
    } else if camera.unregistered.contains(&point.frame) {
        (point.measurement, point.visibility) = (None, Visibility::Occluded);
    }
}

/// Tracks the movers of a video whose camera stands.
fn follow(
    video: &dyn FrameSource,
    samples: KeptFrames,
    camera: CameraPath,
    options: &TrackingOptions,
) -> Result<Tracking, TrackError> {
    let scene = SceneMovers::find(video, samples, &camera.frames, options)?;
    let ranked = roles(scene.candidates, &scene.detections);
    let best = ranked.iter().map(|(_, candidate)| candidate.rank()).fold(0.0, f64::max);
    let ranked: Vec<_> = ranked.into_iter().filter(|(_, c)| c.rank() >= NEGLIGIBLE * best).collect();
    let courses: Vec<(ExpectedPath, Layout)> = ranked
        .iter()
        .take(options.objects)
        .map(|(_, candidate)| {
            let course = course(candidate, &scene.detections);
            let layout = Layout::new(course.reach, course.positions.len(), options.window_bytes);
            (course, layout)
        })
        .collect();
    let windows = cut(video, &scene.detections, &scene.background, &courses)?;
    let mut tracks = Vec::new();
    for (((role, candidate), (course, layout)), windows) in ranked.iter().zip(courses).zip(windows) {
        let starts: Vec<RegistrationStart> = windows
            .into_iter()
            .enumerate()
            .map(|(i, window)| RegistrationStart {
                window,
                position: course.positions[i],
                typical: course.typical[i],
                moving: course.moving[i],
            })
            .collect();
        let (fits, _) = registered(&starts, layout, f64::from(scene.background.noise));
        let (mut points, disagreement) = points(&scene.detections, candidate, &course, &fits);
        quality::calibrate(&mut points);
        let rival = ranked.iter().map(|(_, c)| c).filter(|c| !std::ptr::eq(*c, candidate)).map(PathCandidate::rank);
        let quality = quality::Quality {
            disagreement,
            extent: candidate.extent,
            rival: rival.fold(0.0, f64::max) / candidate.rank().max(1e-9),
            ..quality::of_points(&points)
        };
        tracks.push(Track { role: *role, points, quality, diameter: candidate.diameter, bin: layout.bin });
    }
    let middle = |values: &mut Vec<f64>| median(values).unwrap_or(0.0);
    Ok(Tracking {
        tracks,
        camera,
        time: TimeBase::default(),
        moving_share: middle(&mut scene.detections.iter().map(|d| d.share).collect()),
        flicker: middle(&mut scene.detections.iter().map(|d| d.exposure.change()).collect()),
        background: scene.background,
    })
}

/// Background, moving regions and their paths.
struct SceneMovers {
    background: StaticScene,
    detections: Vec<Detection>,
    candidates: Vec<PathCandidate>,
}

impl SceneMovers {
    fn find(
        video: &dyn FrameSource,
        mut samples: KeptFrames,
        range: &Range<usize>,
        options: &TrackingOptions,
    ) -> Result<Self, TrackError> {
        let background = samples.background(&options.ignore);
        let mut scene = Self::detect(video, range, &samples, background, options)?;
        for _ in 0..BACKGROUND_ROUNDS {
            let masks = occupied(&samples, &scene.detections, &scene.candidates);
            let better = samples.unoccupied(&masks, &options.ignore);
            let area = scene.candidates[0].diameter.powi(2);
            if (changed(&scene.background, &better) as f64) < CHANGED * area {
                break;
            }
            scene = Self::detect(video, range, &samples, better, options)?;
        }
        Ok(scene)
    }

    fn detect(
        video: &dyn FrameSource,
        range: &Range<usize>,
        samples: &KeptFrames,
        background: StaticScene,
        options: &TrackingOptions,
    ) -> Result<Self, TrackError> {
        let threshold = threshold(samples, &background, options)?;
        let detections = detect(video, range.clone(), &background, threshold, options)?;
        let candidates = candidates(&detections, video.size(), options)?;
        if candidates.is_empty() {
            return Err(TrackError::NoPath { blobs: detections.iter().map(|d| d.blobs.len()).sum() });
        }
        Ok(Self { background, detections, candidates })
    }
}

/// Windows of each course, in order of its frames.
fn cut(
    video: &dyn FrameSource,
    detections: &[Detection],
    background: &StaticScene,
    courses: &[(ExpectedPath, Layout)],
) -> Result<Vec<Vec<Window>>, TrackError> {
    let start = detections[0].frame;
    let wanted = |frame: usize| courses.iter().any(|(course, _)| course.frames().contains(&frame));
    let work = |frame: usize, bytes: &[u8]| -> Vec<Option<Window>> {
        let exposure = &detections[frame - start].exposure;
        let window = |(course, layout): &(ExpectedPath, Layout)| {
            let frames = course.frames();
            frames.contains(&frame).then(|| {
                let position = course.positions[frame - frames.start];
                Window::cut(bytes, background, exposure, *layout, position)
            })
        };
        courses.iter().map(window).collect()
    };
    let mut result: Vec<Vec<Window>> = courses.iter().map(|_| Vec::new()).collect();
    for (_, windows) in map_frames(video, &wanted, work)? {
        for (all, window) in result.iter_mut().zip(windows) {
            all.extend(window);
        }
    }
    Ok(result)
}
