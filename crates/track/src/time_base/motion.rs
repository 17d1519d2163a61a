//! What the motion of an object shows of the time base: it goes on steadily, so a jump ahead is a dropped frame.

use super::TimeBase;
use super::finding::Finding;
use crate::boundary::{Boundary, SIDE, TrackBoundaries, size};
use crate::statistics::median;
use crate::track::Track;

/// Steps of one frame, in units of the positions' noise, below which a jump is not looked for.
const FAST: f64 = 8.0;
/// Distance of a jump from whole frames, frames, and its part across the motion, at most.
const WHOLE: f64 = 0.2;
const ACROSS: f64 = 0.25;
/// Most frames dropped at one place.
const MOST: f64 = 8.0;
/// Factor by which a speed changes at once, at least, and the cosine of the angle between the directions.
const SPEED: f64 = 1.8;
const ALIGNED: f64 = 0.97;
/// The faster of two speeds over the usual one, at least: where an object turns, both are small.
const TYPICAL: f64 = 0.7;
/// Change of the velocity beside a change of speed, at most: it is sudden, and the motion around it is smooth.
const SMOOTH: f64 = 0.3;
/// Residual of a smooth motion, in units of the noise.
const RESIDUAL: f64 = 3.0;
/// Most places at which frames are dropped or the speed changes; more are a track that follows badly.
const MOST_PLACES: usize = 4;

pub(super) fn find(base: &mut TimeBase, track: &Track) {
    let Some(TrackBoundaries { noise, boundaries }) = TrackBoundaries::of(track, base) else { return };
    dropped(base, &boundaries, noise);
    changed(base, &boundaries, noise);
}

fn dropped(base: &mut TimeBase, boundaries: &[Boundary], noise: f64) {
    let mut jumps: Vec<(usize, f64, f64)> = Vec::new();
    for boundary in boundaries {
        let Boundary { frame, before, after } = boundary;
        let velocity = [0, 1].map(|axis| 0.5 * (before.velocity[axis] + after.velocity[axis]));
        let jump = [0, 1].map(|axis| after.position[axis] - before.position[axis]);
        let speed = size(velocity);
        let along = (jump[0] * velocity[0] + jump[1] * velocity[1]) / speed;
        let across = (jump[0] * velocity[1] - jump[1] * velocity[0]).abs() / speed;
        let frames = along / speed;
        // Both sides must agree that the object was fast.
        let slower = size(before.velocity).min(size(after.velocity));
        let residual = before.residual.max(after.residual);
        if slower > FAST * noise
            && residual < RESIDUAL * noise
            && slower > 0.6 * speed
            && across < ACROSS * along.max(4.0 * noise)
            && (1.0 - WHOLE..MOST).contains(&frames)
            && (frames - frames.round()).abs() < WHOLE
        {
            jumps.push((*frame, frames.round(), (frames - frames.round()).abs()));
        }
    }
    // Fits beside a jump are disturbed by it: the sharpest of neighbours counts.
    let mut kept: Vec<(usize, f64, f64)> = Vec::new();
    for jump in jumps {
        match kept.last_mut() {
            Some(last) if jump.0 < last.0 + SIDE => {
                if (jump.1, -jump.2) > (last.1, -last.2) {
                    *last = jump;
                }
            }
            _ => kept.push(jump),
        }
    }
    if kept.is_empty() || kept.len() > MOST_PLACES {
        return;
    }
    let missing = kept.iter().map(|jump| jump.1 as usize).sum();
    base.breaks.extend(kept.iter().map(|jump| jump.0));
    base.findings.push(Finding::Dropped { frames: kept.iter().map(|jump| jump.0).collect(), missing });
}

fn changed(base: &mut TimeBase, boundaries: &[Boundary], noise: f64) {
    let mut speeds: Vec<f64> = boundaries.iter().map(|b| size(b.before.velocity)).collect();
    let usual = median(&mut speeds).unwrap_or(0.0);
    let mut best: Vec<(usize, f64)> = Vec::new();
    for Boundary { frame, before, after } in boundaries {
        let (u, v) = (size(before.velocity), size(after.velocity));
        let cosine = (before.velocity[0] * after.velocity[0] + before.velocity[1] * after.velocity[1]) / (u * v);
        let jump = size([0, 1].map(|axis| after.position[axis] - before.position[axis]));
        let (factor, sharp) = (v / u, (v / u).max(u / v));
        let fast = u.max(v) > (FAST * noise).max(TYPICAL * usual) && u.min(v) > 2.0 * noise;
        let smooth = |frame: Option<usize>| {
            let beside = boundaries.iter().find(|b| Some(b.frame) == frame);
            beside.is_some_and(|b| {
                let change = size([0, 1].map(|axis| b.after.velocity[axis] - b.before.velocity[axis]));
                change < SMOOTH * size(b.before.velocity).max(size(b.after.velocity)) + 2.0 * noise
            })
        };
        let sudden = smooth(frame.checked_sub(SIDE + 1)) && smooth(Some(frame + SIDE + 1));
        let clean = before.residual.max(after.residual) < RESIDUAL * noise;
        let elsewhere = base.breaks.iter().all(|cut| cut.abs_diff(*frame) > 2 * SIDE);
        if fast && sudden && clean && elsewhere && sharp > SPEED && cosine > ALIGNED && jump < 0.5 * u.max(v) {
            match best.last_mut() {
                Some(last) if *frame < last.0 + SIDE => {
                    if sharp > last.1.max(1.0 / last.1) {
                        *last = (*frame, factor);
                    }
                }
                _ => best.push((*frame, factor)),
            }
        }
    }
    let few = best.len() <= MOST_PLACES;
    for (frame, factor) in best.into_iter().filter(|_| few) {
        base.findings.push(Finding::SpeedChange { frame, factor });
        base.breaks.push(frame);
    }
    base.breaks.sort_unstable();
    base.breaks.dedup();
}

#[cfg(test)]
mod tests {
    use super::super::StatedTime;
    use super::*;
    use crate::quality::Quality;
    use crate::track::{Method, Point, Role, TrackPoint, Visibility};

    fn base(frames: usize) -> TimeBase {
        let times = Some((0..frames).map(|f| f as f64 / 30.0).collect());
        TimeBase::new(&StatedTime { times, ..StatedTime::default() }, None)
    }

    /// Track with noise of alternating sign, 0.1 pixels.
    fn track(positions: impl Iterator<Item = [f64; 2]>) -> Track {
        let point = |(frame, [x, y]): (usize, [f64; 2])| {
            let noise = if frame * 7 % 3 == 0 { 0.1 } else { -0.1 };
            let position = [x + noise, y - noise];
            let measurement = TrackPoint { position, covariance: [[0.01, 0.0], [0.0, 0.01]], method: Method::Template };
            Point {
                frame,
                visibility: Visibility::Visible,
                measurement: Some(measurement),
                centroid: None,
                misfit: None,
                contrast: None,
                diameter: None,
            }
        };
        Track {
            role: Role::Object,
            points: positions.enumerate().map(point).collect(),
            quality: Quality { jitter: Some([0.1, 0.1]), ..Quality::default() },
            diameter: 12.0,
            bin: 1,
        }
    }

    fn thrown(time: f64) -> [f64; 2] {
        [5.0 * time, 0.15 * (time - 30.0).powi(2)]
    }

    #[test]
    fn dropped_frames_are_found_and_cut() {
        let mut base = base(60);
        // Two frames are missing before frame 20, one before frame 41.
        let skipped = |frame: usize| frame + 2 * usize::from(frame >= 20) + usize::from(frame >= 41);
        base.follow(&track((0..60).map(|frame| thrown(skipped(frame) as f64))));
        assert_eq!(base.findings, [Finding::Dropped { frames: vec![20, 41], missing: 3 }]);
        assert_eq!(base.breaks, [20, 41]);
    }

    #[test]
    fn free_motion_and_bounces_give_no_finding() {
        for path in [
            thrown as fn(f64) -> [f64; 2],
            |t| [100.0 * (0.2 * t).cos(), 0.0],
            |t| {
                let u = t % 17.0 - 8.5;
                [3.0 * t, 0.8 * u * u]
            },
        ] {
            let mut base = base(80);
            base.follow(&track((0..80).map(|frame| path(frame as f64))));
            assert_eq!(base.findings, []);
        }
    }

    #[test]
    fn a_ramp_into_slow_motion_is_cut_at_both_ends() {
        let mut base = base(90);
        let mut time = 0.0;
        let positions: Vec<_> = (0..90)
            .map(|frame| {
                time += if (25..65).contains(&frame) { 0.25 } else { 1.0 };
                [20.0 * time, 0.0]
            })
            .collect();
        base.follow(&track(positions.into_iter()));
        let found: Vec<(usize, f64)> = base
            .findings
            .iter()
            .map(|finding| match finding {
                Finding::SpeedChange { frame, factor } => (*frame, *factor),
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!(found.len(), 2);
        assert!(found[0].0.abs_diff(25) <= 1 && (found[0].1 - 0.25).abs() < 0.05, "{found:?}");
        assert!(found[1].0.abs_diff(65) <= 1 && (found[1].1 - 4.0).abs() < 0.8, "{found:?}");
    }
}
