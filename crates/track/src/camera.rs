//! Motion of the camera: standing, trembling, turning with the object, or not registrable.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::edges::{Edges, Registered};
use crate::error::TrackError;
use crate::mosaic::{Mosaic, outline};
use crate::similarity::Similarity;
use crate::statistics::{median, quantile};
use crate::still;
use crate::survey::{Coarse, Survey};
use crate::texture::texture_stays;
use crate::video::{FrameSource, Size, map_frames};

/// Displacements, pixels, at the 70th and the 98th percentile of the frames, below which a camera stands. The first is the
/// accuracy of what follows an object; the second lets one knock pass.
const STANDS: [f64; 2] = [0.25, 0.8];
/// Displacement, as a share of the frame's shorter side, up to which a camera trembles.
const TREMBLES: f64 = 0.05;
/// Share of the frames that must lie so near.
const NEAR: f64 = 0.9;
/// Share of the corners that one motion must explain in a frame of a moving camera, and of the frames in which it must.
const ONE_MOTION: f64 = 0.55;
const MOST_FRAMES: f64 = 0.85;
/// Share of the frames whose background must be found; less of a camera that trembles, whose other frames are left out.
const FOUND: f64 = 0.85;
const FOUND_NEAR: f64 = 0.5;
/// Share of the edges that must agree on a frame's registration.
const AGREEING: f64 = 0.45;
/// Factor by which moved frames must fit the background better than where they stand.
const BETTER: f64 = 1.25;
/// Rounds of building the background and registering the samples on it.
const ROUNDS: usize = 2;
/// Fewest frames of a scene that is tracked.
const LEAST_FRAMES: usize = 8;

/// How a camera moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraMotion {
    /// The background stays where it is.
    Standing,
    /// The background has too few corners to see a motion of the camera; it is taken to stand.
    Unknown,
    /// Moves around one direction: hand-held. Frames are stabilised.
    Trembling,
    /// Turns, zooms or drifts: the background is pieced together from the frames.
    Panning,
}

/// Motion of the camera over the tracked frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraPath {
    pub motion: CameraMotion,
    /// Tracked frames: the longest scene of those asked for.
    pub frames: Range<usize>,
    /// First frames of the other scenes: the video is cut there.
    pub cuts: Vec<usize>,
    /// Map from each tracked frame to the frame of the background, pixels; pixel centres are integers in both. The identity
    /// where the camera stands.
    pub poses: Vec<Similarity>,
    /// Tracked frames whose background was not found: their poses are interpolated, and they have no positions.
    pub unregistered: Vec<usize>,
    /// Frame with which the frame of the background coincides, but for a translation.
    pub reference: usize,
    /// Place of the reference frame's first pixel in the background, pixels.
    pub origin: [f64; 2],
    /// Largest distance by which a corner of a frame lies from its place in the reference frame, pixels.
    pub displacement: f64,
}

impl CameraPath {
    /// Pose of a tracked frame.
    pub fn pose(&self, frame: usize) -> Option<&Similarity> {
        self.poses.get(frame.checked_sub(self.frames.start)?)
    }

    /// Whether frames are resampled into the frame of the background.
    pub fn moves(&self) -> bool {
        matches!(self.motion, CameraMotion::Trembling | CameraMotion::Panning)
    }

    /// One line for a person.
    pub fn line(&self) -> String {
        let pixels = self.displacement;
        let cuts = match self.cuts.len() {
            0 => String::new(),
            1 => format!("; the video is cut at frame {}, frames {:?} are used", self.cuts[0], self.frames),
            count => format!("; the video is cut {count} times, frames {:?} are used", self.frames),
        };
        let lost = match self.unregistered.len() {
            0 => String::new(),
            count => format!("; the background is not found in {count} frames, which have no positions"),
        };
        let motion = match self.motion {
            CameraMotion::Standing => "the camera stands".into(),
            CameraMotion::Unknown => {
                "the background has too few marks to see whether the camera moves; it is taken to stand".into()
            }
            CameraMotion::Trembling => {
                format!("the camera trembles by up to {pixels:.1} pixels; frames are stabilised")
            }
            CameraMotion::Panning => {
                format!(
                    "the camera moves by up to {pixels:.0} pixels; positions are given on the background around frame {}",
                    self.reference
                )
            }
        };
        motion + &cuts + &lost
    }
}

/// A camera, and where it moves the scene's background.
pub(crate) struct CameraEstimate {
    pub(crate) camera: CameraPath,
    pub(crate) mosaic: Option<Mosaic>,
}

/// Decides how the camera moves over the frames of a survey, and registers all frames where it does.
///
/// # Errors
/// [`TrackError::Camera`] where the camera moves and frames cannot be registered; errors of the source.
/// `samples` are frames and their bytes from which the background is pieced together.
pub(crate) fn find(
    video: &dyn FrameSource,
    survey: &Survey,
    samples: &[(usize, Vec<u8>)],
    range: Range<usize>,
) -> Result<CameraEstimate, TrackError> {
    let (frames, cuts) = longest(survey, range);
    if frames.len() < LEAST_FRAMES {
        return Err(TrackError::TooFewFrames { least: LEAST_FRAMES, found: frames.len() });
    }
    let standing = |motion: CameraMotion| CameraEstimate {
        camera: CameraPath {
            motion,
            frames: frames.clone(),
            cuts: cuts.clone(),
            poses: vec![Similarity::IDENTITY; frames.len()],
            unregistered: Vec::new(),
            reference: frames.start,
            origin: [0.0; 2],
            displacement: 0.0,
        },
        mosaic: None,
    };
    match judged(survey, &frames) {
        CameraJudgement::Unknown => return Ok(standing(CameraMotion::Unknown)),
        CameraJudgement::Standing => return Ok(standing(CameraMotion::Standing)),
        CameraJudgement::Moving if still(survey, &frames) => return Ok(standing(CameraMotion::Standing)),
        CameraJudgement::Moving => {}
    }
    let coarse = survey.register_all(video, &frames)?;
    let sampled: Vec<usize> = samples.iter().map(|(frame, _)| *frame).collect();
    let start = CameraStart::new(survey, &coarse, &frames, &sampled)?;
    let moving = registered(video, (survey.size, samples), &frames, start)?;
    if !is_moving(&moving.displacements) || !moving.fits_better() {
        return Ok(standing(CameraMotion::Standing));
    }
    let shorter = survey.size.width.min(survey.size.height) as f64;
    let displacement = quantile(&mut moving.displacements.clone(), 1.0).unwrap_or(0.0);
    let camera = CameraPath {
        motion: if displacement < TREMBLES * shorter { CameraMotion::Trembling } else { CameraMotion::Panning },
        frames,
        cuts,
        poses: moving.poses,
        unregistered: moving.unregistered,
        reference: moving.reference,
        origin: moving.origin,
        displacement,
    };
    Ok(CameraEstimate { camera, mosaic: Some(moving.mosaic) })
}

/// Longest scene within a range, and the first frames of the later scenes.
fn longest(survey: &Survey, range: Range<usize>) -> (Range<usize>, Vec<usize>) {
    let cuts: Vec<usize> = survey.changes.iter().filter(|change| change.is_cut()).map(|change| change.frame).collect();
    let mut bounds = vec![range.start];
    bounds.extend(&cuts);
    bounds.push(range.end);
    let longest = bounds.windows(2).map(|w| w[0]..w[1]).max_by_key(|scene| scene.len()).unwrap_or(range);
    (longest, cuts)
}

enum CameraJudgement {
    Unknown,
    Standing,
    Moving,
}

fn judged(survey: &Survey, frames: &Range<usize>) -> CameraJudgement {
    let within: Vec<&Coarse> = survey.coarse.iter().filter(|c| frames.contains(&c.frame)).collect();
    let poses: Vec<(usize, Similarity)> = within.iter().filter_map(|c| c.pose.map(|pose| (c.scene, pose))).collect();
    // Before a plain wall, what has corners is the object.
    let textured = within.iter().filter(|c| c.textured).count() * 2 >= within.len();
    if poses.len() * 2 < within.len() {
        return if textured { CameraJudgement::Moving } else { CameraJudgement::Unknown };
    }
    let first = poses[0].0;
    if poses.iter().any(|(scene, _)| *scene != first) {
        return CameraJudgement::Moving;
    }
    let poses: Vec<Similarity> = poses.iter().map(|(_, pose)| pose.enlarged(survey.factor)).collect();
    let reference = middle(&poses, survey.size, |_| true);
    let displacements: Vec<f64> = poses.iter().map(|pose| displaced(pose, &poses[reference], survey.size)).collect();
    if is_moving(&displacements) { CameraJudgement::Moving } else { CameraJudgement::Standing }
}

/// Whether texture or marks all over the frame stay where they are, whatever moves before them.
fn still(survey: &Survey, frames: &Range<usize>) -> bool {
    let images = survey.images(frames, still::LOOKED_AT);
    texture_stays(&images)
        || still::poses(&images).is_some_and(|poses| {
            let displaced =
                |pose: &Similarity| pose.enlarged(survey.factor).displacement(survey.size.width, survey.size.height);
            !is_moving(&poses.iter().map(displaced).collect::<Vec<_>>())
        })
}

fn is_moving(displacements: &[f64]) -> bool {
    let at = |share: f64| quantile(&mut displacements.to_vec(), share).unwrap_or(0.0);
    at(0.7) > STANDS[0] || at(0.98) > STANDS[1]
}

/// Index of the eligible pose nearest to the middle of all.
fn middle(poses: &[Similarity], size: Size, eligible: impl Fn(usize) -> bool) -> usize {
    let centre = [0.5 * size.width as f64, 0.5 * size.height as f64];
    let places: Vec<[f64; 2]> = poses.iter().map(|pose| pose.apply(centre)).collect();
    let middle = [0, 1].map(|axis| median(&mut places.iter().map(|p| p[axis]).collect::<Vec<_>>()).unwrap_or(0.0));
    let distance = |p: &[f64; 2]| (p[0] - middle[0]).hypot(p[1] - middle[1]);
    let nearest = places
        .iter()
        .enumerate()
        .filter(|(place, _)| eligible(*place))
        .min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
    nearest.map_or(0, |(index, _)| index)
}

fn displaced(pose: &Similarity, reference: &Similarity, size: Size) -> f64 {
    reference.inverse().after(pose).displacement(size.width, size.height)
}

/// Poses of all frames from corners, and the frame of the background.
struct CameraStart {
    /// From each frame to the background.
    poses: Vec<Similarity>,
    known: Vec<bool>,
    reference: usize,
    origin: [f64; 2],
    canvas: Size,
    /// Largest distance of a frame's corners from the reference frame, pixels.
    reach: f64,
}

impl CameraStart {
    fn new(survey: &Survey, coarse: &[Coarse], frames: &Range<usize>, sampled: &[usize]) -> Result<Self, TrackError> {
        let size = survey.size;
        let refuse = |frame: usize, reason: String| Err(TrackError::Camera { frame, reason });
        let scene = most_common(coarse.iter().filter(|c| c.pose.is_some()).map(|c| c.scene));
        let found: Vec<Option<Similarity>> = coarse
            .iter()
            .map(|c| c.pose.filter(|_| c.scene == scene).map(|pose| pose.enlarged(survey.factor)))
            .collect();
        let known: Vec<bool> = found.iter().map(Option::is_some).collect();
        let poses = filled(&found);
        let reference =
            middle(&poses, size, |place| known[place] && sampled.binary_search(&(frames.start + place)).is_ok());
        let back = poses[reference].inverse();
        let mut poses: Vec<Similarity> = poses.iter().map(|pose| back.after(pose)).collect();
        let shorter = size.width.min(size.height) as f64;
        let far = |pose: &Similarity| pose.displacement(size.width, size.height);
        let furthest = poses.iter().map(far).fold(0.0, f64::max);
        let mut known_far: Vec<f64> =
            poses.iter().zip(&known).filter(|(_, known)| **known).map(|(p, _)| far(p)).collect();
        if quantile(&mut known_far, NEAR).is_some_and(|far| far < TREMBLES * shorter) {
            // Every frame is near the reference, so the edges of the background decide; a few followed something else.
            let near: Vec<Option<Similarity>> = poses
                .iter()
                .zip(&known)
                .map(|(pose, known)| Some(*pose).filter(|pose| *known && far(pose) < TREMBLES * shorter))
                .collect();
            let known = near.iter().map(Option::is_some).collect();
            let reference = frames.start + reference;
            let reach = TREMBLES * shorter;
            return Ok(Self { poses: filled(&near), known, reference, origin: [0.0; 2], canvas: size, reach });
        }
        let count = known.iter().filter(|&&k| k).count();
        if (count as f64) < FOUND * found.len() as f64 {
            let lost = known.iter().position(|k| !k).unwrap_or(0);
            let (all, missing) = (found.len(), found.len() - count);
            return refuse(frames.start + lost, format!("its background is lost in {missing} of {all} frames"));
        }
        let clear = |c: &&Coarse| c.agreeing >= ONE_MOTION;
        if (coarse.iter().filter(clear).count() as f64) < MOST_FRAMES * coarse.len() as f64 {
            let worst =
                coarse.iter().min_by(|a, b| a.agreeing.total_cmp(&b.agreeing)).map_or(frames.start, |c| c.frame);
            let mut shares: Vec<f64> = coarse.iter().map(|c| c.agreeing).collect();
            let typical = 100.0 * median(&mut shares).unwrap_or(0.0);
            return refuse(
                worst,
                format!("only {typical:.0} % of its marks move alike: the scene has depth, or much else moves"),
            );
        }
        let Some((canvas, first)) = outline(size, poses.iter()) else {
            let far = poses.iter().position(|p| p.displacement(size.width, size.height) == furthest).unwrap_or(0);
            return refuse(frames.start + far, "it travels over more than eight frames' area".into());
        };
        let origin = first.map(|v| -v);
        let shift = Similarity::translation(origin);
        poses.iter_mut().for_each(|pose| *pose = shift.after(pose));
        Ok(Self { poses, known, reference: frames.start + reference, origin, canvas, reach: f64::INFINITY })
    }
}

fn most_common(scenes: impl Iterator<Item = usize>) -> usize {
    let mut counts: Vec<usize> = Vec::new();
    for scene in scenes {
        counts.resize(counts.len().max(scene + 1), 0);
        counts[scene] += 1;
    }
    counts.iter().enumerate().max_by_key(|(scene, count)| (**count, usize::MAX - scene)).map_or(0, |(scene, _)| scene)
}

/// Missing poses interpolated between their neighbours.
fn filled(poses: &[Option<Similarity>]) -> Vec<Similarity> {
    let known: Vec<usize> = (0..poses.len()).filter(|&i| poses[i].is_some()).collect();
    let at = |index: usize| poses[index].unwrap_or(Similarity::IDENTITY);
    (0..poses.len())
        .map(|i| {
            let after = known.partition_point(|&k| k < i);
            match (after.checked_sub(1).map(|b| known[b]), known.get(after)) {
                (_, Some(&k)) if k == i => at(k),
                (Some(b), Some(&a)) => {
                    let share = (i - b) as f64 / (a - b) as f64;
                    let mix = |x: f64, y: f64| x + share * (y - x);
                    let (p, q) = (at(b), at(a));
                    Similarity { a: mix(p.a, q.a), b: mix(p.b, q.b), u: mix(p.u, q.u), v: mix(p.v, q.v) }
                }
                (Some(one), None) => at(one),
                (None, Some(&one)) => at(one),
                (None, None) => Similarity::IDENTITY,
            }
        })
        .collect()
}

/// Registrations of all frames on the background.
struct Registrations {
    poses: Vec<Similarity>,
    unregistered: Vec<usize>,
    displacements: Vec<f64>,
    /// Misfit of each frame where it stands over that where it was found.
    gains: Vec<Option<f64>>,
    reference: usize,
    origin: [f64; 2],
    mosaic: Mosaic,
}

impl Registrations {
    /// Whether the frames that moved fit the background better where they were found.
    fn fits_better(&self) -> bool {
        let moved = self.displacements.iter().zip(&self.gains).filter(|(far, _)| **far > STANDS[0]);
        let mut gains: Vec<f64> = moved.map(|(_, gain)| gain.unwrap_or(f64::INFINITY)).collect();
        median(&mut gains).is_some_and(|gain| gain > BETTER)
    }
}

fn registered(
    video: &dyn FrameSource,
    (size, samples): (Size, &[(usize, Vec<u8>)]),
    frames: &Range<usize>,
    start: CameraStart,
) -> Result<Registrations, TrackError> {
    let CameraStart { mut poses, known, reference, origin, canvas, reach } = start;
    let place = |frame: usize| frame - frames.start;
    let samples: Vec<&(usize, Vec<u8>)> =
        samples.iter().filter(|(frame, _)| frames.contains(frame) && known[place(*frame)]).collect();
    let build = |poses: &[Similarity]| {
        let views: Vec<(&[u8], Similarity)> =
            samples.iter().map(|(frame, bytes)| (&bytes[..], poses[place(*frame)])).collect();
        Mosaic::of(&views, size, canvas)
    };
    let mut mosaic = build(&poses);
    for _ in 0..ROUNDS {
        let edges = Edges::find(&mosaic, size);
        for (frame, bytes) in &samples {
            if let Some(found) = edges.register(bytes, size, poses[place(*frame)].inverse()) {
                poses[place(*frame)] = found.map.inverse();
            }
        }
        // All frames may drift together: the reference frame stays.
        let back = Similarity::translation(origin).after(&poses[place(reference)].inverse());
        samples.iter().for_each(|(frame, _)| poses[place(*frame)] = back.after(&poses[place(*frame)]));
        mosaic = build(&poses);
    }
    let edges = Edges::find(&mosaic, size);
    let still = Similarity::translation(origin.map(|v| -v));
    let work = |frame: usize, bytes: &[u8]| {
        let found = edges.register(bytes, size, poses[place(frame)].inverse())?;
        let misfit = |map: &Similarity| edges.misfit(bytes, size, map);
        let gain = misfit(&still).zip(misfit(&found.map)).map(|(still, moved)| still / moved.max(0.1));
        Some((found, gain))
    };
    let found = map_frames(video, &|frame| frames.contains(&frame), work)?;
    let gains = found.iter().map(|(_, found)| found.and_then(|(_, gain)| gain)).collect();
    let found: Vec<(usize, Option<Registered>)> =
        found.into_iter().map(|(f, found)| (f, found.map(|it| it.0))).collect();
    let displaced = |pose: &Similarity| still.after(pose).displacement(size.width, size.height);
    let fine: Vec<Option<Similarity>> = found
        .iter()
        .map(|(_, found)| found.filter(|found| found.agreeing > AGREEING).map(|found| found.map.inverse()))
        .map(|pose| pose.filter(|pose| displaced(pose) < reach))
        .collect();
    let unregistered: Vec<usize> =
        fine.iter().zip(frames.clone()).filter(|(f, _)| f.is_none()).map(|(_, f)| f).collect();
    let least = if reach.is_finite() { FOUND_NEAR } else { FOUND };
    if (unregistered.len() as f64) > (1.0 - least) * fine.len() as f64 {
        let count = unregistered.len();
        let reason = format!("its edges do not fit the background in {count} of {} frames", fine.len());
        return Err(TrackError::Camera { frame: unregistered[0], reason });
    }
    let poses = filled(&fine);
    let displacements = poses.iter().map(displaced).collect();
    Ok(Registrations { poses, unregistered, displacements, gains, reference, origin, mosaic })
}
