//! Observation of a video at its own resolution: the tracks of [`paig_track`], without an equation and without a model.

use std::collections::HashMap;
use std::ops::Range;

use anyhow::{Result, bail};
use paig_track::{
    CameraMotion, CameraPath, Finding, HALF_PIXEL, MOST_OBJECTS, Method, Point, Segment, Track, Tracking,
    TrackingOptions, Visibility,
};

use super::proposals::{Proposal, proposals};
use super::recording::Positions;
use super::scale::Scale;
use crate::import::sources::SourceVideo;
use crate::track::{Followed, SMALLER_MOVERS, check_objects, fainter, track};
use paig::network::System;
use paig::network::cells::Coordinates;
use paig::support::statistics::upper_median;

/// Least precision of a position relative to the median one.
const LEAST_WEIGHT: f64 = 0.1;
/// Displacement of a camera, as a share of the picture's shorter side, beyond which its registration needs a person's eye.
const PANS: f64 = 0.35;
/// Factor beyond which a speed that changes at once, in the same direction, is slow motion rather than a blow.
const SLOW_MOTION: f64 = 4.0;
/// Extent of a path over the mover's diameter from which on it may be the object in place of a larger one.
const TRAVELS: f64 = 0.2;
/// Median second difference of its positions over that in shuffled order, up to which it may.
const SMOOTH: f64 = 0.2;
/// Extents, in diameters, beyond which a longer way makes a mover no likelier.
const FAR: f64 = 4.0;
/// Most tracks that are looked for beyond the objects: shadows, hands, and what else moves.
const OTHERS: usize = 3;

/// Objects of one video.
pub(super) struct TrackedVideo {
    /// One of each object.
    pub tracks: Vec<Track>,
    /// Other objects, the likeliest first.
    pub others: Vec<Track>,
    /// Pieces in which the objects move freely.
    segments: Vec<Segment>,
    /// First tracked frame.
    first: usize,
    /// When every frame of the video was filmed, seconds; none where the video does not say.
    pub times: Option<Vec<f64>>,
    /// What was found of the time base and the camera, for people.
    pub notes: Vec<String>,
    /// Why the positions may be wrong altogether.
    pub doubts: Vec<String>,
}

/// Which positions of a track are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PositionSource {
    /// Registration of the object's template.
    Template,
    /// Centroids of the moving region.
    Centroid,
}

impl TrackedVideo {
    /// Tracks the objects of a video.
    ///
    /// # Errors
    /// As [`track`], and fewer objects than the system has.
    pub fn of(video: &SourceVideo, options: &TrackingOptions, objects: usize) -> Result<Self> {
        check_objects(objects)?;
        let options = TrackingOptions { objects: (objects + OTHERS).min(MOST_OBJECTS), ..options.clone() };
        let mut followed = track(video, &options)?;
        if followed.tracking.tracks.len() < objects {
            // A faint or small object is below the threshold that a bright one sets.
            followed = track(video, &fainter(&options))?;
        }
        let Followed { tracking: Tracking { mut tracks, camera, time, .. }, segments } = followed;
        let mut others = Vec::new();
        if tracks.len() < objects {
            bail!(
                "video {}: {} of {objects} objects found; look at the paths with `paig track`, and name a point on each object \
                 with --at",
                video.name(),
                tracks.len()
            );
        }
        others.extend(tracks.drain(objects..));
        let first = tracks[0].points[0].frame;
        tracks.iter_mut().chain(&mut others).for_each(|track| to_reference(track, &camera));
        let name = video.name();
        let far = PANS * video.width.min(video.height) as f64;
        let pans = (camera.motion == CameraMotion::Panning && camera.displacement > far).then(|| {
            format!("{name}: {}; film with a standing camera, or look whether the overlay fits", camera.line())
        });
        let slow = time.findings.iter().find_map(|finding| match finding {
            Finding::SpeedChange { frame, factor } if factor.max(1.0 / factor) > SLOW_MOTION => Some(format!(
                "{name}: everything is {factor:.2} times as fast from frame {frame} on, so it is unknown which part plays at the \
                 speed of life: take one (--frames), and say how slow it is (--slow-motion)"
            )),
            _ => None,
        });
        let doubts = pans.into_iter().chain(slow).collect();
        let mut notes = time.lines();
        if camera.moves() {
            notes.push(format!("camera: {}", camera.line()));
        }
        Ok(TrackedVideo { tracks, others, segments, first, times: time.times, notes, doubts })
    }

    /// Each of the other movers of a video alone, the likeliest first: those of a search with a lower threshold and more regions, so
    /// that a large mover hides no smaller one. Without those that hardly move or jump, and those that `self` has.
    ///
    /// # Errors
    /// As [`track`].
    pub fn others(&self, video: &SourceVideo, options: &TrackingOptions) -> Result<Vec<Self>> {
        let options = TrackingOptions { objects: SMALLER_MOVERS, movers: SMALLER_MOVERS, ..fainter(options) };
        let Followed { tracking: Tracking { tracks, camera, time, .. }, segments } = track(video, &options)?;
        let mut found = Vec::new();
        for (index, mut track) in tracks.into_iter().enumerate() {
            to_reference(&mut track, &camera);
            let Some(first) = track.points.first().map(|point| point.frame) else { continue };
            let moves = track.quality.extent > TRAVELS && track.quality.chance.is_none_or(|chance| chance < SMOOTH);
            if !moves || self.tracks.iter().any(|own| is_known(&track, own)) {
                continue;
            }
            let own = segments.iter().filter(|segment| segment.track == index);
            found.push(TrackedVideo {
                segments: own.map(|segment| Segment { track: 0, ..segment.clone() }).collect(),
                tracks: vec![track],
                others: Vec::new(),
                first,
                times: time.times.clone(),
                notes: self.notes.clone(),
                doubts: self.doubts.clone(),
            });
        }
        found.sort_by(|a, b| likelihood(&b.tracks[0]).total_cmp(&likelihood(&a.tracks[0])));
        Ok(found)
    }

    /// Parts in which all objects move freely, at least so many frames each.
    pub fn proposals(&self, least: usize) -> Vec<Proposal> {
        proposals(&self.segments, self.tracks.len(), least)
    }

    /// First frame and the one after the last of all or of some between which all objects have positions.
    pub fn range(&self, among: Option<&Range<usize>>) -> Range<usize> {
        let seen = |track: &Track| {
            let among = |point: &Point| among.is_none_or(|among| among.contains(&point.frame));
            let seen = |point: &Point| among(point) && position(point, PositionSource::Template).is_some();
            let first = track.points.iter().position(seen).unwrap_or(0);
            let last = track.points.iter().rposition(seen).unwrap_or(0);
            (first, last + 1)
        };
        let ranges: Vec<_> = self.tracks.iter().map(seen).collect();
        let first = ranges.iter().map(|range| range.0).max().unwrap_or(0);
        let end = ranges.iter().map(|range| range.1).min().unwrap_or(0).max(first);
        self.first + first..self.first + end
    }

    /// Positions in these frames of the video.
    pub fn positions(&self, numbers: &[usize], by: PositionSource, (scale, system): (&Scale, &System)) -> Positions {
        let of_track = |track: &Track| -> (Vec<[f64; 2]>, Vec<f64>) {
            let points =
                numbers.iter().map(|number| number.checked_sub(self.first).and_then(|it| track.points.get(it)));
            let points: Vec<_> = points.collect();
            let offset = match by {
                PositionSource::Template => [0.0; 2],
                PositionSource::Centroid => offset(&track.points),
            };
            let place = |point: &Option<&Point>| {
                let seen = point.and_then(|point| position(point, by));
                seen.map_or([f64::NAN; 2], |[x, y]| {
                    scale.in_frame([x + offset[0] + HALF_PIXEL, y + offset[1] + HALF_PIXEL])
                })
            };
            let deviation = |point: &Option<&Point>| {
                let measured = point.and_then(|point| point.measurement);
                measured.map_or(f64::NAN, |it| (0.5 * (it.covariance[0][0] + it.covariance[1][1])).sqrt())
            };
            let deviations: Vec<f64> = points.iter().map(deviation).collect();
            let usual = upper_median(deviations.iter().copied().filter(|it| it.is_finite())).unwrap_or(1.0);
            let weight = |deviation: &f64| match by {
                PositionSource::Template if deviation.is_finite() => (usual / deviation).clamp(LEAST_WEIGHT, 1.0),
                _ => 1.0,
            };
            (points.iter().map(place).collect(), deviations.iter().map(weight).collect())
        };
        let all: Vec<_> = self.tracks.iter().map(of_track).collect();
        let frames = 0..numbers.len();
        let pixels: Vec<f64> = frames.clone().flat_map(|frame| all.iter().flat_map(move |of| of.0[frame])).collect();
        let per_object = system.cell.coordinates.per_object();
        let weights = frames.flat_map(|frame| all.iter().flat_map(move |of| vec![of.1[frame]; per_object])).collect();
        Positions { coordinates: coordinates(&pixels, system), pixels, weights }
    }

    /// Puts the tracks in the order of a model's objects: each takes the nearest track. `centroids` are the model's positions
    /// in these frames, pixels of a frame.
    pub fn name_after(&mut self, centroids: &[f64], numbers: &[usize], (scale, system): (&Scale, &System)) {
        let objects = system.objects;
        let mut left: Vec<Track> =
            std::mem::take(&mut self.tracks).into_iter().chain(std::mem::take(&mut self.others)).collect();
        for object in 0..objects {
            let distance = |track: &Track| {
                let own = TrackedVideo {
                    tracks: vec![track.clone()],
                    others: Vec::new(),
                    segments: Vec::new(),
                    first: self.first,
                    times: None,
                    notes: Vec::new(),
                    doubts: Vec::new(),
                };
                let alone = System { objects: 1, ..system.clone() };
                let pixels = own.positions(numbers, PositionSource::Template, (scale, &alone)).pixels;
                let model = centroids.chunks(2 * objects).map(|frame| [frame[2 * object], frame[2 * object + 1]]);
                let apart = pixels.chunks(2).zip(model).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]));
                upper_median(apart.filter(|x| x.is_finite())).unwrap_or(f64::INFINITY)
            };
            let distances: Vec<f64> = left.iter().map(distance).collect();
            let nearest = (0..left.len()).min_by(|a, b| distances[*a].total_cmp(&distances[*b]));
            self.tracks.extend(nearest.map(|place| left.remove(place)));
        }
        self.others = left;
    }
}

/// Moves a track from the frame of the background to the camera's reference frame.
fn to_reference(track: &mut Track, camera: &CameraPath) {
    for point in &mut track.points {
        let places = point.measurement.iter_mut().map(|it| &mut it.position).chain(&mut point.centroid);
        places.for_each(|place| *place = [place[0] - camera.origin[0], place[1] - camera.origin[1]]);
    }
}

/// Whether a track shows nothing else than a known one: in three quarters of its frames the same place, to half a diameter. One that
/// goes on where the known one ends is another.
fn is_known(track: &Track, known: &Track) -> bool {
    let places = |track: &Track| -> HashMap<usize, [f64; 2]> {
        track.points.iter().filter_map(|point| Some((point.frame, point.measurement?.position))).collect()
    };
    let reach = 0.5 * track.diameter;
    let (track, known) = (places(track), places(known));
    let near = |frame: &usize, a: &[f64; 2]| known.get(frame).is_some_and(|b| (a[0] - b[0]).hypot(a[1] - b[1]) < reach);
    4 * track.iter().filter(|(frame, place)| near(frame, place)).count() > 3 * track.len()
}

/// How likely a mover is the object: frames in which it is seen, times its way in diameters.
fn likelihood(track: &Track) -> f64 {
    let seen = track.points.iter().filter(|point| point.measurement.is_some()).count();
    seen as f64 * track.quality.extent.min(FAR)
}

/// Position in a frame, where the object is seen as a whole.
fn position(point: &Point, by: PositionSource) -> Option<[f64; 2]> {
    let whole = point.visibility == Visibility::Visible;
    match by {
        PositionSource::Template => {
            point.measurement.filter(|it| whole || it.method == Method::Template).map(|it| it.position)
        }
        PositionSource::Centroid => point.centroid.filter(|_| whole),
    }
}

/// Mean distance from the centroid of the moving region to the template's.
fn offset(points: &[Point]) -> [f64; 2] {
    let both = points.iter().filter_map(|point| Some((point.measurement?.position, point.centroid?)));
    let both: Vec<_> = both.collect();
    [0, 1].map(|axis| upper_median(both.iter().map(|(a, b)| a[axis] - b[axis])).unwrap_or(0.0))
}

/// Pixels of a frame in the equation's coordinates: the same, or angles about the frame's middle, 0 up, positive clockwise.
pub(super) fn coordinates(pixels: &[f64], system: &System) -> Vec<f64> {
    if system.cell.coordinates == Coordinates::Position {
        return pixels.to_vec();
    }
    let middle = system.side as f64 / 2.0;
    let mut last = vec![None::<f64>; system.objects];
    pixels
        .chunks(2)
        .enumerate()
        .map(|(row, at)| {
            let last = &mut last[row % system.objects];
            let mut angle = (at[0] - middle).atan2(middle - at[1]);
            if let Some(before) = *last {
                angle += ((before - angle) / std::f64::consts::TAU).round() * std::f64::consts::TAU;
            }
            if angle.is_finite() {
                *last = Some(angle);
            }
            angle
        })
        .collect()
}
