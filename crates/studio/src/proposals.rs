//! What the page proposes: the movers, the part in which one moves freely, and the equation that its path looks like.

use paig_track::{HALF_PIXEL, Role, Segment, Track};
use paig_video::track::Followed;
use serde::{Deserialize, Serialize};

/// A coordinate turns where it goes back by this share of its whole extent.
const TURN_SHARE: f64 = 0.15;
/// Turns from which on a motion goes to and fro.
const SWINGS: usize = 3;
/// Sideways extent over the vertical one from which on something swings like a pendulum rather than on a spring.
const SIDEWAYS: f64 = 0.5;
/// Vertical extent over the sideways one below which something slides.
const FLAT: f64 = 0.08;

/// Distance of a coordinate's median from the middle of its range, as a share of the range, from which on it is thrown back at
/// one end: a swing has it in the middle, a parabola between two bounces at a quarter from its top.
const LOPSIDED: f64 = 0.15;

/// A mover.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProposedMover {
    /// `[frame, x, y]` wherever it is seen, pixels of the video from its top left corner.
    pub path: Vec<(usize, f64, f64)>,
    pub diameter: f64,
}

/// A part in which a mover moves freely.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProposedPiece {
    pub mover: usize,
    pub start: usize,
    pub end: usize,
    /// For people.
    pub reason: String,
}

/// Proposals for a video, and remarks on its time and camera.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Proposals {
    pub movers: Vec<ProposedMover>,
    pub pieces: Vec<ProposedPiece>,
    /// Place of the piece in which the motion is longest.
    pub best: Option<usize>,
    /// Key of an equation.
    pub equation: Option<String>,
    pub remarks: Vec<String>,
    /// Why nothing is proposed.
    pub failure: Option<String>,
}

impl Proposals {
    pub fn none(reason: String) -> Self {
        Proposals { failure: Some(reason), ..Proposals::default() }
    }
}

/// Proposals from what was tracked.
pub fn propose(followed: &Followed, size: (u32, u32)) -> Proposals {
    let tracking = &followed.tracking;
    let origin = tracking.camera.origin;
    let objects = tracking.tracks.iter().filter(|track| track.role == Role::Object);
    let movers: Vec<_> = objects.map(|track| mover(track, origin)).collect();
    let pieces: Vec<_> = followed.segments.iter().map(piece).collect();
    let best =
        (0..pieces.len()).max_by_key(|place| (pieces[*place].mover == 0, pieces[*place].end - pieces[*place].start));
    let equation = best.map(|place| {
        let ProposedPiece { mover, start, end, .. } = pieces[place];
        let path: Vec<[f64; 2]> = movers[mover]
            .path
            .iter()
            .filter(|(frame, ..)| (start..end).contains(frame))
            .map(|(_, x, y)| [*x, *y])
            .collect();
        likely(&path, followed.segments[place].impacts.len(), f64::from(size.1)).to_string()
    });
    let mut remarks = tracking.time.lines();
    if tracking.camera.moves() {
        remarks.push(format!("camera: {}", tracking.camera.line()));
    }
    Proposals { movers, pieces, best, equation, remarks, failure: None }
}

fn mover(track: &Track, origin: [f64; 2]) -> ProposedMover {
    let place =
        |axis: usize, position: [f64; 2]| ((position[axis] - origin[axis] + HALF_PIXEL) * 100.0).round() / 100.0;
    let seen = track.points.iter().filter_map(|point| Some((point.frame, point.measurement?.position)));
    ProposedMover {
        path: seen.map(|(frame, position)| (frame, place(0, position), place(1, position))).collect(),
        diameter: track.diameter,
    }
}

fn piece(segment: &Segment) -> ProposedPiece {
    ProposedPiece {
        mover: segment.track,
        start: segment.frames.start,
        end: segment.frames.end,
        reason: segment.reason(),
    }
}

/// The equation that a path looks like, by how often it turns, pixels with y down.
fn likely(path: &[[f64; 2]], impacts: usize, height: f64) -> &'static str {
    let coordinates = [0, 1].map(|axis| path.iter().map(|place| place[axis]).collect::<Vec<f64>>());
    let [across, down] = [0, 1].map(|axis| (turns(&coordinates[axis]), extent(&coordinates[axis])));
    let swings = across.0 >= SWINGS || down.0 >= SWINGS;
    match () {
        () if impacts > 0 && across.0 < SWINGS && down.1 > FLAT * height => "bounce_on_a_floor",
        () if swings && across.1 >= SIDEWAYS * down.1 && lopsided(&coordinates[0]) => "constant_acceleration",
        () if swings && across.1 >= SIDEWAYS * down.1 => "damped_pendulum",
        () if swings => "mass_on_a_spring",
        () if down.1 < FLAT * across.1 => "sliding_block",
        () => "falling",
    }
}

fn range(coordinate: &[f64]) -> (f64, f64) {
    coordinate.iter().fold((f64::MAX, f64::MIN), |(low, high), it| (low.min(*it), high.max(*it)))
}

fn extent(coordinate: &[f64]) -> f64 {
    let (low, high) = range(coordinate);
    (high - low).max(0.0)
}

fn lopsided(coordinate: &[f64]) -> bool {
    let (low, high) = range(coordinate);
    let mut sorted = coordinate.to_vec();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(sorted.len() / 2).copied().unwrap_or_default();
    (median - 0.5 * (low + high)).abs() > LOPSIDED * (high - low)
}

/// How often a coordinate turns back by a share of its extent.
fn turns(coordinate: &[f64]) -> usize {
    let least = TURN_SHARE * extent(coordinate);
    let Some(first) = coordinate.first() else { return 0 };
    let (mut turns, mut furthest, mut upwards) = (0, *first, None);
    for &now in coordinate {
        let onwards = match upwards {
            Some(true) => now >= furthest,
            Some(false) => now <= furthest,
            None => false,
        };
        if onwards {
            furthest = now;
        } else if (now - furthest).abs() > least {
            turns += usize::from(upwards.is_some());
            upwards = Some(now > furthest);
            furthest = now;
        }
    }
    turns
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(frames: u32, place: impl Fn(f64) -> [f64; 2]) -> Vec<[f64; 2]> {
        (0..frames).map(|frame| place(f64::from(frame))).collect()
    }

    #[test]
    fn paths_look_like_their_equations() {
        let throw = path(40, |t| [5.0 * t, 200.0 - 12.0 * t + 0.3 * t * t]);
        assert_eq!(likely(&throw, 0, 300.0), "falling");
        assert_eq!(likely(&throw, 2, 300.0), "bounce_on_a_floor");
        let swing = path(200, |t| [150.0 + 80.0 * (0.2 * t).sin(), 200.0 - 10.0 * (0.2 * t).sin().powi(2)]);
        assert_eq!(likely(&swing, 0, 300.0), "damped_pendulum");
        // Thrown back at the foot of a slope, every 40 frames.
        let slope = path(200, |t| [300.0 - 6.0 * (t % 40.0) + 0.15 * (t % 40.0).powi(2), 200.0 - (t % 40.0)]);
        assert_eq!(likely(&slope, 0, 300.0), "constant_acceleration");
        let spring = path(200, |t| [150.0, 150.0 + 60.0 * (0.2 * t).sin()]);
        assert_eq!(likely(&spring, 0, 300.0), "mass_on_a_spring");
        assert_eq!(likely(&path(40, |t| [8.0 * t - 0.05 * t * t, 200.0]), 0, 300.0), "sliding_block");
    }

    #[test]
    fn turns_are_counted_without_noise() {
        let wave: Vec<f64> = (0..100).map(|t| (f64::from(t) * 0.2).sin() + 0.05 * f64::from(t % 2)).collect();
        // 100 steps of 0.2 are 3.18 periods: six extremes.
        assert_eq!(turns(&wave), 6);
        assert_eq!((turns(&[1.0, 2.0, 3.0]), turns(&[])), (0, 0));
    }
}
