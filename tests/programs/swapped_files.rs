//! Two runs of which one has a file of the other: each command refuses it, says so, or does not depend on it.

use std::fs;
use std::path::{Path, PathBuf};

use image::{Rgb, RgbImage};
use rayon::prelude::*;
use serde_json::Value;

use crate::common::write_config;
use crate::programs::{paig, run, text};
use crate::tiny::TINY;

/// Files of a run or of its task, and folders of files, that are exchanged. `LAST` is the last checkpoint.
const FILES: [&str; 11] = [
    "run/config.toml",
    "run/summary.json",
    "run/checkpoints",
    "run/checkpoints/best.safetensors",
    "run/checkpoints/LAST/weights.safetensors",
    "run/checkpoints/LAST/state.json",
    "run/checkpoints/LAST",
    "run/metrics.jsonl",
    "scene/train.npz",
    "scene/test.npz",
    "scene/film.npz",
];

/// Commands that read them, and what they leave.
const CALLS: [(&str, &str); 7] = [
    ("evaluate run --threads 1 --json scores.json", "scores.json"),
    ("evaluate run --checkpoint best --threads 1 --json scores.json", "scores.json"),
    ("predict run --threads 1 --frames 3 --out predicted", "predicted/states.csv"),
    ("measure run --threads 1 --out measured", "measured/measurement.json"),
    ("convert --task scene/task.toml run weights.npz", "weights.npz"),
    ("train --resume --out run --threads 1", "run/summary.json"),
    ("report run --no-pictures --out report", "report/results.json"),
];

/// A ball that is thrown at this speed, as pictures.
fn throw(folder: &Path, speed: f64) {
    fs::create_dir(folder).unwrap();
    for frame in 0..48 {
        let time = f64::from(frame);
        let (x, y) = (12.0 + speed * time, 60.0 - 2.2 * time + 0.046 * time * time);
        let picture = RgbImage::from_fn(128, 72, |px, py| {
            let share = (6.0 - (f64::from(px) + 0.5 - x).hypot(f64::from(py) + 0.5 - y)).clamp(0.0, 1.0);
            Rgb([(share * 220.0 + (1.0 - share) * f64::from(90 + (px * 7 + py * 13) % 17)) as u8; 3])
        });
        picture.save(folder.join(format!("f{frame:02}.png"))).unwrap();
    }
}

/// A video, its task and a run on it.
fn prepare(place: &Path, speed: f64, seed: &str) {
    fs::create_dir(place).unwrap();
    throw(&place.join("throw"), speed);
    let import = "import throw --fps 30 --crop full --input-steps 2 --pred-steps 2 --out scene";
    let words: Vec<&str> = import.split(' ').collect();
    run(place, words[0], &words[1..]);
    write_config(place, TINY);
    let train =
        ["--task", "scene/task.toml", "--config", "test.toml", "--threads", "1", "--seed", seed, "--out", "run"];
    run(place, "train", &train);
}

fn copy(from: &Path, to: &Path) {
    if from.is_file() {
        fs::copy(from, to).unwrap();
        return;
    }
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(|entry| entry.unwrap()) {
        copy(&entry.path(), &to.join(entry.file_name()));
    }
}

fn last_checkpoint(place: &Path) -> String {
    let names = fs::read_dir(place.join("run/checkpoints")).unwrap();
    let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter(|name| name.starts_with("step_")).max().unwrap()
}

/// What a call leaves, without times.
fn result(path: &Path) -> Vec<u8> {
    fn without_times(value: &mut Value) {
        match value {
            Value::Object(table) => {
                table.retain(|key, _| !key.contains("seconds") && key != "commits" && key != "folder");
                table.values_mut().for_each(without_times);
            }
            Value::Array(list) => list.iter_mut().for_each(without_times),
            _ => {}
        }
    }
    let bytes = fs::read(path).unwrap();
    match serde_json::from_slice::<Value>(&bytes) {
        Ok(mut value) => {
            without_times(&mut value);
            value.to_string().into_bytes()
        }
        Err(_) => bytes,
    }
}

/// The exit code and the words of a call.
fn called(place: &Path, line: &str) -> (Option<i32>, String) {
    let mut words = line.split(' ');
    let done = paig(words.next().unwrap()).current_dir(place).args(words).output().unwrap();
    (done.status.code(), text(&done))
}

#[test]
fn files_of_another_run_are_refused_or_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
    prepare(&one, 2.0, "0");
    prepare(&other, 2.2, "1");
    let place = |number: usize| folder.path().join(format!("tried{number}"));
    let lasts = [&one, &other].map(|run| last_checkpoint(run));
    let cases: Vec<_> = FILES.iter().flat_map(|file| CALLS.map(|(line, out)| (*file, line, out))).collect();
    let sound: Vec<(&str, Vec<u8>)> = CALLS
        .into_iter()
        .map(|(line, out)| {
            let tried = folder.path().join("sound");
            copy(&one, &tried);
            let (code, said) = called(&tried, line);
            assert_eq!(code, Some(0), "{line}: {said}");
            let made = result(&tried.join(out));
            fs::remove_dir_all(&tried).unwrap();
            (line, made)
        })
        .collect();
    let failures = cases.par_iter().enumerate().filter_map(|(number, &(file, line, out))| {
        let tried = place(number);
        copy(&one, &tried);
        let names: [PathBuf; 2] =
            [(&tried, &lasts[0]), (&other, &lasts[1])].map(|(place, last)| place.join(file.replace("LAST", last)));
        if names[0].is_dir() {
            fs::remove_dir_all(&names[0]).unwrap();
        }
        copy(&names[1], &names[0]);
        let (code, said) = called(&tried, line);
        let errors = said.lines().filter(|line| line.starts_with("error: ")).count();
        let told = ["warning: ", "was imported again", "1 unreadable"].iter().any(|words| said.contains(words));
        let expected = &sound.iter().find(|(call, _)| *call == line).unwrap().1;
        // What a user may have edited or exchanged is found before any work: bad input, not work that failed.
        let input = file == "run/config.toml" || file.starts_with("scene/");
        let right = match code {
            Some(0) => told || &result(&tried.join(out)) == expected,
            Some(1) => !input && errors == 1 && !said.contains("defect"),
            code => code == Some(2) && errors == 1,
        };
        fs::remove_dir_all(&tried).unwrap();
        (!right).then(|| format!("{file} of another run: paig {line}: {code:?} {said}"))
    });
    let failures: Vec<String> = failures.collect();
    println!("{} calls on a run with a file of another one, {} failures", cases.len(), failures.len());
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
