//! Pieces of a video in which an object moves freely.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::boundary::{SIDE, TrackBoundaries, size};
use crate::statistics::{median, quantile};
use crate::track::{Point, Role, Track, TrackPoint, Tracking};
use crate::video::Size;

/// Longest gap without a position within a segment, frames.
const GAP: usize = 6;
/// Shortest rest: frames and seconds.
const REST_FRAMES: usize = 8;
const REST_SECONDS: f64 = 0.15;
/// Extent of a rest, in units of the noise and as a share of the track's extent.
const REST_NOISE: f64 = 5.0;
const REST_SHARE: f64 = 0.012;
/// Shortest segment, frames, and its least extent, in diameters of the object.
const LEAST_FRAMES: usize = 8;
const LEAST_EXTENT: f64 = 0.5;
/// Misfit of the template, over the usual one, of an object that a hand covers; and frames in a row that show it.
const COVERED: f64 = 3.0;
const COVERED_FRAMES: usize = 3;
/// Change of the velocity at an impact: as a share of the speed, and in units of the noise per frame.
const IMPACT: f64 = 0.4;
const IMPACT_NOISE: f64 = 12.0;

/// Why free motion begins or ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Limit {
    /// The tracked part of the video begins or ends.
    Video,
    /// The video is cut, or its speed changes.
    Cut,
    /// The object enters or leaves the frame.
    Border,
    /// A hand lets it go or catches it.
    Hand,
    /// It rests before or afterwards.
    Rest,
    /// It is not found before or afterwards.
    Lost,
}

/// Frames in which an object moves freely.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Segment {
    /// Index of the track.
    pub track: usize,
    pub frames: Range<usize>,
    pub begins: Limit,
    pub ends: Limit,
    /// Frames at which the velocity changes at once: bounces and blows.
    pub impacts: Vec<usize>,
}

impl Segment {
    /// Why these frames: one line.
    pub fn reason(&self) -> String {
        let begins = match self.begins {
            Limit::Video => "the video begins",
            Limit::Cut => "the video is cut",
            Limit::Border => "it enters the frame",
            Limit::Hand => "a hand lets it go",
            Limit::Rest => "it starts from rest",
            Limit::Lost => "it is found again",
        };
        let ends = match self.ends {
            Limit::Video => "the video ends",
            Limit::Cut => "the video is cut",
            Limit::Border => "it leaves the frame",
            Limit::Hand => "a hand catches it",
            Limit::Rest => "it comes to rest",
            Limit::Lost => "it is lost",
        };
        let impacts = match self.impacts.len() {
            0 => String::new(),
            1 => format!(", one impact at frame {}", self.impacts[0]),
            count => format!(", {count} impacts"),
        };
        format!("from where {begins} to where {ends}{impacts}")
    }
}

/// Pieces of free motion of every object, in order of the tracks and of time.
pub fn segments(tracking: &Tracking) -> Vec<Segment> {
    let objects = tracking.tracks.iter().enumerate().filter(|(_, track)| track.role == Role::Object);
    objects.flat_map(|(index, track)| of_track(tracking, index, track)).collect()
}

/// State of an object in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ObjectState {
    Free,
    Missing,
    Held,
    Resting,
}

fn of_track(tracking: &Tracking, index: usize, track: &Track) -> Vec<Segment> {
    let points = &track.points;
    if points.is_empty() {
        return Vec::new();
    }
    let states = states(tracking, track);
    let first = points[0].frame;
    let broken = |place: usize| tracking.time.breaks.contains(&(first + place));
    let mut found = Vec::new();
    let mut place = 0;
    while place < points.len() {
        if states[place] != ObjectState::Free {
            place += 1;
            continue;
        }
        let start = place;
        let mut end = place + 1;
        while end < points.len() && !broken(end) {
            // A short gap is an occlusion.
            let next = (end..points.len().min(end + GAP + 1))
                .take_while(|&k| !broken(k) || k == end)
                .find(|&k| states[k] != ObjectState::Missing);
            match next {
                Some(k) if states[k] == ObjectState::Free => end = k + 1,
                _ => break,
            }
        }
        place = end;
        let frames = first + start..first + end;
        if frames.len() >= LEAST_FRAMES && extent(&points[start..end]) > LEAST_EXTENT * track.diameter {
            let begins = limit(tracking, track, &states, start, false);
            let ends = limit(tracking, track, &states, end, true);
            found.push(Segment { track: index, impacts: impacts(tracking, track, &frames), frames, begins, ends });
        }
    }
    found
}

fn positions(points: &[Point]) -> Vec<[f64; 2]> {
    points.iter().filter_map(|p| p.measurement.map(|m| m.position)).collect()
}

/// Diagonal of the box around the positions, pixels.
fn extent(points: &[Point]) -> f64 {
    let positions = positions(points);
    let range = |axis: usize| {
        let values = positions.iter().map(|p| p[axis]);
        values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
    };
    if positions.is_empty() { 0.0 } else { range(0).hypot(range(1)) }
}

fn states(tracking: &Tracking, track: &Track) -> Vec<ObjectState> {
    let points = &track.points;
    let mut states: Vec<ObjectState> =
        points.iter().map(|p| if p.measurement.is_some() { ObjectState::Free } else { ObjectState::Missing }).collect();
    rest(tracking, track, &mut states);
    // A hand near the object, or over it.
    let visitors: Vec<&Track> = tracking.tracks.iter().filter(|t| t.role == Role::Visitor).collect();
    let mut misfits: Vec<f64> = points.iter().filter_map(|p| p.misfit).collect();
    let usual = median(&mut misfits).unwrap_or(1.0).max(0.05);
    for (place, point) in points.iter().enumerate() {
        let Some(TrackPoint { position, .. }) = point.measurement else { continue };
        let touches = |visitor: &&Track| {
            let Some(hand) = visitor.points.get(place).and_then(|p| p.measurement.map(|m| m.position)) else {
                return false;
            };
            size([hand[0] - position[0], hand[1] - position[1]]) < 0.6 * (visitor.diameter + track.diameter)
        };
        if visitors.iter().any(touches) {
            states[place] = ObjectState::Held;
        }
    }
    let covered = |place: usize| points[place].misfit.is_some_and(|m| m > COVERED * usual && m > 0.3);
    let mut place = 0;
    while place < points.len() {
        let run = (place..points.len()).take_while(|&k| covered(k)).count();
        if run >= COVERED_FRAMES {
            states[place..place + run].fill(ObjectState::Held);
        }
        place += run.max(1);
    }
    states
}

/// Marks the frames in which the object rests: little extent over some time, and no curvature, which a turning point has.
fn rest(tracking: &Tracking, track: &Track, states: &mut [ObjectState]) {
    let points = &track.points;
    let noise = track.quality.jitter.unwrap_or(track.quality.deviation);
    let noise = noise[0].max(noise[1]).max(0.05);
    let small = (REST_NOISE * noise).max(REST_SHARE * extent(points));
    let time = |place: usize| tracking.time.time(points[place].frame);
    let timed = tracking.time.times.is_some();
    for start in 0..points.len() {
        let long = |end: &usize| !timed || time(*end - 1) - time(start) >= REST_SECONDS;
        let Some(end) = (start + REST_FRAMES..=points.len()).find(long) else { break };
        let window = &points[start..end];
        let there = positions(window);
        if there.len() * 4 < window.len() * 3 || extent(window) > small {
            continue;
        }
        // Mean of the outer thirds less that of the inner one: a parabola of this extent shows 0.5 of it.
        let third = there.len() / 3;
        let mean = |part: &[[f64; 2]], axis: usize| part.iter().map(|p| p[axis]).sum::<f64>() / part.len() as f64;
        let bend = [0, 1].map(|axis| {
            let outer = 0.5 * (mean(&there[..third], axis) + mean(&there[there.len() - third..], axis));
            outer - mean(&there[third..there.len() - third], axis)
        });
        if size(bend) < 3.0 * noise / (third as f64).sqrt() {
            states[start..end].fill(ObjectState::Resting);
        }
    }
}

/// Why motion begins or ends at a boundary of the states.
fn limit(tracking: &Tracking, track: &Track, states: &[ObjectState], boundary: usize, ends: bool) -> Limit {
    let points = &track.points;
    if tracking.time.breaks.contains(&(points[0].frame + boundary)) && (0..points.len()).contains(&boundary) {
        return Limit::Cut;
    }
    let beyond: Vec<ObjectState> = if ends {
        states[boundary..].iter().copied().take(GAP + 1).collect()
    } else {
        states[..boundary].iter().rev().copied().take(GAP + 1).collect()
    };
    let inner = if ends { boundary - 1 } else { boundary };
    match beyond.iter().find(|state| **state != ObjectState::Missing) {
        Some(ObjectState::Held) => Limit::Hand,
        Some(ObjectState::Resting) => Limit::Rest,
        _ if at_border(tracking, track, inner, ends) => Limit::Border,
        _ if beyond.is_empty() => Limit::Video,
        _ => Limit::Lost,
    }
}

/// Whether the next steps of the object lead beyond the frame.
fn at_border(tracking: &Tracking, track: &Track, place: usize, ends: bool) -> bool {
    let near: Vec<&Point> = if ends {
        track.points[..=place].iter().rev().filter(|p| p.measurement.is_some()).take(3).collect()
    } else {
        track.points[place..].iter().filter(|p| p.measurement.is_some()).take(3).collect()
    };
    let (Some(at), Some(inner)) = (near.first().and_then(|p| p.measurement), near.last().and_then(|p| p.measurement))
    else {
        return false;
    };
    let Size { width, height } = tracking.background.size();
    let steps = (near.len().max(2) - 1) as f64;
    [width, height].iter().enumerate().any(|(axis, &side)| {
        let step = (at.position[axis] - inner.position[axis]) / steps;
        let reach = 0.6 * track.diameter + 2.0 * step.abs();
        at.position[axis] < reach || at.position[axis] > side as f64 - 1.0 - reach
    })
}

/// Frames within a range at which the velocity changes at once.
fn impacts(tracking: &Tracking, track: &Track, frames: &Range<usize>) -> Vec<usize> {
    let Some(TrackBoundaries { noise, boundaries }) = TrackBoundaries::of(track, &tracking.time) else {
        return Vec::new();
    };
    let mut speeds: Vec<f64> = boundaries.iter().map(|b| size(b.before.velocity)).collect();
    let usual = quantile(&mut speeds, 0.5).unwrap_or(0.0);
    // Where motion begins, the parabola before is one of rest.
    let inner = frames.start + SIDE..frames.end;
    let mut found: Vec<(usize, f64)> = Vec::new();
    for boundary in boundaries.iter().filter(|b| inner.contains(&b.frame)) {
        let (before, after) = (boundary.before.velocity, boundary.after.velocity);
        let change = size([after[0] - before[0], after[1] - before[1]]);
        if change > IMPACT * size(before).max(size(after)).max(usual) && change > IMPACT_NOISE * noise {
            match found.last_mut() {
                Some(last) if boundary.frame <= last.0 + SIDE => {
                    if change > last.1 {
                        *last = (boundary.frame, change);
                    }
                }
                _ => found.push((boundary.frame, change)),
            }
        }
    }
    found.into_iter().map(|(frame, _)| frame).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{MovingEllipse, SyntheticScene};
    use crate::test_videos::Filmed;
    use crate::{TrackingOptions, track};

    fn of(positions: Vec<[f64; 2]>) -> Vec<Segment> {
        let scene = SyntheticScene { seed: 11, ..SyntheticScene::of(MovingEllipse::at(positions)) };
        let clip = Filmed::new(&scene, 60.0);
        segments(&track(&clip, &TrackingOptions { objects: 1, ..TrackingOptions::default() }).unwrap())
    }

    #[test]
    fn a_bouncing_ball_is_one_segment_from_its_release_to_its_rest() {
        let (mut x, mut y, mut v) = (60.0, 40.0, 0.0_f64);
        let mut positions = vec![[x, y]; 30];
        for _ in 0..140 {
            v += 0.22;
            y += v;
            x += 0.9;
            if y > 210.0 {
                y = 420.0 - y;
                v *= -0.6;
            }
            if v.abs() < 0.4 && y > 209.0 {
                (y, v) = (210.0, 0.0);
                x -= 0.9;
            }
            positions.push([x, y]);
        }
        let last = positions[positions.len() - 1];
        positions.extend([last; 40]);
        let found = of(positions);
        assert_eq!(found.len(), 1, "{found:?}");
        let Segment { frames, begins, ends, impacts, .. } = &found[0];
        assert!(frames.start.abs_diff(30) <= 4 && (*begins, *ends) == (Limit::Rest, Limit::Rest), "{found:?}");
        assert!(impacts.len() >= 2 && impacts[0].abs_diff(30 + 39) <= 1, "{found:?}");
    }

    #[test]
    fn each_of_three_throws_through_the_frame_is_a_segment() {
        let throw = |frame: i32| [-30.0 + 7.0 * f64::from(frame), 200.0 + 0.15 * f64::from(frame - 27).powi(2) - 130.0];
        let absent = [-80.0, -80.0];
        let positions = (0..3).flat_map(|_| (0..55).map(throw).chain(vec![absent; 25])).collect();
        let found = of(positions);
        assert_eq!(found.len(), 3, "{found:?}");
        for (segment, start) in found.iter().zip([0, 80, 160]) {
            assert_eq!((segment.begins, segment.ends), (Limit::Border, Limit::Border), "{segment:?}");
            assert!(segment.frames.start >= start && segment.frames.end <= start + 55, "{segment:?}");
            assert!(segment.impacts.is_empty(), "{segment:?}");
        }
    }

    #[test]
    fn a_pendulum_does_not_rest_where_it_turns() {
        let angle = |f: usize| 0.5 * (f as f64 * 0.05).cos();
        let found = of((0..200).map(|f| [160.0 + 150.0 * angle(f).sin(), 20.0 + 150.0 * angle(f).cos()]).collect());
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!((&found[0].frames, found[0].begins, found[0].ends), (&(0..200), Limit::Video, Limit::Video));
    }
}
