//! Tracking of a video from its frames to its tracks.

use crate::appearance::{Start, registered};
use crate::background::{Background, Samples};
use crate::candidates::{Candidate, candidates, changed, occupied};
use crate::detection::{Detection, detect, steady, threshold};
use crate::error::Error;
use crate::options::Options;
use crate::points::points;
use crate::quality;
use crate::roles::roles;
use crate::start::{Course, course};
use crate::statistics::median;
use crate::track::{Track, Tracking};
use crate::video::{Video, map_frames};
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
/// [`Error::TooFewFrames`], [`Error::FrameTooSmall`] and [`Error::Range`] for unsuitable videos and ranges,
/// [`Error::NothingMoves`] and [`Error::NoPath`] where there is no mover, and errors of the source.
pub fn track(video: &dyn Video, options: &Options) -> Result<Tracking, Error> {
    let size = video.size();
    if size.width.min(size.height) < LEAST_SIDE {
        return Err(Error::FrameTooSmall { least: LEAST_SIDE, width: size.width, height: size.height });
    }
    let range = options.frames.clone().unwrap_or(0..video.frames());
    if range.start > range.end || range.end > video.frames() {
        return Err(Error::Range { first: range.start, end: range.end, frames: video.frames() });
    }
    if range.len() < LEAST_FRAMES {
        return Err(Error::TooFewFrames { least: LEAST_FRAMES, found: range.len() });
    }
    let scene = Scene::find(video, (range.start, range.end), options)?;
    let ranked = roles(scene.candidates, &scene.detections);
    let best = ranked.iter().map(|(_, candidate)| candidate.rank()).fold(0.0, f64::max);
    let ranked: Vec<_> = ranked.into_iter().filter(|(_, c)| c.rank() >= NEGLIGIBLE * best).collect();
    let courses: Vec<(Course, Layout)> = ranked
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
        let starts: Vec<Start> = windows
            .into_iter()
            .enumerate()
            .map(|(i, window)| Start {
                window,
                position: course.positions[i],
                typical: course.typical[i],
                moving: course.moving[i],
            })
            .collect();
        let (fits, _) = registered(&starts, layout, f64::from(scene.background.noise));
        let (mut points, disagreement) = points(&scene.detections, candidate, &course, &fits);
        quality::calibrate(&mut points);
        let rival = ranked.iter().map(|(_, c)| c).filter(|c| !std::ptr::eq(*c, candidate)).map(Candidate::rank);
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
        translations: scene.detections.iter().map(|d| d.translation).collect(),
        moving_share: middle(&mut scene.detections.iter().map(|d| d.share).collect()),
        flicker: middle(&mut scene.detections.iter().map(|d| d.exposure.change()).collect()),
        background: scene.background,
    })
}

/// Background, moving regions and their paths.
struct Scene {
    background: Background,
    detections: Vec<Detection>,
    candidates: Vec<Candidate>,
}

impl Scene {
    fn find(video: &dyn Video, range: (usize, usize), options: &Options) -> Result<Self, Error> {
        let mut samples = Samples::read(video, range.0, range.1, options.background_bytes)?;
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
        video: &dyn Video,
        range: (usize, usize),
        samples: &Samples,
        background: Background,
        options: &Options,
    ) -> Result<Self, Error> {
        let threshold = threshold(samples, &background, options)?;
        let detections = detect(video, range, &background, (threshold, samples.shaken()), options)?;
        let candidates = candidates(&detections, video.size(), options);
        if candidates.is_empty() {
            return Err(Error::NoPath { blobs: detections.iter().map(|d| d.blobs.len()).sum() });
        }
        Ok(Self { background, detections, candidates })
    }
}

/// Windows of each course, in order of its frames.
fn cut(
    video: &dyn Video,
    detections: &[Detection],
    background: &Background,
    courses: &[(Course, Layout)],
) -> Result<Vec<Vec<Window>>, Error> {
    let start = detections[0].frame;
    let wanted = |frame: usize| courses.iter().any(|(course, _)| course.frames().contains(&frame));
    let work = |frame: usize, bytes: &[u8]| -> Vec<Option<Window>> {
        let Detection { exposure, translation, .. } = &detections[frame - start];
        let bytes = &*steady(bytes, background.size(), *translation);
        let window = |(course, layout): &(Course, Layout)| {
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
