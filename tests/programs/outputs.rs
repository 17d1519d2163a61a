//! Every output of every command, with files of other people in its place: they stay as they are. Sets of files are replaced as a
//! whole.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Output;

use image::{Rgb, RgbImage};
use rayon::prelude::*;

use crate::common::{dataset, spring, write_config};
use crate::programs::{paig, run, text};
use crate::project::project;
use crate::tiny::TINY;

/// What a stranger's file holds.
const DIARY: &str = "dear diary";

/// Outputs that are one file: the call, which writes `OUT`, and the ending of its name.
const FILES: [(&str, &str); 9] = [
    ("evaluate run --threads 1 --json OUT", "json"),
    ("evaluate run --threads 1 --picture OUT", "png"),
    ("convert --task spring_color --force run OUT", "npz"),
    ("convert --task spring_color --force run OUT", "safetensors"),
    ("measurements measured --json OUT", "json"),
    ("track throw --picture other.png --out OUT", "csv"),
    ("track throw --out other.csv --picture OUT", "png"),
    ("compare-track measured track.csv --json OUT", "json"),
    ("compare --goldens goldens --file-filter cell_spring --rows OUT", "jsonl"),
];
/// Outputs that are a folder.
const FOLDERS: [&str; 8] = [
    "predict run --threads 1 --frames 3 --out OUT",
    "measure throw --fps 30 --threads 1 --out OUT",
    "report run --no-pictures --out OUT",
    "import throw --fps 30 --crop full --input-steps 2 --pred-steps 2 --name scene --force --out OUT",
    "generate --task spring_color --train 2 --valid 1 --test 1 --threads 1 --force --out OUT",
    "control --task pendulum --planner zero --episodes 1 --steps 3 --out OUT",
    "train --task spring_color --config test.toml --data data --threads 1 --out OUT",
    "batch videos.toml --out OUT",
];

fn call(place: &Path, line: &str, out: &str) -> Output {
    let mut words = line.split(' ').map(|word| if word == "OUT" { out } else { word });
    paig(words.next().unwrap()).current_dir(place).args(words).output().unwrap()
}

/// A ball that is thrown, as pictures.
fn throw(folder: &Path) {
    fs::create_dir(folder).unwrap();
    for frame in 0..40 {
        let time = f64::from(frame);
        let (x, y) = (12.0 + 2.5 * time, 60.0 - 2.6 * time + 0.065 * time * time);
        let picture = RgbImage::from_fn(128, 72, |px, py| {
            let share = (6.0 - (f64::from(px) + 0.5 - x).hypot(f64::from(py) + 0.5 - y)).clamp(0.0, 1.0);
            let wall = 90.0 + f64::from((px * 7 + py * 13) % 17);
            Rgb([(share * 220.0 + (1.0 - share) * wall) as u8; 3])
        });
        picture.save(folder.join(format!("f{frame:02}.png"))).unwrap();
    }
}

/// A folder with a run, its data, a throw and its measurement.
fn prepared() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    symlink(dataset(), place.join("data")).unwrap();
    write_config(place, TINY);
    let mut command = spring(Path::new("run"));
    command.args(["--threads", "1", "--data", "data", "--config", "test.toml"]);
    let done = command.current_dir(place).output().unwrap();
    assert!(done.status.success(), "{}", text(&done));
    throw(&place.join("throw"));
    run(place, "measure", &["throw", "--fps", "30", "--threads", "1", "--out", "measured"]);
    run(place, "track", &["throw", "--out", "track.csv"]);
    let videos = "[measure]\nfps = 30\nequation = \"falling\"\n[[video]]\nfile = \"throw\"\n";
    fs::write(place.join("videos.toml"), videos).unwrap();
    symlink(project("compare/goldens"), place.join("goldens")).unwrap();
    folder
}

/// All files below a folder with their bytes.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    fn search(folder: &Path, below: &Path, files: &mut BTreeMap<PathBuf, Vec<u8>>) {
        for entry in fs::read_dir(folder.join(below)).unwrap().map(|entry| entry.unwrap()) {
            let name = below.join(entry.file_name());
            if entry.file_type().unwrap().is_dir() {
                search(folder, &name, files);
            } else {
                files.insert(name, fs::read(entry.path()).unwrap());
            }
        }
    }
    let mut files = BTreeMap::new();
    search(folder, Path::new(""), &mut files);
    files
}

#[track_caller]
fn assert_refused(done: &Output, what: &str) {
    let said = text(done);
    assert_eq!(done.status.code(), Some(2), "{what}: {said}");
    let errors = said.lines().filter(|line| line.starts_with("error: ")).count();
    assert!(errors == 1 && !said.contains("defect"), "{what}: {said}");
}

#[test]
fn a_file_that_the_program_did_not_write_is_never_replaced() {
    let folder = prepared();
    let place = folder.path();
    let before = contents(&place.join("run"));
    let mut tried = 0;
    for (number, (line, ending)) in FILES.into_iter().enumerate() {
        let name = format!("own{number}.{ending}");
        let done = call(place, line, &name);
        assert!(done.status.success(), "{line}: {}", text(&done));
        let again = call(place, line, &name);
        assert!(again.status.success(), "{line} again: {}", text(&again));
        // A stranger's file, by its name or by a link; files of other kinds that the program wrote; an input.
        fs::write(place.join(format!("strange{number}.{ending}")), DIARY).unwrap();
        symlink(format!("strange{number}.{ending}"), place.join(format!("link{number}.{ending}"))).unwrap();
        let strange = [format!("strange{number}.{ending}"), format!("link{number}.{ending}")];
        let others = ["run/config.toml", "run/summary.json", "run/metrics.jsonl", "measured/measurement.json"];
        let pictures = ["throw/f00.png", "measured/measurement-positions.png", "run/losses.png"];
        for out in strange.iter().map(String::as_str).chain(others).chain(pictures) {
            let kept = fs::read(place.join(out)).unwrap();
            tried += 1;
            assert_refused(&call(place, line, out), &format!("{line}: {out}"));
            assert!(fs::read(place.join(out)).unwrap() == kept, "{line}: {out} was replaced");
        }
        assert!(place.join(format!("link{number}.{ending}")).is_symlink());
    }
    let weights = before.keys().find(|name| name.ends_with("weights.safetensors")).unwrap();
    let out = Path::new("run").join(weights);
    for (line, ending) in FILES {
        assert_refused(&call(place, line, &format!("run/checkpoints/new.{ending}")), line);
    }
    let convert = "convert --task spring_color --force run OUT";
    assert_refused(&call(place, convert, out.to_str().unwrap()), "the run's own weights");
    assert!(contents(&place.join("run")) == before, "the run was changed");
    println!("{tried} outputs of a file onto another file");
}

/// In the place of each file that a command writes into a folder lies another one.
#[test]
fn a_folder_with_a_strangers_file_is_left_alone() {
    let folder = prepared();
    let place = folder.path();
    let mut tried = 0;
    for (number, line) in FOLDERS.into_iter().enumerate() {
        let fresh = format!("fresh{number}");
        let done = call(place, line, &fresh);
        assert!(done.status.success(), "{line}: {}", text(&done));
        // A run's lock is only locked.
        let names = contents(&place.join(&fresh)).into_keys().filter(|name| !name.ends_with(".lock"));
        let names: Vec<PathBuf> = names.collect();
        assert!(names.len() > 1, "{line}: {names:?}");
        // Of each folder below the first files are enough.
        let mut seen = BTreeMap::new();
        let names = names.iter().filter(|name| {
            let count = seen.entry(name.parent().unwrap().to_path_buf()).or_insert(0);
            *count += 1;
            *count <= 6
        });
        let names: Vec<&PathBuf> = names.collect();
        tried += names.len();
        names.par_iter().for_each(|name| {
            let out = place.join(format!("strange{number}-{}", name.to_string_lossy().replace('/', "-")));
            fs::create_dir_all(out.join(name).parent().unwrap()).unwrap();
            fs::write(out.join(name), DIARY).unwrap();
            let done = call(place, line, out.to_str().unwrap());
            assert_refused(&done, &format!("{line}: {}", name.display()));
            assert_eq!(contents(&out).len(), 1, "{line}: {} has company", name.display());
            assert_eq!(fs::read_to_string(out.join(name)).unwrap(), DIARY, "{line}: {}", name.display());
        });
    }
    println!("{tried} outputs of a folder with another file in it");
}

/// A run's folder is no place for other results, and its files no targets of links.
#[test]
fn a_run_folder_is_no_output_of_other_commands() {
    let folder = prepared();
    let place = folder.path();
    let before = contents(&place.join("run"));
    // Datasets get a folder of their own in it.
    let sweep = "sweep --task spring_color --data data --threads-per-run 1 --out OUT";
    for line in FOLDERS.into_iter().filter(|line| !line.starts_with("generate")).chain([sweep]) {
        assert_refused(&call(place, line, "run"), line);
        assert!(contents(&place.join("run")) == before, "{line}: the run was changed");
    }
    let baseline = "train-baseline ddpae --task spring_color --data data --steps 1 --threads 1 --out OUT";
    let done = call(place, baseline, "run");
    assert_refused(&done, baseline);
    assert!(text(&done).contains("holds a run already"), "{}", text(&done));
    assert!(contents(&place.join("run")) == before, "{baseline}: the run was changed");
    // A link to a folder among the checkpoints that is not there.
    symlink("run/checkpoints/other", place.join("link")).unwrap();
    for line in FOLDERS.into_iter().chain([sweep, baseline]) {
        let done = call(place, line, "link");
        assert_refused(&done, line);
        assert!(text(&done).contains("link is a link that leads nowhere"), "{line}: {}", text(&done));
        assert!(contents(&place.join("run")) == before, "{line}: the checkpoints were changed");
    }
}

/// A folder that a report cannot be written into is refused before the trainings that it is of.
#[test]
fn a_report_of_trainings_is_refused_before_them() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    for (name, file) in [("strange", "report.md"), ("run", "config.toml"), ("run", "metrics.jsonl")] {
        fs::create_dir_all(place.join(name)).unwrap();
        fs::write(place.join(name).join(file), DIARY).unwrap();
    }
    let before = contents(place);
    for command in ["stress", "baselines"] {
        let line = format!("{command} --list {} --out OUT", project(&format!("configs/{command}.toml")).display());
        for (out, why) in [("strange", "report.md"), ("run", "is a run folder")] {
            let done = call(place, &line, out);
            assert_refused(&done, &line);
            assert!(text(&done).contains(why), "{line}: {}", text(&done));
            assert!(contents(place) == before, "{line}: something was written");
        }
    }
}

/// What was edited and what others put into the folder of a task: an import replaces its own files as a whole, and leaves the rest.
#[test]
fn an_import_replaces_its_own_files_alone_and_follows_no_link() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    throw(&place.join("throw"));
    let import = FOLDERS[3];
    let done = call(place, import, "scene");
    assert!(done.status.success(), "{}", text(&done));
    fs::write(place.join("outside.npz"), DIARY).unwrap();
    fs::remove_file(place.join("scene/film.npz")).unwrap();
    symlink("../outside.npz", place.join("scene/film.npz")).unwrap();
    fs::create_dir(place.join("scene/mine")).unwrap();
    fs::write(place.join("scene/mine/notes.txt"), DIARY).unwrap();
    let task = fs::read_to_string(place.join("scene/task.toml")).unwrap();
    fs::write(place.join("scene/task.toml"), task.clone() + "# edited\n").unwrap();
    let done = call(place, import, "scene");
    assert!(done.status.success(), "{}", text(&done));
    assert_eq!(fs::read_to_string(place.join("outside.npz")).unwrap(), DIARY);
    assert!(!place.join("scene/film.npz").is_symlink());
    assert_eq!(fs::read_to_string(place.join("scene/mine/notes.txt")).unwrap(), DIARY);
    assert_eq!(fs::read_to_string(place.join("scene/task.toml")).unwrap(), task);
    assert_eq!(fs::read_dir(place).unwrap().count(), 3, "something half-written was left");
    // The working directory cannot be exchanged.
    let mut words = import.split(' ').map(|word| if word == "OUT" { "." } else { word });
    let mut command = paig(words.next().unwrap());
    let inside = command
        .current_dir(place.join("scene"))
        .args(words.map(|word| if word == "throw" { "../throw" } else { word }));
    assert_refused(&inside.output().unwrap(), "the working directory");
}
