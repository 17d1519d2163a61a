//! Rolling shutter: rows of a frame are exposed one after the other, so an object is filmed earlier or later than its frame's
//! middle row.
//!
//! Positions are moved to the time of the middle row along the parabola through the neighbouring ones, so that all objects of a
//! frame share its time.

use crate::camera::CameraPath;
use crate::time_base::TimeBase;
use crate::track::Track;
use crate::video::Size;

/// Most frames between neighbours, over the usual time between frames: a parabola is local.
const NEAR: f64 = 2.5;

/// Corrects a track. `readout` is the time from the first to the last row of a frame, seconds; negative where the last row comes
/// first.
pub(crate) fn correct(track: &mut Track, camera: &CameraPath, time: &TimeBase, size: Size, readout: f64) {
    let Some(times) = &time.times else { return };
    // When each position was filmed, and when its frame's middle row was.
    let filmed: Vec<Option<(f64, f64, [f64; 2])>> = track
        .points
        .iter()
        .map(|point| {
            let position = point.measurement?.position;
            let row = camera.pose(point.frame)?.inverse().apply(position)[1];
            let share = (row + 0.5) / size.height as f64 - 0.5;
            let middle = *times.get(point.frame)?;
            Some((middle + share * readout, middle, position))
        })
        .collect();
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let Some(usual) = crate::statistics::median(&mut steps) else { return };
    for place in 0..filmed.len() {
        let Some((own, middle, position)) = filmed[place] else { continue };
        let beside = |other: Option<usize>| {
            let (time, _, position) = other.and_then(|other| filmed.get(other).copied()).flatten()?;
            ((time - own).abs() < NEAR * usual && time != own).then_some((time, position))
        };
        let neighbours = [beside(place.checked_sub(1)), beside(Some(place + 1))];
        let known: Vec<(f64, [f64; 2])> = neighbours.into_iter().flatten().chain([(own, position)]).collect();
        let moved = [0, 1].map(|axis| interpolated(&known, axis, middle));
        let point = &mut track.points[place];
        for place in point.measurement.iter_mut().map(|it| &mut it.position).chain(&mut point.centroid) {
            (0..2).for_each(|axis| place[axis] += moved[axis] - position[axis]);
        }
    }
}

/// Lagrange's polynomial through known values of an axis.
fn interpolated(known: &[(f64, [f64; 2])], axis: usize, time: f64) -> f64 {
    let weight = |own: usize| {
        let others = known.iter().enumerate().filter(|(other, _)| *other != own);
        others.map(|(_, (other, _))| (time - other) / (known[own].0 - other)).product::<f64>()
    };
    (0..known.len()).map(|own| weight(own) * known[own].1[axis]).sum()
}

#[cfg(test)]
mod tests {
    use crate::synthetic::{MovingEllipse, SyntheticScene};
    use crate::test_videos::Filmed;
    use crate::{TrackingOptions, track};

    const RATE: f64 = 30.0;

    /// Largest distance of a track from the true places at the middle rows' times, less its mean, for a ball that rises and
    /// falls through the whole frame.
    fn furthest(readout: Option<f64>) -> f64 {
        let truth = |time: f64| [60.0 + 120.0 * time, 210.0 - 420.0 * time + 250.0 * time * time];
        // The row at which a position is filmed decides when.
        let filmed = |frame: usize| {
            let middle = frame as f64 / RATE;
            let mut place = truth(middle);
            for _ in 0..20 {
                place = truth(middle + 0.02 * (place[1] / 240.0 - 0.5));
            }
            place
        };
        let scene = SyntheticScene { seed: 5, ..SyntheticScene::of(MovingEllipse::at((0..48).map(filmed).collect())) };
        let clip = Filmed::new(&scene, RATE);
        let found = track(&clip, &TrackingOptions { objects: 1, readout, ..TrackingOptions::default() }).unwrap();
        let points = found.tracks[0].points.iter().filter_map(|point| Some((point.frame, point.measurement?.position)));
        let away: Vec<[f64; 2]> = points
            .map(|(frame, [x, y])| {
                let place = truth(frame as f64 / RATE);
                [x - place[0], y - place[1]]
            })
            .collect();
        assert!(away.len() > 40);
        let mean = [0, 1].map(|axis| away.iter().map(|it| it[axis]).sum::<f64>() / away.len() as f64);
        away.iter().map(|it| (it[0] - mean[0]).hypot(it[1] - mean[1])).fold(0.0, f64::max)
    }

    #[test]
    fn a_fast_ball_is_put_where_it_was_at_the_time_of_its_frame() {
        // Up to 10 ms at 480 pixels a second.
        assert!(furthest(None) > 2.0);
        let corrected = furthest(Some(0.02));
        assert!(corrected < 0.6, "{corrected}");
    }
}
