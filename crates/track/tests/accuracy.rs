//! Accuracy and calibration on synthetic videos with known positions.

use paig_track::synthetic::{MovingEllipse, Shadow, SyntheticScene};
use paig_track::{CameraMotion, CameraPath, Clip, Method, Similarity, Size, Track, TrackingOptions, Visibility, track};

/// Errors of the visible frames along x and y, less their median (the template's centre is a convention), and the same in
/// units of the standard deviation.
fn errors(found: &Track, scene: &SyntheticScene) -> (Vec<[f64; 2]>, Vec<f64>) {
    let mut errors = Vec::new();
    let mut deviations = Vec::new();
    for point in found.points.iter().filter(|p| p.visibility == Visibility::Visible) {
        let measurement = point.measurement.unwrap();
        let truth = scene.movers[0].positions[point.frame];
        errors.push([0, 1].map(|axis| measurement.position[axis] - truth[axis]));
        deviations.push([0, 1].map(|axis| measurement.covariance[axis][axis].sqrt()));
    }
    let middle = [0, 1].map(|axis| median(errors.iter().map(|e| e[axis]).collect()));
    errors.iter_mut().for_each(|e| (0..2).for_each(|axis| e[axis] -= middle[axis]));
    let normalised = errors.iter().zip(&deviations).flat_map(|(e, d)| [e[0] / d[0], e[1] / d[1]]).collect();
    (errors, normalised)
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Median error and variance of the normalised errors of the first track.
fn accuracy(scene: &SyntheticScene) -> (f64, f64, Track) {
    let clip = Clip::new(scene.render()).unwrap();
    let first = track(&clip, &TrackingOptions::default()).unwrap().tracks.remove(0);
    let (errors, normalised) = errors(&first, scene);
    assert!(errors.len() * 10 >= scene.frames() * 8, "only {} frames are visible", errors.len());
    let size = median(errors.iter().map(|e| e[0].hypot(e[1])).collect());
    let variance = normalised.iter().map(|z| z * z).sum::<f64>() / normalised.len() as f64;
    println!("median error {size:.4} px, variance of normalised errors {variance:.3}, {:?}", first.quality);
    (size, variance, first)
}

fn pendulum(frames: usize) -> Vec<[f64; 2]> {
    let swing = |frame: usize| 0.6 * (frame as f64 * 0.13).cos() * (-0.004 * frame as f64).exp();
    (0..frames).map(|f| [160.3 + 150.0 * swing(f).sin(), 20.0 + 150.0 * swing(f).cos()]).collect()
}

fn throw(frames: usize) -> Vec<[f64; 2]> {
    (0..frames).map(|f| f as f64).map(|t| [30.2 + 5.1 * t, 200.4 - 8.0 * t + 0.16 * t * t]).collect()
}

#[test]
fn a_pendulum_before_a_textured_wall_is_found_to_a_tenth_of_a_pixel() {
    let scene = SyntheticScene::of(MovingEllipse::at(pendulum(120)));
    let (size, variance, found) = accuracy(&scene);
    assert!(size < 0.1, "{size}");
    assert!((0.5..1.6).contains(&variance), "{variance}");
    assert!(found.quality.registered > 0.95 && found.quality.misfit < 0.2 && found.quality.chance.unwrap() < 0.2);
}

#[test]
fn a_shadow_drift_and_flicker_do_not_move_a_thrown_ball() {
    let shadow = Shadow { offset: [14.0, 18.0], axes: [12.0, 9.0], light: 0.7 };
    let scene = SyntheticScene {
        drift: -0.15,
        flicker: 0.01,
        seed: 4,
        ..SyntheticScene::of(MovingEllipse { shadow: Some(shadow), ..MovingEllipse::at(throw(50)) })
    };
    let (size, variance, _) = accuracy(&scene);
    assert!(size < 0.1, "{size}");
    // 47 differences fix the noise to 15 % at best, and the shadow's penumbra moves the template slowly.
    assert!((0.4..3.0).contains(&variance), "{variance}");
}

/// Automatic exposure: brighter by 45 % at the end, so that a bright background saturates.
#[test]
fn a_large_change_of_exposure_does_not_hide_a_pendulum() {
    for background in [[120.0, 125.0, 118.0], [190.0, 200.0, 185.0]] {
        let scene = SyntheticScene { drift: 0.45, background, ..SyntheticScene::of(MovingEllipse::at(pendulum(120))) };
        let (size, _, _) = accuracy(&scene);
        assert!(size < 0.1, "{background:?}: {size}");
    }
}

#[test]
fn a_small_fast_ball_with_motion_blur_is_found() {
    let ball = MovingEllipse { axes: [4.0, 4.0], texture: 0.0, ..MovingEllipse::at(throw(50)) };
    let scene = SyntheticScene { shutter: 0.6, seed: 8, ..SyntheticScene::of(ball) };
    let (size, variance, _) = accuracy(&scene);
    assert!(size < 0.1, "{size}");
    assert!((0.4..2.0).contains(&variance), "{variance}");
}

#[test]
fn a_shaking_camera_is_held_still() {
    let scene = SyntheticScene { shake: 1.2, seed: 3, ..SyntheticScene::of(MovingEllipse::at(pendulum(60))) };
    let (size, _, _) = accuracy(&scene);
    assert!(size < 0.2, "{size}");
}

/// Rotation, scale and translation of the camera in each frame: a hand that trembles by some pixels and a few milliradians.
fn hand(frames: usize) -> Vec<[f64; 3]> {
    let wave = |f: usize, rate: f64, phase: f64| (f as f64 * rate + phase).sin();
    (0..frames).map(|f| [3.1 * wave(f, 0.31, 0.0), 2.3 * wave(f, 0.23, 1.0), 0.004 * wave(f, 0.17, 2.0)]).collect()
}

/// Median distance between the place of the frame's middle in the background and the true one, less the mean offset.
fn camera_error(found: &CameraPath, scene: &SyntheticScene) -> f64 {
    let middle = [160.0, 120.0];
    let offsets: Vec<[f64; 2]> = found
        .frames
        .clone()
        .map(|frame| {
            let [x, y, angle] = scene.camera[frame];
            let truth = Similarity { a: angle.cos(), b: angle.sin(), u: x, v: y }.inverse().apply(middle);
            let place = found.pose(frame).unwrap().apply(middle);
            [place[0] - truth[0], place[1] - truth[1]]
        })
        .collect();
    let mean = [0, 1].map(|axis| offsets.iter().map(|o| o[axis]).sum::<f64>() / offsets.len() as f64);
    median(offsets.iter().map(|o| (o[0] - mean[0]).hypot(o[1] - mean[1])).collect())
}

#[test]
fn a_hand_held_camera_is_registered_to_a_few_hundredths_of_a_pixel() {
    let scene = SyntheticScene { camera: hand(60), seed: 3, ..SyntheticScene::of(MovingEllipse::at(pendulum(60))) };
    let found = track(&Clip::new(scene.render()).unwrap(), &TrackingOptions::default()).unwrap();
    assert_eq!(found.camera.motion, CameraMotion::Trembling, "{}", found.camera.line());
    let error = camera_error(&found.camera, &scene);
    assert!(error < 0.05, "{error}");
    // Positions are those of the reference frame.
    let [x, y, angle] = scene.camera[found.camera.reference];
    let reference = Similarity { a: angle.cos(), b: angle.sin(), u: x, v: y };
    let positions = scene.movers[0].positions.iter().map(|p| reference.apply(*p)).collect();
    let (errors, _) = errors(&found.tracks[0], &SyntheticScene::of(MovingEllipse::at(positions)));
    let size = median(errors.iter().map(|e| e[0].hypot(e[1])).collect());
    assert!(size < 0.1, "{size}");
}

#[test]
fn a_camera_that_follows_a_thrown_ball_gives_its_path_on_the_background() {
    let positions: Vec<[f64; 2]> =
        (0..60).map(f64::from).map(|t| [60.0 + 9.0 * t, 200.0 - 6.0 * t + 0.1 * t * t]).collect();
    // The ball stays near the middle of the frame.
    let camera = positions.iter().map(|p| [140.0 - 0.9 * p[0], 20.0 - 0.1 * p[1], 0.0]).collect();
    let scene = SyntheticScene { camera, seed: 5, ..SyntheticScene::of(MovingEllipse::at(positions)) };
    let found = track(&Clip::new(scene.render()).unwrap(), &TrackingOptions::default()).unwrap();
    assert_eq!(found.camera.motion, CameraMotion::Panning, "{}", found.camera.line());
    // Each frame hangs on edges of its own part of the background.
    let error = camera_error(&found.camera, &scene);
    assert!(error < 0.2, "{error}");
    let (size, _, _) = accuracy(&scene);
    assert!(size < 0.3, "{size}");
}

#[test]
fn a_large_object_before_a_standing_camera_does_not_move_it() {
    let positions = (0..50).map(|f| [60.0 + 4.0 * f64::from(f), 120.0]).collect();
    let scene = SyntheticScene::of(MovingEllipse { axes: [70.0, 90.0], texture: 50.0, ..MovingEllipse::at(positions) });
    let found = track(&Clip::new(scene.render()).unwrap(), &TrackingOptions::default()).unwrap();
    assert_eq!(found.camera.motion, CameraMotion::Standing, "{}", found.camera.line());
}

#[test]
fn a_cut_leaves_the_longest_scene() {
    let one = SyntheticScene::of(MovingEllipse::at(pendulum(30))).render();
    let other = SyntheticScene {
        seed: 77,
        background: [60.0, 190.0, 90.0],
        ..SyntheticScene::of(MovingEllipse::at(pendulum(60)))
    }
    .render();
    let both = ndarray::concatenate(ndarray::Axis(0), &[one.view(), other.view()]).unwrap();
    let found = track(&Clip::new(both).unwrap(), &TrackingOptions::default()).unwrap();
    assert_eq!((found.camera.frames.clone(), &found.camera.cuts[..]), (30..90, &[30][..]));
    assert_eq!(found.tracks[0].points[0].frame, 30);
}

#[test]
fn an_object_that_rests_in_most_frames_is_removed_from_the_background() {
    let mut positions = vec![[100.0, 120.0]; 60];
    positions.extend((0..40).map(|f| [100.0 + 4.0 * f64::from(f), 120.0]));
    let scene = SyntheticScene { seed: 6, ..SyntheticScene::of(MovingEllipse::at(positions)) };
    let (size, _, found) = accuracy(&scene);
    assert!(size < 0.1, "{size}");
    assert!(found.points.iter().all(|p| p.visibility == Visibility::Visible));
}

#[test]
fn frames_are_flagged_while_the_object_enters_and_before() {
    let positions = (0..60).map(|f| [-40.0 + 4.0 * f64::from(f), 100.0]).collect();
    let scene = SyntheticScene {
        size: Size { width: 240, height: 180 },
        seed: 9,
        ..SyntheticScene::of(MovingEllipse::at(positions))
    };
    let found = track(&Clip::new(scene.render()).unwrap(), &TrackingOptions::default()).unwrap().tracks.remove(0);
    assert_eq!(found.points[2].visibility, Visibility::Absent);
    assert_eq!(found.points[2].measurement, None);
    // The disc of 12 pixels is half outside at frame 10 and inside from frame 13 on.
    assert_eq!(found.points[10].visibility, Visibility::CutOff);
    assert!((20..50).all(|f| found.points[f].visibility == Visibility::Visible));
    assert_eq!(found.points[30].measurement.unwrap().method, Method::Template);
}

/// A mass that swings by less than its own size: its middle covers the background in every frame.
#[test]
fn a_swing_smaller_than_the_object_has_its_true_amplitude() {
    for (radius, texture, amplitude) in [(12.0, 0.0, 0.2), (12.0, 20.0, 0.7), (25.0, 0.0, 1.0), (25.0, 20.0, 0.4)] {
        let swing: Vec<f64> = (0..80).map(|frame| radius * amplitude * (0.31 * f64::from(frame)).sin()).collect();
        let positions = swing.iter().map(|y| [150.2, 110.3 + y]).collect();
        let mass = MovingEllipse { axes: [radius, radius], texture, ..MovingEllipse::at(positions) };
        let (size, _, found) = accuracy(&SyntheticScene::of(mass));
        assert!(size < 0.1, "radius {radius}, amplitude {amplitude}: {size}");
        let seen = |frame: usize| found.points[frame].measurement.map(|it| it.position[1] - 110.3);
        let pairs: Vec<(f64, f64)> = (0..80).filter_map(|frame| Some((swing[frame], seen(frame)?))).collect();
        let gain = pairs.iter().map(|(x, y)| x * y).sum::<f64>() / pairs.iter().map(|(x, _)| x * x).sum::<f64>();
        assert!((gain - 1.0).abs() < 0.02, "radius {radius}, amplitude {amplitude}: {gain} of the true amplitude");
    }
}
