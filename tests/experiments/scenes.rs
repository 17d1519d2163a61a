//! How scenes look: each effect against its definition, and the stress suite's files.

use crate::project::project;
use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use image::{Rgb, RgbImage};
use ndarray::{Array4, Array5, ArrayView3, Axis, s};
use paig::datasets::settings::{NoiseFloor, Provenance};
use paig::datasets::states::States;
use paig::generators::effects::blur::blur;
use paig::generators::film::Film;
use paig::generators::noise_floor::noise_floor as measured;
use paig::generators::source_images::SourceImages;
use paig::generators::variant::Variant;
use paig::generators::{Counts, generate_clips};
use paig::tasks::{self, Task};
use paig_experiments::stress::{StressList, SuiteScene};

const CLIPS: usize = 40;
const FRAMES: usize = 10;
/// A uniform grey of 127.5, which is cut off to 127.
const GREY: &str = "[scene.background]\nkind = \"plain\"\nbrightness = 0.5\n";

fn configs() -> PathBuf {
    project("configs")
}

/// A built-in task under another name with more tables in its file.
fn with(task: &str, tables: &str) -> anyhow::Result<Task> {
    let text = fs::read_to_string(configs().join(format!("tasks/{task}.toml")))?;
    Task::from_toml(&(text.replace(&format!("name = \"{task}\""), "name = \"another\"") + "\n" + tables))
}

fn variant(task: &str, tables: &str) -> Variant {
    Variant::new(&with(task, tables).unwrap(), 5).unwrap()
}

/// The training clips of a scene, uint8 `[clips, frames, S, S, channels]`, and all states.
fn film(task: &str, tables: &str) -> (Array5<u8>, States) {
    let variant = variant(task, tables);
    let images = SourceImages::of(&variant).unwrap();
    let counts = Counts { train: CLIPS, valid: 1, test: 1 };
    let (dataset, states) = generate_clips(&variant, &images, FRAMES, counts, &|_| {}).unwrap();
    (dataset.train, states)
}

/// True position of an object, pixels.
fn position(states: &States, clip: usize, frame: usize, object: usize) -> [f64; 2] {
    [0, 1].map(|axis| f64::from(states.train.positions[[clip, frame, 2 * object + axis]]))
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Mean and standard deviation.
fn statistics(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (mean, (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt())
}

/// Light of each frame, all channels together.
fn sums(clips: &Array5<u8>) -> Vec<f64> {
    let frames = clips
        .outer_iter()
        .flat_map(|clip| clip.outer_iter().map(|frame| frame.mapv(f64::from).sum()).collect::<Vec<_>>());
    frames.collect()
}

/// Difference of two films of the same clips where the first is of this level: off the balls and their edges.
fn differences_where(level: u8, plain: &Array5<u8>, other: &Array5<u8>) -> Vec<f64> {
    let both = plain.iter().zip(other).filter(|(plain, _)| **plain == level);
    both.map(|(plain, other)| f64::from(*other) - f64::from(*plain)).collect()
}

#[test]
fn the_same_motion_is_seen_under_every_look() {
    let (plain_frames, plain) = film("spring_color", "");
    let camera = "[scene.camera]\nnoise = 10.0\nflicker = 20.0\ngradient = 20.0\nshake = 2\nblur = 1.0\n\
                  salt_and_pepper = 1.0\njpeg = 50";
    for tables in [
        "[scene.objects]\ncolours = [[0.5, 0.5, 0.5], [0.7, 0.7, 0.7]]\nshading = 0.5\nocclude = true",
        GREY,
        "[scene.background]\nkind = \"random_texture\"",
        "[scene.background]\nkind = \"drifting\"",
        "[[scene.distractors]]\ncolour = [1.0, 0.0, 1.0]\nradius = 2.0\nspeed = 5.0",
        camera,
    ] {
        let (frames, states) = film("spring_color", tables);
        let same = (&states.train, &states.valid, &states.test) == (&plain.train, &plain.valid, &plain.test);
        assert!(same && states.truth == plain.truth, "{tables}");
        assert_ne!(frames, plain_frames, "{tables}");
    }
    assert_eq!(film("spring_color", camera).0, film("spring_color", camera).0);
}

#[test]
fn one_effect_more_changes_nothing_about_the_others() {
    let grey_and = |camera: &str| film("spring_color", &format!("{GREY}[scene.camera]\n{camera}")).0;
    let (noise, both) = (grey_and("noise = 5.0"), grey_and("noise = 5.0\nsalt_and_pepper = 10.0"));
    let changed = noise.iter().zip(&both).filter(|(a, b)| a != b);
    assert!(changed.clone().count() > noise.len() / 20);
    assert!(changed.into_iter().all(|(_, speckled)| [0, 255].contains(speckled)));
}

#[test]
fn noise_has_its_mean_and_deviation_and_is_new_in_each_pixel() {
    let (plain, _) = film("spring_color", GREY);
    let (noisy, _) = film("spring_color", &format!("{GREY}[scene.camera]\nnoise = 10.0"));
    let differences = differences_where(127, &plain, &noisy);
    let count = differences.len() as f64;
    assert!(count > 1e6, "{count}");
    let (mean, deviation) = statistics(&differences);
    // Cutting off after the decimal point adds 1/12 to the variance. Five standard errors of each.
    let expected = (100.0_f64 + 1.0 / 12.0).sqrt();
    assert!(mean.abs() < 5.0 * expected / count.sqrt(), "mean {mean}");
    assert!((deviation - expected).abs() < 5.0 * expected / (2.0 * count).sqrt(), "standard deviation {deviation}");
    let correlation = differences.windows(2).map(|pair| pair[0] * pair[1]).sum::<f64>() / count / 100.0;
    assert!(correlation.abs() < 5.0 / count.sqrt(), "neighbours correlate by {correlation}");
    // What falls outside is cut off: on black half of the noise stays.
    let (black, _) = film("spring_color", "[scene.camera]\nnoise = 10.0");
    let dark = black.iter().filter(|&&level| level == 0).count() as f64 / black.len() as f64;
    assert!((0.45..0.6).contains(&dark), "{dark} of the pixels are black");
}

#[test]
fn flicker_is_one_factor_a_frame() {
    // No level is cut off: half grey balls on a darker grey.
    let scene = "[scene.objects]\ncolours = [[0.6, 0.6, 0.6], [0.7, 0.7, 0.7]]\n\
                 [scene.background]\nkind = \"plain\"\nbrightness = 0.4\n";
    let (plain, _) = film("spring_color", scene);
    let (flickering, _) = film("spring_color", &format!("{scene}[scene.camera]\nflicker = 30.0"));
    let factors: Vec<f64> = sums(&flickering).iter().zip(sums(&plain)).map(|(other, plain)| other / plain).collect();
    // Cutting off moves a level of 102 by up to 1.
    assert!(factors.iter().all(|factor| (0.69..1.31).contains(factor)));
    let (mean, deviation) = statistics(&factors);
    // Uniform between 0.7 and 1.3: standard deviation 0.3 / sqrt(3) = 0.173; 400 frames.
    assert!((mean - 1.0).abs() < 0.04 && (deviation - 0.173).abs() < 0.02, "mean {mean}, deviation {deviation}");
    let levels = |clips: &Array5<u8>| {
        clips.exact_chunks((1, 1, 32, 32, 3)).into_iter().map(|frame| frame.to_owned()).collect::<Vec<_>>()
    };
    for ((plain, other), factor) in levels(&plain).iter().zip(levels(&flickering)).zip(factors) {
        let off = plain.iter().zip(&other).map(|(plain, other)| (f64::from(*plain) * factor - f64::from(*other)).abs());
        assert!(off.fold(0.0, f64::max) < 2.5);
    }
}

#[test]
fn a_gradient_has_its_slope_and_wanders() {
    let (plain, _) = film("falling", GREY);
    let (lit, _) = film("falling", &format!("{GREY}[scene.camera]\ngradient = 25.0"));
    let (mut slopes, mut turns) = (Vec::new(), Vec::new());
    for (plain, lit) in plain.outer_iter().zip(lit.outer_iter()) {
        let mut before = None;
        for (plain, lit) in plain.outer_iter().zip(lit.outer_iter()) {
            // Least squares of (factor - 1) on the place, in half sides, over the plain grey pixels.
            let mut sum = [0.0; 5];
            for ((row, column, _), _) in plain.indexed_iter().filter(|(_, level)| **level == 127) {
                let [x, y] = [column, row].map(|pixel| (pixel as f64 + 0.5) / 16.0 - 1.0);
                let more = (f64::from(lit[[row, column, 0]]) + 0.5) / 127.5 - 1.0;
                sum = [sum[0] + x * x, sum[1] + x * y, sum[2] + y * y, sum[3] + x * more, sum[4] + y * more];
            }
            let [xx, xy, yy, xm, ym] = sum;
            let slope = [(xm * yy - ym * xy) / (xx * yy - xy * xy), (ym * xx - xm * xy) / (xx * yy - xy * xy)];
            slopes.push(slope[0].hypot(slope[1]));
            let angle = slope[1].atan2(slope[0]);
            turns.extend(before.map(|before: f64| {
                (angle - before + 3.0 * std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI
            }));
            before = Some(angle);
        }
    }
    assert!(slopes.iter().all(|slope| (slope - 0.25).abs() < 0.005), "{slopes:?}");
    let (mean, deviation) = statistics(&turns);
    // 360 turns of standard deviation 0.3 rad.
    assert!(mean.abs() < 0.08 && (deviation - 0.3).abs() < 0.06, "mean {mean}, deviation {deviation}");
}

#[test]
fn blur_spreads_a_point_by_its_deviation_and_keeps_its_light() {
    let side = 33;
    let mut frame = vec![0.0; side * side];
    frame[16 * side + 16] = 1.0;
    let mut film = Film { side, channels: 1, frames: vec![frame] };
    blur(&mut film, 1.2);
    let spread = |along: fn(usize, usize) -> usize| {
        let squares = film.frames[0].iter().enumerate();
        squares.map(|(pixel, light)| light * (along(pixel, 33) as f64 - 16.0).powi(2)).sum::<f64>()
    };
    assert!((film.frames[0].iter().sum::<f64>() - 1.0).abs() < 1e-12);
    // The bell is cut off at 4 standard deviations and sampled at whole pixels.
    for variance in [spread(|pixel, side| pixel % side), spread(|pixel, side| pixel / side)] {
        assert!((variance - 1.44).abs() < 0.01, "{variance}");
    }
    // The border's pixels go on outside: a bright frame stays as it is.
    let mut bright = Film { side, channels: 1, frames: vec![vec![0.7; side * side]] };
    blur(&mut bright, 3.0);
    assert!(bright.frames[0].iter().all(|level| (level - 0.7).abs() < 1e-12));
}

/// The frame moved to the right and down, its border pixels repeated.
fn shifted(frame: ArrayView3<u8>, right: i64, down: i64) -> ndarray::Array3<u8> {
    let side = frame.dim().0 as i64;
    let from = |pixel: usize, shift: i64| (pixel as i64 - shift).clamp(0, side - 1) as usize;
    ndarray::Array3::from_shape_fn(frame.dim(), |(row, column, channel)| {
        frame[[from(row, down), from(column, right), channel]]
    })
}

#[test]
fn shaken_frames_are_shifted_by_whole_pixels() {
    let scene = "[scene.background]\nkind = \"texture\"\n";
    let (plain, _) = film("spring_color", scene);
    let (shaken, _) = film("spring_color", &format!("{scene}[scene.camera]\nshake = 2"));
    let mut seen = BTreeMap::new();
    for (plain, shaken) in plain.outer_iter().zip(shaken.outer_iter()) {
        for (plain, shaken) in plain.outer_iter().zip(shaken.outer_iter()) {
            let shifts: Vec<_> = (-2..=2).flat_map(|right| (-2..=2).map(move |down| (right, down))).collect();
            let fits = shifts.into_iter().filter(|&(right, down)| shifted(plain, right, down) == shaken);
            let found: Vec<_> = fits.collect();
            assert_eq!(found.len(), 1);
            *seen.entry(found[0]).or_insert(0) += 1;
        }
    }
    // 400 frames, 16 expected of each of the 25: fewer than 3 come once in 10^5 tries.
    assert!(seen.len() == 25 && seen.values().all(|&count| count >= 3), "{seen:?}");
}

#[test]
fn salt_and_pepper_take_their_share_of_the_pixels() {
    let (plain, _) = film("spring_color", GREY);
    let (speckled, _) = film("spring_color", &format!("{GREY}[scene.camera]\nsalt_and_pepper = 4.0"));
    let (mut all, mut salt, mut pepper) = (0.0_f64, 0.0, 0.0);
    for (plain, pixel) in plain.rows().into_iter().zip(speckled.rows()) {
        if plain.iter().any(|&level| level != 127) {
            continue;
        }
        all += 1.0;
        match pixel.as_slice().unwrap() {
            [255, 255, 255] => salt += 1.0,
            [0, 0, 0] => pepper += 1.0,
            others => assert_eq!(others, [127; 3]),
        }
    }
    // 380 000 pixels: a standard error of 0.02 per cent.
    for share in [salt / all, pepper / all] {
        assert!((share - 0.02).abs() < 0.0012, "{share}");
    }
}

#[test]
fn jpeg_changes_frames_less_the_higher_its_quality() {
    for task in ["spring_color", "falling"] {
        let (plain, _) = film(task, GREY);
        let error = |quality: u8| {
            let (compressed, _) = film(task, &format!("{GREY}[scene.camera]\njpeg = {quality}"));
            let squares = plain.iter().zip(&compressed).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
            (squares.sum::<f64>() / plain.len() as f64).sqrt()
        };
        let [worst, middle, best] = [10, 40, 100].map(error);
        // Grey levels; a frame's own contrast is some 20.
        assert!(best < middle && middle < worst, "{task}: {best} {middle} {worst}");
        assert!(best > 0.0 && best < 2.0 && middle > 1.0 && middle < 10.0, "{task}: {best} {middle} {worst}");
    }
}

#[test]
fn a_nearer_ball_covers_the_other_in_all_channels() {
    let radii = "radii = [5.0, 5.0]\n";
    let (lights, states) = film("bouncing_balls", &format!("[scene.objects]\n{radii}"));
    let (opaque, _) = film("bouncing_balls", &format!("[scene.objects]\n{radii}occlude = true"));
    let (on_grey, _) = film("bouncing_balls", &format!("[scene.objects]\n{radii}{GREY}"));
    let mut overlaps = 0;
    for clip in 0..CLIPS {
        for frame in 0..FRAMES {
            let [far, near] = [0, 1].map(|ball| position(&states, clip, frame, ball));
            let inside = near.iter().all(|x| (2.0..30.0).contains(x));
            // The middle of the nearer one, at least 2 px from the farther one's edge.
            if !inside || distance(far, near) > 3.0 {
                continue;
            }
            overlaps += 1;
            let middle = |clips: &Array5<u8>| {
                [0, 1, 2].map(|channel| clips[[clip, frame, near[1] as usize, near[0] as usize, channel]])
            };
            // The first ball is blue, the second green.
            let of_green = |[red, green, blue]: [u8; 3]| red < 3 && green > 250 && blue < 3;
            assert!(of_green(middle(&opaque)) && of_green(middle(&on_grey)), "{:?}", middle(&opaque));
            let [_, green, blue] = middle(&lights);
            assert!(green > 250 && blue > 250);
        }
    }
    assert!(overlaps >= 4, "{overlaps} overlaps");
}

#[test]
fn balls_have_their_own_colours_and_radii() {
    let (frames, states) =
        film("spring_color", "[scene.objects]\ncolours = [[1.0, 0.2, 0.0], [0.0, 0.4, 1.0]]\nradii = [1.5, 3.5]");
    // Red is the first ball's alone, blue the second's. Area times level; the border's blur adds a little.
    for (object, channel, radius) in [(0, 0, 1.5_f64), (1, 2, 3.5)] {
        let light: Vec<f64> = frames
            .slice(s![.., .., .., .., channel])
            .outer_iter()
            .flat_map(|clip| clip.outer_iter().map(|frame| frame.mapv(f64::from).sum() / 255.0).collect::<Vec<_>>())
            .collect();
        let (mean, _) = statistics(&light);
        let area = std::f64::consts::PI * radius * radius;
        assert!((mean / area - 1.0).abs() < 0.06, "radius {radius}: {mean} for {area}");
        let inside =
            (0..CLIPS).filter(|&clip| distance(position(&states, clip, 0, 0), position(&states, clip, 0, 1)) > 6.0);
        for clip in inside {
            let [x, y] = position(&states, clip, 0, object).map(|x| x as usize);
            let [red, green, blue] = [0, 1, 2].map(|channel| f64::from(frames[[clip, 0, y, x, channel]]));
            let strong = [red, blue][object];
            // The middle of a ball of 1.5 px is blurred with what is around it.
            assert!(strong > 200.0 && ((green / strong) - [0.2, 0.4][object]).abs() < 0.02, "{red} {green} {blue}");
        }
    }
}

/// Level of a channel at this place of a clip's first frame.
fn level_at(frames: &Array5<u8>, clip: usize, [x, y]: [f64; 2], channel: usize) -> f64 {
    f64::from(frames[[clip, 0, y as usize, x as usize, channel]])
}

#[test]
fn shaded_balls_are_brighter_at_the_upper_left_and_halves_lie_where_they_should() {
    let (shaded, states) = film("falling", "[scene.objects]\nradii = [4.0]\nshading = 0.8");
    let halves = "halves = [{ colour = [0.0, 0.0, 1.0], towards = 0.0 }, { colour = [0.0, 0.0, 1.0], towards = 90.0 }]";
    let colours = "colours = [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]";
    let (halved, springs) = film("spring_color", &format!("[scene.objects]\nradii = [4.0, 4.0]\n{colours}\n{halves}"));
    let mut apart = 0;
    for clip in 0..CLIPS {
        let [x, y] = position(&states, clip, 0, 0);
        let [bright, dark] = [-2.0, 2.0].map(|off| level_at(&shaded, clip, [x + off, y + off], 0));
        // 2.8 px from the middle of 4, along the light: 0.85 of the way to each edge, within a pixel.
        let expected = [-2.83, 2.83].map(|away: f64| 255.0 * (1.0 - 0.8 * (1.0 + away / 4.0) / 2.0));
        assert!(
            (bright - expected[0]).abs() < 30.0 && (dark - expected[1]).abs() < 30.0,
            "{bright} {dark} {expected:?}"
        );
        let balls = [0, 1].map(|ball| position(&springs, clip, 0, ball));
        if distance(balls[0], balls[1]) < 9.0 {
            continue;
        }
        apart += 1;
        let offsets = [[2.0, 0.0], [0.0, 2.0]];
        for (ball, [dx, dy]) in balls.into_iter().zip(offsets) {
            let [blue_side, red_side] = [1.0, -1.0].map(|sign| [ball[0] + sign * dx, ball[1] + sign * dy]);
            assert!(level_at(&halved, clip, blue_side, 2) > 200.0 && level_at(&halved, clip, blue_side, 0) < 55.0);
            assert!(level_at(&halved, clip, red_side, 0) > 200.0 && level_at(&halved, clip, red_side, 2) < 55.0);
        }
    }
    assert!(apart > 10, "{apart}");
}

#[test]
fn a_thing_that_stands_still_is_where_it_should_be() {
    let (plain, states) = film("spring_color", "");
    let still = "[[scene.distractors]]\ncolour = [1.0, 0.0, 0.0]\nradius = 3.0\nposition = [22.0, 10.0]";
    let (frames, _) = film("spring_color", still);
    for (at, pixel) in frames.indexed_iter() {
        let place = [at.3 as f64 + 0.5, at.2 as f64 + 0.5];
        match distance(place, [22.0, 10.0]) {
            // Half a canvas pixel of rounding, and the blur of drawing.
            far if far > 6.0 => assert!(pixel.abs_diff(plain[at]) <= 1, "{at:?}"),
            near if near < 1.0 && at.4 == 0 && clear(&states, at.0, at.1, [22.0, 10.0]) => {
                assert!(*pixel > 250, "{at:?}")
            }
            _ => {}
        }
    }
    // A ball before it covers it.
    let mut before = 0;
    for (clip, at) in (0..CLIPS).flat_map(|clip| (0..FRAMES).map(move |frame| (clip, frame))) {
        let ball = position(&states, clip, at, 1);
        if distance(ball, [22.0, 10.0]) < 2.0 {
            let [red, green] = [0, 1].map(|channel| frames[[clip, at, ball[1] as usize, ball[0] as usize, channel]]);
            assert!(red < 30 && green > 225, "{red} {green}");
            before += 1;
        }
    }
    assert!(before > 0);
    // Without a position each clip has a place of its own.
    let (frames, _) = film("spring_color", "[[scene.distractors]]\ncolour = [1.0, 0.0, 0.0]\nradius = 3.0");
    let mut places = Vec::new();
    for clip in 0..CLIPS {
        let centres = (0..FRAMES).map(|frame| (frame, red_centre(&frames, clip, frame)));
        let seen: Vec<_> = centres.filter(|(frame, place)| clear(&states, clip, *frame, *place)).collect();
        assert!(seen.iter().all(|(_, place)| distance(*place, seen[0].1) < 0.1), "{seen:?}");
        places.extend(seen.first().map(|(_, place)| place[0]));
    }
    let (_, spread) = statistics(&places);
    assert!(places.len() > CLIPS / 2 && spread > 4.0, "{spread}");
}

/// Whether no ball of the spring touches a distractor of up to 3 px there.
fn clear(states: &States, clip: usize, frame: usize, place: [f64; 2]) -> bool {
    (0..2).all(|ball| distance(position(states, clip, frame, ball), place) > 7.0)
}

/// Centre of the light in the red channel, which no ball of the spring shines in.
fn red_centre(frames: &Array5<u8>, clip: usize, frame: usize) -> [f64; 2] {
    let red = frames.slice(s![clip, frame, .., .., 0]);
    let light = red.mapv(f64::from);
    let mean = |along: fn((usize, usize)) -> usize| {
        light.indexed_iter().map(|(at, light)| light * (along(at) as f64 + 0.5)).sum::<f64>() / light.sum()
    };
    [mean(|(_, column)| column), mean(|(row, _)| row)]
}

#[test]
fn a_moving_distractor_has_a_path_of_its_own() {
    let moving = "[[scene.distractors]]\ncolour = [1.0, 0.0, 0.0]\nradius = 2.0\nspeed = 6.0\n";
    let (frames, states) = film("spring_color", moving);
    let (mut straight, mut steps) = (0, 0);
    for clip in 0..CLIPS {
        let path: Vec<_> = (0..FRAMES).map(|frame| red_centre(&frames, clip, frame)).collect();
        for (frame, pair) in path.windows(2).enumerate() {
            let off_walls = pair.iter().flatten().all(|x| (4.5..27.5).contains(x));
            steps += 1;
            // 6 px a time unit, 0.3 of them a frame; canvas pixels of 0.1 px.
            if off_walls && (0..2).all(|more| clear(&states, clip, frame + more, pair[more])) {
                assert!((distance(pair[0], pair[1]) - 1.8).abs() < 0.2, "{pair:?}");
                straight += 1;
            }
        }
        assert!((0..2).all(|ball| distance(path[0], position(&states, clip, 0, ball)) > 1e-3));
    }
    assert!(straight > steps / 5, "{straight} of {steps}");
    // One more distractor changes nothing about the first.
    let two = format!("{moving}{}", moving.replace("[1.0, 0.0, 0.0]", "[0.0, 0.5, 0.5]"));
    let (both, _) = film("spring_color", &two);
    let (mut covered, mut kept) = (0, 0);
    for (one, two) in frames.rows().into_iter().zip(both.rows()) {
        // The second one lies before the first; where its edge is too faint for a grey level of its own, it may take 2
        // of the other's.
        if two[1] == one[1] && two[2] == one[2] {
            kept += 1;
            assert!(two[0].abs_diff(one[0]) <= 3);
        } else {
            covered += 1;
        }
    }
    assert!(kept > 20 * covered && covered > 0, "{covered} of {kept}");
}

/// Pixels of the first frame of each clip.
fn first_frames(frames: &Array5<u8>) -> Array4<u8> {
    frames.index_axis(Axis(1), 0).to_owned()
}

#[test]
fn textures_are_one_or_many() {
    for task in ["spring_color", "falling", "mnist_spring_color"] {
        let (one, _) = film(task, "[scene.background]\nkind = \"texture\"\nbrightness = 0.6");
        let (many, _) = film(task, "[scene.background]\nkind = \"random_texture\"\nbrightness = 0.6");
        let share_equal = |frames: &Array5<u8>, clip: usize| {
            let firsts = first_frames(frames);
            let pixels = firsts.index_axis(Axis(0), 0).len() as f64;
            let both = firsts.index_axis(Axis(0), 0).to_owned();
            both.iter().zip(firsts.index_axis(Axis(0), clip)).filter(|(a, b)| a == b).count() as f64 / pixels
        };
        for clip in 1..CLIPS {
            assert!(share_equal(&one, clip) > 0.6, "{task}: {}", share_equal(&one, clip));
            assert!(share_equal(&many, clip) < 0.3, "{task}: {}", share_equal(&many, clip));
        }
        // Flat areas and edges, no brighter than was said: 0.6 is level 153.
        let firsts = first_frames(&many);
        let dim = firsts.iter().filter(|&&level| level <= 153).count() as f64 / firsts.len() as f64;
        assert!(dim > 0.85, "{dim}");
        let (_, deviation) = statistics(&firsts.iter().map(|&level| f64::from(level)).collect::<Vec<_>>());
        assert!(deviation > 25.0, "{deviation}");
    }
}

#[test]
fn a_drifting_background_changes_slowly() {
    let (frames, _) = film("falling", "[scene.background]\nkind = \"drifting\"\nbrightness = 0.6\ndrift = 0.5");
    // Median over the pixels: off the ball.
    let change = |clip: usize, a: usize, b: usize| {
        let mut changes: Vec<u8> = frames
            .slice(s![clip, a, .., .., 0])
            .iter()
            .zip(frames.slice(s![clip, b, .., .., 0]))
            .map(|(a, b)| a.abs_diff(*b))
            .collect();
        changes.sort_unstable();
        f64::from(changes[changes.len() / 2])
    };
    let mean = |change: &dyn Fn(usize) -> f64| (0..CLIPS).map(change).sum::<f64>() / CLIPS as f64;
    let (next, later) = (mean(&|clip| change(clip, 0, 1)), mean(&|clip| change(clip, 0, 9)));
    assert!(next > 0.2 && next < 6.0 && later > 3.0 * next, "{next} to the next frame, {later} to the ninth");
    let (still, _) = film("falling", "[scene.background]\nkind = \"drifting\"\ndrift = 0.0");
    let pixel = |frame: usize| still[[0, frame, 0, 0, 0]];
    assert!((1..FRAMES).all(|frame| pixel(frame).abs_diff(pixel(0)) <= 1));
}

#[test]
fn any_picture_may_lie_behind() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("wall.png");
    // Left half red, right half blue, of another size and shape than the frame.
    RgbImage::from_fn(100, 50, |x, _| if x < 50 { Rgb([200, 0, 0]) } else { Rgb([0, 0, 200]) }).save(&file).unwrap();
    let tables = format!("[scene.background]\nkind = \"picture\"\nfile = {file:?}\nbrightness = 0.5");
    let (frames, _) = film("spring_color", &tables);
    let median = |column: usize, channel: usize| {
        let mut levels: Vec<u8> = frames.slice(s![.., .., .., column, channel]).iter().copied().collect();
        levels.sort_unstable();
        levels[levels.len() / 2]
    };
    for (column, expected) in [(4, [100, 0, 0]), (27, [0, 0, 100])] {
        for (channel, expected) in expected.into_iter().enumerate() {
            assert!(median(column, channel).abs_diff(expected) <= 1, "{column} {channel}: {}", median(column, channel));
        }
    }
    let lacking = variant("spring_color", "[scene.background]\nkind = \"picture\"\nfile = \"nowhere.png\"");
    let error = format!("{:#}", SourceImages::of(&lacking).unwrap_err());
    assert!(error.contains("nowhere.png"), "{error}");
}

fn noise_floor(task: &str, tables: &str) -> Option<NoiseFloor> {
    let (_, states) = film(task, tables);
    let Provenance::Settings(settings) = states.settings else { panic!("made here") };
    assert!(!settings.text().contains("floor"), "{}", settings.text());
    settings.noise_floor
}

#[test]
fn the_noise_floor_is_the_variance_that_no_motion_explains() {
    assert_eq!(noise_floor("spring_color", ""), None);
    assert_eq!(noise_floor("spring_color", "[scene.background]\nkind = \"texture\"\n[scene.camera]\nblur = 1.0"), None);
    let both = |tables: &str| {
        let floor = noise_floor("spring_color", tables).unwrap();
        assert_eq!(floor.reconstruction, floor.prediction);
        floor.reconstruction
    };
    // 3072 numbers of 10 grey levels, and 1/12 for cutting off after the decimal point. The balls' 25 px, some half of
    // whose noise is cut off, take some 1.5 % away; 120 films of 10 frames leave an error of 0.1 %.
    let expected = 3072.0 * (100.0 + 1.0 / 12.0) / 255.0_f64.powi(2);
    let floor = both(&format!("{GREY}[scene.camera]\nnoise = 10.0"));
    assert!((0.97..1.0).contains(&(floor / expected)), "{floor} for {expected}");
    // On black half of each Gaussian is cut off: its variance falls to 1/2 - 1/(2 pi) = 0.34.
    let floor = both("[scene.camera]\nnoise = 10.0");
    assert!((0.32..0.36).contains(&(floor / expected)), "{floor}");
    // One per cent black or white on grey: 0.01 * 0.25 for each number.
    let floor = both(&format!("{GREY}[scene.camera]\nsalt_and_pepper = 1.0"));
    assert!((floor / (3072.0 * 0.01 * 0.25) - 1.0).abs() < 0.1, "{floor}");
    assert!(both(&format!("{GREY}[scene.camera]\njpeg = 40")) > 0.5);
    assert!(both("[[scene.distractors]]\ncolour = [1.0, 0.0, 0.0]\nradius = 2.0\nspeed = 6.0") > 5.0);
    // Who sees a frame sees where everything is; who predicts it does not know how the camera will shake.
    let shaken = noise_floor("spring_color", "[scene.camera]\nshake = 2").unwrap();
    assert!(shaken.reconstruction == 0.0 && shaken.prediction > 2.0, "{shaken:?}");
}

#[test]
fn a_forecast_is_no_better_than_its_start_is_seen() {
    let [low, high, shaken] =
        ["[scene.camera]\nnoise = 10.0", "[scene.camera]\nnoise = 30.0", "[scene.camera]\nshake = 2"].map(|tables| {
            let variant = variant("spring_color", tables);
            let floor = measured(&variant, &SourceImages::of(&variant).unwrap(), 30).unwrap().unwrap();
            let forecast = floor.forecast.unwrap();
            println!("{tables}: {floor:?}");
            [forecast.prediction - floor.reconstruction, forecast.extrapolation - floor.reconstruction]
        });
    // The further, the less is known. A wrong place costs its square, and the place is as wrong as the noise is strong;
    // on black half of the noise is cut off, which the strong one has less of.
    assert!(low[1] > 2.0 * low[0] && high[1] > 2.0 * high[0], "{low:?} {high:?}");
    assert!((3.0..15.0).contains(&(high[0] / low[0])), "{low:?} {high:?}");
    // A camera that shakes by up to 2 px hides where both balls are, not how far they are apart: a ball of radius 2 is
    // drawn beside its place, at worst as two balls, 25 px of light in the one channel of each, four times.
    assert!((5.0..60.0).contains(&shaken[0]), "{shaken:?}");
}

#[test]
fn looks_that_cannot_be_are_refused() {
    for (task, tables, complaint) in [
        ("spring_color", "[scene.camera]\nnoise = -1.0", "camera.noise = -1"),
        ("spring_color", "[scene.camera]\nflicker = 101.0", "camera.flicker = 101"),
        ("spring_color", "[scene.camera]\njpeg = 0", "camera.jpeg = 0"),
        ("spring_color", "[scene.camera]\nshake = 16", "camera.shake = 16"),
        ("spring_color", "[scene.camera]\nhaze = 1.0", "haze"),
        ("spring_color", "[scene.objects]\nradii = [2.0]", "objects.radii: 1 of them for 2 objects"),
        ("spring_color", "[scene.objects]\nradii = [2.0, 0.1]", "objects.radii: 0.1"),
        ("spring_color", "[scene.objects]\ncolours = [[1.0], [1.0]]", "3 levels of 0 to 1"),
        ("spring_color", "[scene.objects]\ncolours = [[1.0, 0.0, 2.0], [1.0, 0.0, 0.0]]", "3 levels of 0 to 1"),
        ("spring_color", "[scene.objects]\nshading = 2.0", "objects.shading = 2"),
        ("mnist_spring_color", "[scene.objects]\nshading = 0.5", "only balls"),
        ("pendulum", "[scene.background]\nkind = \"texture\"", "nothing lies behind a bar"),
        ("spring_color", "[scene.background]\nkind = \"picture\"", "background.file is missing"),
        ("spring_color", "[scene.background]\nkind = \"texture\"\ndrift = 1.0", "background.drift means nothing"),
        ("spring_color", "[scene.background]\nkind = \"plain\"\nbrightness = 1.5", "background.brightness = 1.5"),
        ("spring_color", "[scene.background]\nkind = \"fog\"", "fog"),
        ("spring_color", "[[scene.distractors]]\ncolour = [1.0, 0.0, 0.0]\nradius = 20.0", "distractors.radius: 20"),
        (
            "spring_color",
            "[[scene.distractors]]\ncolour = [1.0, 0.0, 0.0]\nradius = 2.0\nspeed = 1.0\nposition = [3.0, 3.0]",
            "stands still",
        ),
    ] {
        let error = format!("{:#}", with(task, tables).unwrap_err());
        assert!(error.contains(complaint), "{error}");
    }
}

#[test]
fn motions_that_cannot_be_are_refused() {
    for (task, here, there, complaint) in [
        ("spring_color", "radius = 2.0", "", "radius: 0 px: must be at least 0.5"),
        ("spring_color", "k = 4.0", "k = -4.0", "motion.k = -4: must be a number, and at least 0"),
        ("spring_color", "equil = 6.0", "equil = nan", "motion.equil = NaN"),
        ("spring_color", "equil = 6.0", "equil = 6.0, damping = inf", "motion.damping = inf"),
        ("falling", "g = 1.5", "g = -1.5", "motion.g = -1.5"),
        ("pendulum", "look = \"bar\"", "look = \"balls\"\nradius = 3.0", "an angle is drawn as a bar"),
        ("pendulum", "m = 1.0", "m = 0.0", "motion.m = 0: must be a number, and at least 0.01"),
    ] {
        let plain = fs::read_to_string(configs().join(format!("tasks/{task}.toml"))).unwrap();
        let changed = plain.replacen(here, there, 1);
        assert_ne!(changed, plain, "{here}");
        let error = format!("{:#}", Task::from_toml(&changed).unwrap_err());
        assert!(error.contains(complaint), "{error}");
    }
}

#[test]
fn a_suite_without_limits_of_success_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let list = folder.path().join("list.toml");
    fs::create_dir(folder.path().join("list")).unwrap();
    let mut mine = tasks::find("spring_color").unwrap().to_table();
    mine.insert("name".into(), "mine".into());
    mine.remove("success");
    let file = folder.path().join("list/mine.toml");
    fs::write(&file, toml::to_string(&mine).unwrap()).unwrap();
    let plain = file.to_str().unwrap();
    let text = format!("clips = {{ train = 20, valid = 5, test = 5 }}\n[scenes]\nmine = {{ plain = {plain:?} }}\n");
    fs::write(&list, text).unwrap();
    let error = format!("{:#}", StressList::read(&list).unwrap_err());
    assert!(error.contains("mine: its plain task \"mine\" has no [success]"), "{error}");
}

fn suite() -> StressList {
    StressList::read(&configs().join("stress.toml")).unwrap()
}

#[test]
fn the_stress_suite_lists_its_files_and_keeps_the_limits_of_the_plain_tasks() {
    let suite = suite();
    let usual = Counts { train: 2000, valid: 200, test: 200 };
    assert_eq!(suite.scenes.iter().filter(|scene| scene.nine).count(), 6);
    let files = fs::read_dir(configs().join("stress")).unwrap();
    let mut names: Vec<_> = files.map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, suite.scenes.iter().map(|scene| format!("{}.toml", scene.name)).collect::<Vec<_>>());
    assert!(names.len() >= 24 && suite.systems().len() >= 4);
    for SuiteScene { name, plain, file, clips, .. } in &suite.scenes {
        let task = tasks::find(file.to_str().unwrap()).unwrap();
        assert_eq!(task.name, *name);
        // As a run saves it.
        assert_eq!(Task::from_toml(&toml::to_string(&task.to_table()).unwrap()).unwrap(), task, "{name}");
        let (scene, plain_scene) = (task.scene.as_ref().unwrap(), plain.scene.as_ref().unwrap());
        assert_eq!((scene.motion, scene.speed), (plain_scene.motion, plain_scene.speed), "{name}");
        assert_eq!(
            (task.truth.clone(), task.recipe_changes("fast")),
            (plain.truth.clone(), plain.recipe_changes("fast"))
        );
        let looks_plain = scene == plain_scene && task.system.objects == plain.system.objects;
        // What looks as ever has few clips.
        assert_eq!(looks_plain, clips.train < usual.train, "{name}");
        assert!(looks_plain || *clips == usual, "{name}: {clips:?}");
        assert_eq!(task.success.parameters, plain.success.parameters, "{name}");
        // Only where there is a floor may the limits of the losses be left out. Otherwise they grow with the objects.
        if Variant::new(&task, 0).unwrap().is_noisy() {
            assert!(task.success.losses.is_empty(), "{name}");
            continue;
        }
        let crowd = task.system.objects as f64 / plain.system.objects as f64;
        assert_eq!(task.success.losses.len(), plain.success.losses.len(), "{name}");
        for (loss, limit) in &plain.success.losses {
            assert!((task.success.losses[loss] - crowd * limit).abs() < 1e-9, "{name}");
        }
    }
}

#[test]
fn every_stress_scene_makes_clips() {
    for SuiteScene { name, file, .. } in &suite().scenes {
        let variant = Variant::new(&tasks::find(file.to_str().unwrap()).unwrap(), 1).unwrap();
        let images = SourceImages::of(&variant).unwrap();
        let counts = Counts { train: 2, valid: 1, test: 1 };
        let (dataset, states) = generate_clips(&variant, &images, 2, counts, &|_| {}).unwrap();
        let first = dataset.train.slice(s![0, .., .., .., ..]);
        assert!(first.iter().any(|&level| level > 100), "{name}: dark");
        assert_ne!(first, dataset.train.slice(s![1, .., .., .., ..]), "{name}: twice the same");
        let Provenance::Settings(settings) = &states.settings else { panic!("made here") };
        assert_eq!(settings.noise_floor.is_some(), variant.is_noisy(), "{name}");
        // What stands beside the files reads back.
        assert_eq!(Provenance::parse(&states.settings.to_file()).unwrap(), states.settings);
    }
}
