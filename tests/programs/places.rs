//! Where programs write and where they do not: devices, pipes, links, other people's files, folders in use.

use std::fs;
use std::io::Read;
use std::os::unix::fs::{FileTypeExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use crate::common::{dataset, fresh, spring, write_config};
use crate::programs::{paig, text};
use crate::tiny::TINY;
use serde_json::Value;
use tempfile::TempDir;

/// A finished run that the tests share.
fn run() -> PathBuf {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let config = write_config(folder.path(), TINY);
        let done = fresh(&mut spring(&folder.path().join("run"))).arg("--config").arg(config).output().unwrap();
        assert!(done.status.success(), "{}", text(&done));
        // What each phase took, and what comes next.
        let said = text(&done);
        for words in ["(discover ", "identify ", "join ", "next: paig predict "] {
            assert!(said.contains(words), "{words:?} is not in {said}");
        }
        folder
    });
    folder.path().join("run")
}

fn call(program: &str, run: &Path, arguments: &[&str]) -> Output {
    paig(program).arg(run).args(arguments).args(["--threads", "1"]).output().unwrap()
}

fn evaluate(json: &Path) -> Output {
    call("evaluate", &run(), &["--json", json.to_str().unwrap()])
}

#[test]
fn devices_and_pipes_are_written_to_and_links_followed() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    // A link leads to a file, which may not be there yet.
    symlink("real.json", place("link.json")).unwrap();
    let done = evaluate(&place("link.json"));
    assert!(done.status.success(), "{}", text(&done));
    assert!(place("link.json").is_symlink());
    let scores: Value = serde_json::from_slice(&fs::read(place("real.json")).unwrap()).unwrap();
    assert_eq!(scores["task"], "spring_color");
    // A device that is full says so, and is a device after it.
    symlink("/dev/full", place("full.json")).unwrap();
    let full = evaluate(&place("full.json"));
    assert_eq!(full.status.code(), Some(1), "{}", text(&full));
    assert!(text(&full).contains("No space left"), "{}", text(&full));
    assert!(fs::metadata("/dev/full").unwrap().file_type().is_char_device());
    // A pipe is read from its other end.
    assert!(Command::new("mkfifo").arg(place("pipe.json")).status().unwrap().success());
    let pipe = place("pipe.json");
    let reader = std::thread::spawn(move || {
        let mut text = String::new();
        fs::File::open(pipe).unwrap().read_to_string(&mut text).unwrap();
        text
    });
    let done = evaluate(&place("pipe.json"));
    assert!(done.status.success(), "{}", text(&done));
    assert!(reader.join().unwrap().contains("recons_loss"));
    assert!(fs::metadata(place("pipe.json")).unwrap().file_type().is_fifo());
    // Folders are refused before anything is computed.
    assert_eq!(evaluate(folder.path()).status.code(), Some(2));
}

#[test]
fn data_that_moved_are_named_by_an_option() {
    let folder = tempfile::tempdir().unwrap();
    let moved = folder.path().join("moved");
    symlink(dataset(), &moved).unwrap();
    let json = folder.path().join("scores.json");
    let options = ["--data", moved.to_str().unwrap(), "--json", json.to_str().unwrap()];
    let done = call("evaluate", &run(), &options);
    assert!(done.status.success(), "{}", text(&done));
    assert!(fs::read_to_string(json).unwrap().contains("moved/spring_color"));
}

#[test]
fn runs_and_predictions_keep_out_of_other_folders() {
    let folder = tempfile::tempdir().unwrap();
    let mine = folder.path().join("mine");
    fs::create_dir(&mine).unwrap();
    fs::write(mine.join("log.txt"), "dear diary").unwrap();
    let refused = fresh(&mut spring(&mine)).output().unwrap();
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused));
    assert!(text(&refused).contains("\"log.txt\", which is of no run"), "{}", text(&refused));
    assert_eq!(fs::read_to_string(mine.join("log.txt")).unwrap(), "dear diary");
    let before = fs::read(run().join("animation.gif")).unwrap();
    let refused = call("predict", &run(), &["--out", run().to_str().unwrap()]);
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused));
    assert!(fs::read(run().join("animation.gif")).unwrap() == before);
    // An earlier prediction is replaced.
    let out = folder.path().join("prediction");
    for _ in 0..2 {
        let done = call("predict", &run(), &["--frames", "2", "--out", out.to_str().unwrap()]);
        assert!(done.status.success(), "{}", text(&done));
    }
}

fn sweep(folder: &Path, more: &[&str]) -> Output {
    let mut command = paig("sweep");
    command.args(["--task", "spring_color", "--config"]).arg(write_config(folder, TINY)).arg("--data").arg(dataset());
    command.arg("--out").arg(folder.join("runs")).args(more).output().unwrap()
}

#[test]
fn a_run_that_is_under_way_is_left_to_its_process() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("runs/spring_color/fast-tiny/seed=0");
    fs::create_dir_all(&out).unwrap();
    let lock = fs::File::create(out.join(".lock")).unwrap();
    lock.lock().unwrap();
    let done = sweep(folder.path(), &["--name", "tiny", "--threads-per-run", "1"]);
    assert!(done.status.success(), "{}", text(&done));
    for words in ["left to it", "0 failed, 1 under way elsewhere"] {
        assert!(text(&done).contains(words), "{}", text(&done));
    }
    assert!(!out.join("output.log").exists());
}

#[test]
fn a_grid_names_its_runs_and_the_status_shows_them() {
    let folder = tempfile::tempdir().unwrap();
    let grid = ["--grid", "join.batch=2,3", "--grid", "model.exact_shift=true,false"];
    let printed = sweep(folder.path(), &[&grid[..], &["--dry-run"]].concat());
    let printed = String::from_utf8(printed.stdout).unwrap();
    assert_eq!(printed.lines().count(), 4, "{printed}");
    // The machine that will run it has its own cores.
    assert!(!printed.contains("--threads-per-run"), "{printed}");
    assert!(printed.contains("join.batch=3-model.exact_shift=false"), "{printed}");
    let one = ["--grid", "join.batch=2", "--threads-per-run", "1"];
    let waiting = text(&sweep(folder.path(), &[&one[..], &["--status"]].concat()));
    assert!(waiting.contains("waiting") && waiting.contains("fast-join.batch=2/seed=0"), "{waiting}");
    assert!(!folder.path().join("runs").exists(), "the status wrote something");
    let done = sweep(folder.path(), &one);
    assert!(done.status.success(), "{}", text(&done));
    let finished = text(&sweep(folder.path(), &[&one[..], &["--status"]].concat()));
    assert!(finished.contains("finished") && finished.contains("join"), "{finished}");
}

#[test]
fn variants_run_beside_the_recipe_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let tie = ["--variant", "discover.guide.tie=0", "--name", "tiny"];
    let variants = [&tie[..], &["--variant", "identify.recentre=false join.max_steps=0"]].concat();
    let printed = sweep(folder.path(), &[&variants[..], &["--dry-run"]].concat());
    let printed = String::from_utf8(printed.stdout).unwrap();
    let lines: Vec<&str> = printed.lines().collect();
    assert_eq!(lines.len(), 3, "{printed}");
    assert!(!lines[0].contains("tie") && lines[1].contains("tiny-discover.guide.tie=0"), "{printed}");
    assert!(lines[2].contains("identify.recentre=false-join.max_steps=0") && !lines[2].contains("tie"), "{printed}");
    let empty = sweep(folder.path(), &["--variant", " ", "--dry-run"]);
    assert!(!empty.status.success() && text(&empty).contains("expected key=value"), "{}", text(&empty));
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for name in ["config.toml", "metrics.jsonl", "summary.json"] {
        fs::copy(from.join(name), to.join(name)).unwrap();
    }
}

#[test]
fn a_report_counts_every_folder_and_groups_by_what_was_learned_from() {
    let folder = tempfile::tempdir().unwrap();
    let runs = folder.path().join("runs");
    copy(&run(), &runs.join("sound"));
    let edit = |name: &str, file: &str, from: &str, to: &str| {
        copy(&run(), &runs.join(name));
        let path = runs.join(name).join(file);
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{from:?} is not in {file}");
        fs::write(path, text.replace(from, to)).unwrap();
    };
    // A config that contradicts its summary, a summary without a course, a course without a config.
    edit("other", "summary.json", "\"task\": \"spring_color\"", "\"task\": \"pendulum\"");
    copy(&run(), &runs.join("bare"));
    fs::remove_file(runs.join("bare/config.toml")).unwrap();
    // The same data in another place, by another seed: the same recipe.
    edit("moved", "config.toml", "seed = 0", "seed = 3");
    let place = dataset().to_str().unwrap();
    let config = fs::read_to_string(runs.join("moved/config.toml")).unwrap();
    fs::write(runs.join("moved/config.toml"), config.replace(place, "/another/place")).unwrap();
    let summary = fs::read_to_string(runs.join("moved/summary.json")).unwrap();
    fs::write(runs.join("moved/summary.json"), summary.replace("\"seed\": 0", "\"seed\": 3")).unwrap();
    // Another data set of the same kind: the same recipe, too.
    edit("fresh", "config.toml", "seed = 0", "seed = 4");
    let summary = fs::read_to_string(runs.join("fresh/summary.json")).unwrap();
    let of_other_data = summary.replace("\"seed\": 0", "\"seed\": 4").replace(", seed 0, ", ", seed 5, ");
    fs::write(runs.join("fresh/summary.json"), of_other_data).unwrap();
    let out = folder.path().join("report");
    let done = paig("report").arg(&runs).arg("--out").arg(&out).output().unwrap();
    assert!(done.status.success(), "{}", text(&done));
    assert!(text(&done).contains("3 finished, 0 unfinished, 2 unreadable"), "{}", text(&done));
    let page = fs::read_to_string(out.join("report.md")).unwrap();
    for words in ["runs/other", "runs/bare", "different runs"] {
        assert!(page.contains(words), "{words:?} is not in the report");
    }
    let results: Value = serde_json::from_slice(&fs::read(out.join("results.json")).unwrap()).unwrap();
    let tasks = results["tasks"].as_array().unwrap().iter();
    let springs: Vec<_> = tasks.filter(|task| task["task"] == "spring_color").collect();
    assert_eq!(springs.len(), 1, "one recipe, two groups: {results}");
    assert_eq!((&springs[0]["tried"], &springs[0]["datasets"]), (&3.into(), &2.into()));
}
