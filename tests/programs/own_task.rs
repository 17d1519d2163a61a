//! A system of one's own: a task file and videos, no Rust.

use std::fs;
use std::path::Path;

use crate::programs::run;
use crate::project::project;
use ndarray::{Array5, s};
use ndarray_npy::NpzWriter;
use paig::generators::render::Balls;

/// Five balls that bounce in frames of 48 x 48, in clips of other lengths than any built-in task's.
const FIVE_BALLS: &str = r#"
name = "five_balls"
summary = "five balls that bounce"
system = { side = 48, channels = 3, objects = 5, input_steps = 3, pred_steps = 4, dt = 0.2, equation = "bouncing" }
data = { train_frames = 9, test_frames = 14 }
scene = { motion = { law = "bouncing" }, speed = [6.0, 6.0], radius = 3.0, look = "balls" }
success = { losses = { pred_loss = 1.0 } }
"#;

/// What makes a training take seconds.
const SHORT: [&str; 13] = [
    "discover.frames=6",
    "discover.max_steps=6",
    "discover.guide.full_until=2",
    "discover.guide.zero_from=4",
    "discover.schedule.validate_every=6",
    "identify.clips=4",
    "identify.max_iterations=2",
    "join.batch=2",
    "join.max_steps=4",
    "join.validation_clips=2",
    "output.checkpoint_every=3",
    "output.examples=1",
    "output.tensorboard=true",
];

/// The same for a training, cut short, with these steps in `join`.
#[track_caller]
fn train(folder: &Path, arguments: &[&str]) -> String {
    let set = SHORT.iter().flat_map(|assignment| ["--set", assignment]);
    run(folder, "train", &arguments.iter().copied().chain(["--threads", "1"]).chain(set).collect::<Vec<_>>())
}

#[test]
fn five_balls_are_generated_trained_scored_reported_predicted_and_resumed_from_a_file_alone() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("five.toml"), FIVE_BALLS).unwrap();
    run(folder, "generate", &["--task", "five.toml", "--train", "12", "--valid", "4", "--test", "3"]);
    let data = folder.join("data/datasets/five_balls");
    assert!(data.join("color_bounce_vx6_vy6_sl9_r3_dt02.npz").exists(), "{:?}", fs::read_dir(data).unwrap().count());
    train(folder, &["--task", "five.toml"]);
    let of_run = folder.join("runs/five_balls/fast/seed=0");

    // From here on the run's folder stands alone.
    fs::remove_file(folder.join("five.toml")).unwrap();
    let scored = run(folder, "evaluate", &["runs/five_balls/fast/seed=0", "--json", "scores.json"]);
    assert!(scored.contains("encoded positions"), "{scored}");
    let scores: serde_json::Value = serde_json::from_slice(&fs::read(folder.join("scores.json")).unwrap()).unwrap();
    assert_eq!(scores["scores"]["states"]["objects"].as_array().unwrap().len(), 5);
    assert_eq!(scores["scores"]["predicted_frames"].as_array().unwrap().len(), 11);
    run(folder, "evaluate", &["runs/five_balls/fast/seed=0", "--checkpoint", "best"]);
    run(folder, "predict", &["runs/five_balls/fast/seed=0", "--frames", "20", "--out", "prediction"]);
    let states = fs::read_to_string(folder.join("prediction/states.csv")).unwrap();
    assert_eq!((states.lines().count(), states.lines().next().unwrap().split(',').count()), (22, 2 + 5 * 4));
    run(folder, "report", &["runs", "--out", "report"]);
    let report = fs::read_to_string(folder.join("report/report.md")).unwrap();
    assert!(report.contains("five_balls"), "{report}");
    // Its commands know that no program finds the task by its name: it stands in the records.
    let (_, config) = report.split_once("# five_balls.toml is what stands under [task] in ").unwrap();
    let (config, _) = config.split_once(", as a file of its own").unwrap();
    for line in [
        "paig generate --task five_balls.toml --train 12",
        "paig sweep --task five_balls.toml --recipe fast",
        &format!("paig train --recipe fast --config '{config}' --seed 0"),
    ] {
        assert!(report.contains(line), "{line:?} is not in {report}");
    }
    run(folder, "train", &["--recipe", "fast", "--config", config, "--seed", "0", "--print-config"]);

    // A run whose end is taken away comes to it again, with the same weights.
    let index = fs::read(of_run.join("checkpoints/index.json")).unwrap();
    let index: serde_json::Value = serde_json::from_slice(&index).unwrap();
    let weights = of_run.join("checkpoints").join(index["last"].as_str().unwrap()).join("weights.safetensors");
    let before = fs::read(&weights).unwrap();
    let metrics = fs::read_to_string(of_run.join("metrics.jsonl")).unwrap();
    let steps = metrics.matches(r#""kind":"valid""#).count();
    let shown = || {
        let events = fs::read(of_run.join("events.out.tfevents.paig")).unwrap();
        String::from_utf8_lossy(&events).matches("valid/recons_loss").count()
    };
    assert!(steps > 0 && shown() == steps, "{} of {steps} validations", shown());
    fs::remove_file(of_run.join("summary.json")).unwrap();
    run(folder, "train", &["--resume", "--out", "runs/five_balls/fast/seed=0"]);
    assert!(of_run.join("summary.json").exists() && before == fs::read(&weights).unwrap());
    // What TensorBoard is shown is written anew, each validation once.
    assert_eq!(shown(), steps);
}

/// What is generated lies where a training looks for it.
#[test]
fn clips_are_generated_beside_the_task_where_it_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::create_dir(folder.join("mine")).unwrap();
    let task = FIVE_BALLS.replace("test_frames = 14", "test_frames = 14, folder = \".\"");
    fs::write(folder.join("mine/five.toml"), task).unwrap();
    run(folder, "generate", &["--task", "mine/five.toml", "--train", "2", "--valid", "1", "--test", "1"]);
    assert!(folder.join("mine/color_bounce_vx6_vy6_sl9_r3_dt02.npz").exists());
    let config = run(folder, "train", &["--print-config", "--task", "mine/five.toml"]);
    let says = |line: &str| config.contains(line);
    assert!(says("folder = \"mine\"") && says("train_file = \"color_bounce_vx6_vy6_sl9_r3_dt02.npz\""), "{config}");
}

/// A block of the guide, by what stands behind its backticks and how it begins.
fn block(guide: &str, language: &str, beginning: &str) -> String {
    let fence = format!("```{language}\n");
    let blocks = guide.split(&fence).skip(1).map(|rest| rest.split("```").next().unwrap());
    let found: Vec<_> = blocks.filter(|block| block.starts_with(beginning)).collect();
    assert_eq!(found.len(), 1, "blocks of {language} that begin with {beginning:?}");
    found[0].to_string()
}

/// Two balls that drift past each other in the frames of the guide's task, uint8 `[clips, frames, 48, 48, 3]`.
fn film(clips: usize, frames: usize) -> Array5<u8> {
    let balls = Balls::new(48, 3.0, 3);
    let mut film = Array5::zeros((clips, frames, 48, 48, 3));
    for (clip, mut of_clip) in film.outer_iter_mut().enumerate() {
        for (time, mut frame) in of_clip.outer_iter_mut().enumerate() {
            let along = 8.0 + (clip % 7) as f64 + time as f64;
            balls.draw(&[[along, 14.0], [46.0 - along, 32.0]], frame.as_slice_mut().unwrap());
        }
    }
    film
}

#[test]
fn the_guides_task_file_works_as_it_is_printed() {
    let guide = fs::read_to_string(project("docs/own-data.md")).unwrap();
    let task = block(&guide, "toml", "name = \"marbles\"");
    let lines = task.lines().filter(|line| !line.trim().is_empty()).count();
    assert!(lines <= 15, "the guide promises 15 lines, there are {lines}");
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("marbles.toml"), task).unwrap();
    let data = folder.join("data/datasets/marbles");
    fs::create_dir_all(&data).unwrap();
    let mut training = NpzWriter::new(fs::File::create(data.join("train.npz")).unwrap());
    let clips = film(30, 16);
    training.add_array("train_x", &clips).unwrap();
    training.add_array("valid_x", &clips.slice(s![..4, .., .., .., ..])).unwrap();
    training.finish().unwrap();
    let mut test = NpzWriter::new(fs::File::create(data.join("test.npz")).unwrap());
    test.add_array("test_x", &film(3, 32)).unwrap();
    test.finish().unwrap();

    // The guide's commands, the training cut short.
    let words = |block: &str| -> Vec<Vec<String>> {
        block.lines().map(|line| line.split_whitespace().map(String::from).collect()).collect()
    };
    for command in words(&block(&guide, "sh", "paig train ")) {
        let arguments: Vec<_> = command[2..].iter().map(String::as_str).collect();
        train(folder, &arguments);
    }
    for command in words(&block(&guide, "sh", "paig evaluate ")) {
        let arguments: Vec<_> = command[2..].iter().map(String::as_str).collect();
        run(folder, &command[1], &arguments);
    }
    for written in ["scores.json", "prediction/states.csv", "report/report.html"] {
        assert!(folder.join(written).exists(), "{written}");
    }
}
