//! Pictures and arrays of a run: sizes, places and what stands there.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;

use image::codecs::gif::GifDecoder;
use image::{AnimationDecoder, RgbImage};
use ndarray::{Array5, ArrayD, IxDyn};
use ndarray_npy::NpzReader;
use paig::datasets::iterators::Clips;
use paig::network::physics_models::{ModelOptions, PhysicsNet};
use paig::tasks::{Task, find};
use paig::viz::examples::layout;
use paig::viz::{write_artifacts, write_curves};
use tch::Device;

/// Pixels that differ everywhere: clip, time, row, column and channel all matter.
fn synthetic(clips: usize, task: &Task) -> Array5<u8> {
    let shape = (clips, task.test_frames, task.system.side, task.system.side, task.system.channels);
    // So dark that no light is seen to flicker.
    Array5::from_shape_fn(shape, |(n, t, y, x, c)| ((n * 101 + t * 37 + y * 5 + x * 3 + c * 71 + y * x) % 50) as u8)
}

fn artifacts(folder: &Path, task: &Task, pixels: &Array5<u8>, examples: usize) {
    tch::set_num_threads(1);
    let model = PhysicsNet::new(&task.system, &ModelOptions::original(), Device::Cpu, 3).unwrap();
    write_artifacts(folder, &model, &Clips::new(pixels, None, Device::Cpu), examples).unwrap();
}

fn png(path: &Path) -> RgbImage {
    image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).into_rgb8()
}

/// Whether every pixel of an enlarged frame is the clip's; one channel stands for all three.
fn shows(picture: &RgbImage, corner: (u32, u32), pixels: &Array5<u8>, clip: usize, time: usize, times: u32) -> bool {
    let (side, channels) = (pixels.shape()[2] as u32, pixels.shape()[4]);
    (0..side * times).all(|y| {
        (0..side * times).all(|x| {
            let (row, column) = ((y / times) as usize, (x / times) as usize);
            let expected = |c: usize| pixels[[clip, time, row, column, c.min(channels - 1)]];
            picture.get_pixel(corner.0 + x, corner.1 + y).0 == [expected(0), expected(1), expected(2)]
        })
    })
}

fn check_example(task: &Task, times: u32) {
    let folder = tempfile::tempdir().unwrap();
    let pixels = synthetic(2, task);
    artifacts(folder.path(), task, &pixels, 5);
    assert!(!folder.path().join("example2.png").exists(), "there are only two clips");
    let grid = layout(&task.system, task.test_frames);
    for clip in 0..2 {
        let picture = png(&folder.path().join(format!("example{clip}.png")));
        assert_eq!(picture.dimensions(), grid.size());
        assert_eq!(grid.cell, task.system.side as u32 * times);
        for time in 0..task.test_frames {
            let truth = grid.corner(1, time);
            assert!(shows(&picture, truth, &pixels, clip, time, times), "truth, clip {clip} frame {time}");
            let is_input = time < task.system.input_steps;
            let model = grid.corner(0, time);
            assert_eq!(shows(&picture, model, &pixels, clip, time, times), is_input, "clip {clip} frame {time}");
            let (x, y) = grid.corner(2, time);
            let blank = (0..grid.cell).all(|i| picture.get_pixel(x + i, y + i).0 == [255; 3]);
            assert_eq!(
                blank,
                time >= task.system.input_steps + task.system.pred_steps,
                "reconstruction of frame {time}"
            );
        }
    }
}

#[test]
fn examples_show_the_clip_at_the_right_place() {
    check_example(&find("spring_color").unwrap(), 4);
}

#[test]
fn large_frames_are_enlarged_less() {
    check_example(&find("mnist_spring_color").unwrap(), 2);
}

#[test]
fn one_channel_becomes_grey() {
    let mut task = find("spring_color").unwrap();
    task.system.channels = 1;
    check_example(&task, 4);
}

#[test]
fn clips_that_end_with_the_prediction_have_no_extrapolation() {
    let mut task = find("spring_color").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let frames = task.system.input_steps + task.system.pred_steps;
    task.test_frames = frames;
    let pixels = synthetic(1, &task);
    artifacts(folder.path(), &task, &pixels, 1);
    let picture = png(&folder.path().join("example0.png"));
    assert_eq!(picture.dimensions(), layout(&task.system, frames).size());
}

#[test]
fn arrays_are_channels_last_and_hold_the_clips() {
    let task = find("3bp_color").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let pixels = synthetic(2, &task);
    artifacts(folder.path(), &task, &pixels, 1);
    let read = |file: &str, name: &str| -> ArrayD<f32> {
        NpzReader::new(File::open(folder.path().join(file)).unwrap()).unwrap().by_name(name).unwrap()
    };
    let input = read("outputs.npz", "input");
    assert_eq!(input, pixels.mapv(|p| f32::from(p) / 255.0).into_dyn());
    for (name, shape) in [
        ("output", &[2, 36, 36, 36, 3][..]),
        ("recons", &[2, 16, 36, 36, 3]),
        ("enc_pos", &[2, 16, 6]),
        ("pos_vel_seq", &[2, 37, 12]),
    ] {
        assert_eq!(read("outputs.npz", name).shape(), shape, "{name}");
    }
    // The roll-out begins at the encoded position of the last input frame.
    let (positions, states) = (read("outputs.npz", "enc_pos"), read("outputs.npz", "pos_vel_seq"));
    for place in 0..6 {
        let (start, encoded) =
            (states[IxDyn(&[1, 0, place])], positions[IxDyn(&[1, task.system.input_steps - 1, place])]);
        assert!((start - encoded).abs() < 1e-4, "coordinate {place}: {start}, {encoded}");
    }
    for (name, shape) in [
        ("contents", &[3, 18, 18, 3][..]),
        ("templates", &[3, 18, 18, 1]),
        ("background_content", &[1, 36, 36, 3]),
        ("transf_contents", &[4, 32, 36, 36, 3]),
        ("transf_masks", &[4, 32, 36, 36, 1]),
        ("enc_masks", &[32, 36, 36, 4]),
        ("masked_objs", &[3, 32, 36, 36, 3]),
    ] {
        assert_eq!(read("extra_outputs.npz", name).shape(), shape, "{name}");
    }
    // The saved layers, put together, are the saved reconstruction.
    let (contents, masks) = (read("extra_outputs.npz", "transf_contents"), read("extra_outputs.npz", "transf_masks"));
    let drawn: f32 = (0..4).map(|k| contents[IxDyn(&[k, 20, 9, 30, 1])] * masks[IxDyn(&[k, 20, 9, 30, 0])]).sum();
    let saved = read("outputs.npz", "recons")[IxDyn(&[1, 4, 9, 30, 1])];
    assert!((drawn - saved).abs() < 1e-4, "{drawn}, {saved}");
}

#[test]
fn pictures_of_all_kinds_are_written_whole() {
    let task = find("bouncing_balls").unwrap();
    let folder = tempfile::tempdir().unwrap();
    artifacts(folder.path(), &task, &synthetic(2, &task), 0);
    let gif = GifDecoder::new(BufReader::new(File::open(folder.path().join("animation.gif")).unwrap())).unwrap();
    let frames = gif.into_frames().collect_frames().unwrap();
    assert_eq!(frames.len(), task.test_frames);
    let mut names: Vec<_> =
        fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    assert_eq!(names, ["animation.gif", "encoder_masks.png", "extra_outputs.npz", "outputs.npz", "templates.png"]);
    // Three rows of sprites; frame, two masks, two objects and background of both clips.
    let (templates, masks) = (png(&folder.path().join("templates.png")), png(&folder.path().join("encoder_masks.png")));
    assert!(templates.height() > 3 * 128 && templates.width() > 3 * 128);
    assert!(masks.height() > 2 * 128 && masks.width() > 6 * 128);
}

#[test]
fn an_empty_test_set_is_an_error() {
    let task = find("spring_color").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let model = PhysicsNet::new(&task.system, &ModelOptions::original(), Device::Cpu, 3).unwrap();
    let error =
        write_artifacts(folder.path(), &model, &Clips::new(&synthetic(0, &task), None, Device::Cpu), 1).unwrap_err();
    assert!(error.to_string().contains("no test clips"), "{error:#}");
}

const METRICS: &str = r#"{"kind":"valid","phase":"discover","step":0,"score":50,"recons_loss":50.0,"pred_loss":60.0,"extrap_loss":null,"k":1.0,"l":1.0}
{"kind":"train","phase":"discover","step":50,"train_loss":9.1,"recons_loss":6.2,"k":1.0,"l":1.0,"seconds":20.2}
{"kind":"identify","phase":"identify","step":50,"residual":0.1,"k":3.9,"l":5.9}
{"kind":"valid","phase":"join","step":50,"score":4,"recons_loss":0.3,"pred_loss":4.0,"extrap_loss":6.0,"k":3.9,"l":5.9}
{"kind":"train","phase":"join","step":100,"train_loss":3.0,"recons_loss":0.2,"pred_loss":0.0,"k":4.0,"l":6.0,"seconds":40.0}
{"kind":"something new","phase":"join","step":100}
"#;

fn curves(metrics: &str, task: &str) -> (tempfile::TempDir, paig::Result<()>) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("metrics.jsonl"), metrics).unwrap();
    let task = find(task).unwrap();
    let result = write_curves(folder.path(), &task, &task.truth);
    (folder, result)
}

/// Whether a colour of the plots (RGB, exact) occurs.
fn has(picture: &RgbImage, colour: [u8; 3]) -> bool {
    picture.pixels().any(|pixel| pixel.0 == colour)
}

#[test]
fn curves_are_drawn_with_the_truth() {
    let (folder, result) = curves(METRICS, "spring_color");
    result.unwrap();
    let losses = png(&folder.path().join("losses.png"));
    assert!(has(&losses, [24, 119, 190]) && has(&losses, [36, 145, 84]) && has(&losses, [222, 106, 16]));
    let parameters = png(&folder.path().join("parameters.png"));
    let (width, height) = parameters.dimensions();
    for half in [0, height / 2] {
        let panel = image::imageops::crop_imm(&parameters, 0, half, width, height / 2).to_image();
        assert!(has(&panel, [24, 119, 190]) && has(&panel, [196, 40, 58]), "learned and true value");
    }
}

#[test]
fn a_task_without_parameters_has_only_losses() {
    let (folder, result) = curves(METRICS, "bouncing_balls");
    result.unwrap();
    assert!(folder.path().join("losses.png").exists() && !folder.path().join("parameters.png").exists());
}

#[test]
fn a_single_record_is_a_dot() {
    let (folder, result) = curves(METRICS.lines().next().unwrap(), "spring_color");
    result.unwrap();
    assert!(has(&png(&folder.path().join("losses.png")), [36, 145, 84]));
}

#[test]
fn damaged_or_missing_metrics_are_named() {
    let damaged = METRICS.replace("\"residual\":0.1,", "\"residual\":0.");
    let (folder, result) = curves(&damaged, "spring_color");
    let message = format!("{:#}", result.unwrap_err());
    assert!(message.contains("metrics.jsonl") && message.contains("line 3 is damaged"), "{message}");
    assert!(!folder.path().join("losses.png").exists());
    let message = format!("{:#}", curves("", "spring_color").1.unwrap_err());
    assert!(message.contains("holds no losses"), "{message}");
    let empty = tempfile::tempdir().unwrap();
    let message = format!("{:#}", write_curves(empty.path(), &find("spring_color").unwrap(), &[]).unwrap_err());
    assert!(message.contains("cannot read") && message.contains("metrics.jsonl"), "{message}");
}
