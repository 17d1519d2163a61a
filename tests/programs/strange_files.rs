//! Every path that a command opens, in whose place lies no file: a pipe, a device, a folder, a link to nothing. Each call ends by
//! itself, with one line that says so.

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::common::{dataset, spring, write_config};
use crate::programs::{paig, text};
use crate::project::project;
use crate::tiny::TINY;

/// Time after which a call counts as hanging. Machines of tests are busy.
const HANGS: Duration = Duration::from_secs(90);

/// What lies in the place of a file.
#[derive(Debug, Clone, Copy)]
enum Strange {
    Pipe,
    Device,
    Folder,
    OpenLink,
}

impl Strange {
    const ALL: [Strange; 4] = [Strange::Pipe, Strange::Device, Strange::Folder, Strange::OpenLink];

    fn put(self, path: &Path) {
        match fs::symlink_metadata(path) {
            Ok(described) if described.is_dir() => fs::remove_dir_all(path).unwrap(),
            Ok(_) => fs::remove_file(path).unwrap(),
            Err(_) => fs::create_dir_all(path.parent().unwrap()).unwrap(),
        }
        match self {
            Strange::Pipe => assert!(Command::new("mkfifo").arg(path).status().unwrap().success()),
            // Endless, and never a valid file.
            Strange::Device => symlink("/dev/zero", path).unwrap(),
            Strange::Folder => fs::create_dir(path).unwrap(),
            Strange::OpenLink => symlink("nothing", path).unwrap(),
        }
    }
}

/// A path that is opened, and the calls that open it. `run`, `scene` and `film.mp4` are sound but for that path.
const OPENED: &[(&str, &[&str])] = &[
    (
        "x.toml",
        &[
            "train --task x.toml",
            "train --task spring_color --config x.toml",
            "import film.mp4 --out out --equation x.toml",
            "measure film.mp4 --out out --equation x.toml",
            "measure film.mp4 --out out --against x.toml",
            "measurements run --references x.toml",
            "control --study x.toml --out out",
            "baselines --list x.toml",
            "stress --list x.toml",
            "generate --task x.toml --out out",
        ],
    ),
    (
        "x.npz",
        &[
            "evaluate run --file x.npz --threads 1",
            "predict run --file x.npz --out out --threads 1",
            "import x.npz --out out --fps 25",
            "measure x.npz --out out --fps 25",
            "track x.npz",
            "convert --task spring_color x.npz out.safetensors",
        ],
    ),
    ("x.safetensors", &["convert --task spring_color x.safetensors out.npz"]),
    ("x.mp4", &["import x.mp4 --out out", "measure x.mp4 --out out", "track x.mp4"]),
    ("x.gif", &["import x.gif --out out", "measure x.gif --out out"]),
    ("x.mkv", &["import x.mkv --out out", "measure x.mkv --out out"]),
    ("x.avi", &["import x.avi --out out"]),
    ("x.unknown", &["import x.unknown --out out", "track x.unknown"]),
    ("pictures/f1.png", &["import pictures --out out --fps 25", "measure pictures --out out --fps 25"]),
    ("pictures/times.csv", &["import pictures --out out"]),
    ("x.trk", &["import film.mp4 --out out --tracker x.trk", "measure film.mp4 --out out --tracker x.trk"]),
    ("x.trz", &["import film.mp4 --out out --tracker x.trz"]),
    (
        "x.png",
        &[
            "generate --task spring_color --out out --background picture --picture x.png --train 1",
            "control --task pendulum --planner zero --episodes 1 --goal-image x.png --out out",
        ],
    ),
    ("mnist/train-images-idx3-ubyte", &["generate --task mnist_spring_color --out out --mnist-dir mnist"]),
    ("cifar/data_batch_1.bin", &["generate --task mnist_spring_color --out out --background cifar --cifar-dir cifar"]),
    (
        "run/config.toml",
        &["evaluate run --threads 1", "predict run --out out", "measure run", "train --resume --out run"],
    ),
    ("run/metrics.jsonl", &["train --resume --out run --threads 1"]),
    ("run/log.txt", &["train --resume --out run --threads 1"]),
    ("run/.lock", &["train --resume --out run"]),
    ("run/checkpoints/index.json", &["evaluate run --threads 1"]),
    ("run/checkpoints/best.safetensors", &["evaluate run --checkpoint best --threads 1"]),
    ("run/measurement.json", &["measurements run"]),
    ("data/spring_color/color_spring_vx8_vy8_sl12_r2_k4_e6.npz", &["train --resume --out run --threads 1"]),
    ("out/report.md", &["report run --out out --no-pictures"]),
];

/// Copies a folder of files and folders.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(|entry| entry.unwrap()) {
        let to = to.join(entry.file_name());
        if entry.path().is_dir() { copy(&entry.path(), &to) } else { _ = fs::copy(entry.path(), &to).unwrap() }
    }
}

/// What the calls find, once.
fn prepare(place: &Path) {
    symlink(dataset(), place.join("data")).unwrap();
    let config = write_config(place, TINY);
    let mut command = spring(&place.join("run"));
    command.args(["--threads", "1", "--data", "data", "--config"]).arg(config);
    let done = command.current_dir(place).output().unwrap();
    assert!(done.status.success(), "{}", text(&done));
    fs::copy(project("tests/data/numbered.mp4"), place.join("film.mp4")).unwrap();
    fs::create_dir(place.join("pictures")).unwrap();
    for number in 0..3 {
        let level = image::Rgb([80 * number; 3]);
        image::RgbImage::from_pixel(16, 16, level).save(place.join(format!("pictures/f{number}.png"))).unwrap();
    }
}

/// The exit code and the words of a call; none where it hangs.
fn ended(place: &Path, call: &str) -> Option<(Option<i32>, String)> {
    let (command, arguments) = call.split_once(' ').unwrap();
    let said = place.join("said.txt");
    let output = || Stdio::from(fs::OpenOptions::new().create(true).append(true).open(&said).unwrap());
    let mut child = paig(command)
        .current_dir(place)
        .args(arguments.split(' '))
        .stdin(Stdio::null())
        .stdout(output())
        .stderr(output())
        .spawn()
        .unwrap();
    let begun = Instant::now();
    while begun.elapsed() < HANGS {
        if let Some(status) = child.try_wait().unwrap() {
            return Some((status.code(), fs::read_to_string(&said).unwrap()));
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    None
}

#[test]
fn what_is_no_file_is_refused_and_never_waited_for() {
    let sound = tempfile::tempdir().unwrap();
    prepare(sound.path());
    let calls = OPENED.iter().flat_map(|(path, calls)| calls.iter().map(move |call| (*path, *call)));
    let cases: Vec<_> = calls.flat_map(|(path, call)| Strange::ALL.map(|strange| (path, call, strange))).collect();
    let failures: Vec<String> = cases
        .par_iter()
        .filter_map(|&(path, call, strange)| {
            let place = tempfile::tempdir().unwrap();
            copy(sound.path(), place.path());
            strange.put(&place.path().join(path));
            let complaint = |why: String| Some(format!("{strange:?} as {path}: paig {call}: {why}"));
            let Some((code, said)) = ended(place.path(), call) else { return complaint("hangs".into()) };
            let errors: Vec<&str> = said.lines().filter(|line| line.starts_with("error: ")).collect();
            // What a command can do without may be left out.
            match (code, &errors[..]) {
                (Some(0), []) => None,
                (Some(1 | 2), [error]) if !error.contains("defect") => None,
                _ => complaint(format!("{code:?} {said}")),
            }
        })
        .collect();
    println!("{} calls with something else in place of a file, {} failures", cases.len(), failures.len());
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
