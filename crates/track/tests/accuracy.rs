//! Accuracy and calibration on synthetic videos with known positions.

use paig_track::synthetic::{Scene, Shadow};
use paig_track::{Clip, Method, Options, Size, Track, Visibility, track};

/// Errors of the visible frames along x and y, less their median (the template's centre is a convention), and the same in
/// units of the standard deviation.
fn errors(found: &Track, scene: &Scene) -> (Vec<[f64; 2]>, Vec<f64>) {
    let mut errors = Vec::new();
    let mut deviations = Vec::new();
    for point in found.points.iter().filter(|p| p.visibility == Visibility::Visible) {
        let measurement = point.measurement.unwrap();
        let truth = scene.positions[point.frame];
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
fn accuracy(scene: &Scene) -> (f64, f64, Track) {
    let clip = Clip::new(scene.render()).unwrap();
    let first = track(&clip, &Options::default()).unwrap().tracks.remove(0);
    let (errors, normalised) = errors(&first, scene);
    assert!(errors.len() * 10 >= scene.positions.len() * 8, "only {} frames are visible", errors.len());
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
    let scene = Scene { positions: pendulum(120), ..Scene::default() };
    let (size, variance, found) = accuracy(&scene);
    assert!(size < 0.1, "{size}");
    assert!((0.5..1.6).contains(&variance), "{variance}");
    assert!(found.quality.registered > 0.95 && found.quality.misfit < 0.2 && found.quality.chance.unwrap() < 0.2);
}

#[test]
fn a_shadow_drift_and_flicker_do_not_move_a_thrown_ball() {
    let scene = Scene {
        positions: throw(50),
        shadow: Some(Shadow { offset: [14.0, 18.0], axes: [12.0, 9.0], light: 0.7 }),
        drift: -0.15,
        flicker: 0.01,
        seed: 4,
        ..Scene::default()
    };
    let (size, variance, _) = accuracy(&scene);
    assert!(size < 0.1, "{size}");
    // 47 differences fix the noise to 15 % at best, and the shadow's penumbra moves the template slowly.
    assert!((0.4..3.0).contains(&variance), "{variance}");
}

#[test]
fn a_small_fast_ball_with_motion_blur_is_found() {
    let scene =
        Scene { positions: throw(50), axes: [4.0, 4.0], shutter: 0.6, texture: 0.0, seed: 8, ..Scene::default() };
    let (size, variance, _) = accuracy(&scene);
    assert!(size < 0.1, "{size}");
    assert!((0.4..2.0).contains(&variance), "{variance}");
}

#[test]
fn a_shaking_camera_is_held_still() {
    let scene = Scene { positions: pendulum(60), shake: 1.2, seed: 3, ..Scene::default() };
    let (size, _, _) = accuracy(&scene);
    assert!(size < 0.2, "{size}");
}

#[test]
fn an_object_that_rests_in_most_frames_is_removed_from_the_background() {
    let mut positions = vec![[100.0, 120.0]; 60];
    positions.extend((0..40).map(|f| [100.0 + 4.0 * f64::from(f), 120.0]));
    let scene = Scene { positions, seed: 6, ..Scene::default() };
    let (size, _, found) = accuracy(&scene);
    assert!(size < 0.1, "{size}");
    assert!(found.points.iter().all(|p| p.visibility == Visibility::Visible));
}

#[test]
fn frames_are_flagged_while_the_object_enters_and_before() {
    let positions = (0..60).map(|f| [-40.0 + 4.0 * f64::from(f), 100.0]).collect();
    let scene = Scene { positions, size: Size { width: 240, height: 180 }, seed: 9, ..Scene::default() };
    let found = track(&Clip::new(scene.render()).unwrap(), &Options::default()).unwrap().tracks.remove(0);
    assert_eq!(found.points[2].visibility, Visibility::Absent);
    assert_eq!(found.points[2].measurement, None);
    // The disc of 12 pixels is half outside at frame 10 and inside from frame 13 on.
    assert_eq!(found.points[10].visibility, Visibility::CutOff);
    assert!((20..50).all(|f| found.points[f].visibility == Visibility::Visible));
    assert_eq!(found.points[30].measurement.unwrap().method, Method::Template);
}
