//! The sweep: several runs at a time, one of which fails, then again.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use crate::common::{dataset, write_config};
use crate::process::{Signal, signal};
use crate::programs::{paig, text};
use paig::tasks;
use paig_experiments::sweep::parse_seeds;

/// A run that takes seconds.
const TINY: &str = "[discover]\nframes = 8\nmax_steps = 6\n\
    [identify]\nclips = 6\nhorizons = [3, 5]\nmax_iterations = 3\n\
    [join]\nbatch = 4\nmax_steps = 4\nvalidation_clips = 4\n\
    [output]\nprint_every = 2\ncheckpoint_every = 3\nexamples = 0\n";

fn sweep(folder: &Path, seeds: &str) -> Command {
    let mut command = paig("sweep");
    command.args(["--task", "spring_color", "--seeds", seeds, "--name", "tiny", "--threads-per-run", "1", "--config"]);
    command.arg(folder.join("test.toml")).arg("--data").arg(dataset()).arg("--out").arg(folder.join("my runs"));
    command
}

#[track_caller]
fn assert_ended(output: &Output, code: i32, words: &[&str]) {
    assert_eq!(output.status.code(), Some(code), "{}", text(output));
    for word in words {
        assert!(text(output).contains(word), "{word:?} is not in: {}", text(output));
    }
}

#[test]
fn a_failed_run_stops_no_other_and_a_second_sweep_skips_and_resumes() {
    let folder = tempfile::tempdir().unwrap();
    write_config(folder.path(), TINY);
    let run = |seed: u64| folder.path().join(format!("my runs/spring_color/fast-tiny/seed={seed}"));
    fs::create_dir_all(run(0)).unwrap();
    fs::write(run(0).join("config.toml"), "task = [").unwrap();
    let first = sweep(folder.path(), "0-1").args(["--jobs", "2"]).output().unwrap();
    assert_ended(&first, 1, &["1 finished, 0 skipped, 0 stopped, 1 failed", "seed=0/output.log"]);
    assert!(fs::read_to_string(run(0).join("output.log")).unwrap().contains("config"), "no reason was noted");
    assert!(!run(0).join("DONE").exists() && run(1).join("DONE").exists());
    assert!(fs::read_to_string(run(1).join("output.log")).unwrap().contains("finished after 10 steps"));

    // The damaged folder repaired, a cut-off run (without its marker), and commands run by something else.
    fs::remove_file(run(0).join("config.toml")).unwrap();
    // Left over from a run that was deleted: it says nothing of the next one.
    fs::write(run(0).join("DONE"), "").unwrap();
    fs::remove_file(run(1).join("DONE")).unwrap();
    let printed = sweep(folder.path(), "0-1").arg("--dry-run").output().unwrap();
    let printed = String::from_utf8(printed.stdout).unwrap();
    assert_eq!(printed.lines().count(), 2, "{printed}");
    for (command, word) in printed.lines().zip(["started", "resumed"]) {
        let done = Command::new("sh").arg("-c").arg(command).output().unwrap();
        assert_ended(&done, 0, &["1 finished, 0 skipped, 0 stopped, 0 failed", word]);
    }
    let summaries = [run(0).join("summary.json"), run(1).join("summary.json")].map(|path| fs::metadata(path).unwrap());
    let third = sweep(folder.path(), "0-1").output().unwrap();
    assert_ended(&third, 0, &["0 finished, 2 skipped, 0 stopped, 0 failed"]);
    for (seed, before) in summaries.iter().enumerate() {
        let now = fs::metadata(run(seed as u64).join("summary.json")).unwrap();
        assert_eq!(now.modified().unwrap(), before.modified().unwrap(), "a finished run was run again");
    }

    // Why a run fails is said where people look.
    let blind = sweep(folder.path(), "7").args(["--set", "data.train_file=nowhere.npz"]).output().unwrap();
    assert_ended(&blind, 1, &["1 failed", "there is no dataset file"]);

    // The same folders with another config are refused, run by run.
    let other = sweep(folder.path(), "1").args(["--set", "join.max_steps=5"]).output().unwrap();
    assert_ended(&other, 1, &["0 finished, 0 skipped, 0 stopped, 1 failed", "another config"]);
}

#[test]
fn an_interrupted_sweep_lets_its_runs_save() {
    let folder = tempfile::tempdir().unwrap();
    write_config(folder.path(), &TINY.replace("max_steps = 6", "max_steps = 100000"));
    let child = sweep(folder.path(), "0-1").stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let run = folder.path().join("my runs/spring_color/fast-tiny/seed=0");
    let started = Instant::now();
    while !run.join("checkpoints/index.json").exists() {
        assert!(started.elapsed() < Duration::from_secs(300), "no checkpoint after five minutes");
        std::thread::sleep(Duration::from_millis(50));
    }
    signal(child.id(), Signal::SIGINT);
    let output = child.wait_with_output().unwrap();
    assert_ended(&output, 130, &["0 finished, 0 skipped, 2 stopped, 0 failed"]);
    let said = fs::read_to_string(run.join("output.log")).unwrap();
    assert!(said.contains("go on with --resume"), "{said}");
    assert!(!run.join("DONE").exists() && !run.with_file_name("seed=1").exists());
}

#[test]
fn seeds_and_changes_are_checked() {
    assert_eq!(parse_seeds("0-2,7").unwrap(), [0, 1, 2, 7]);
    assert_eq!(parse_seeds("2,0-2,0").unwrap(), [2, 0, 1]);
    for unsound in ["", "a", "5-2", "1-", "-3"] {
        assert!(parse_seeds(unsound).is_err(), "{unsound:?} was taken");
    }
    let refused = |arguments: &[&str]| {
        let output = paig("sweep").args(arguments).output().unwrap();
        assert!(!output.status.success());
        text(&output)
    };
    // What is asked for twice is one run: a folder takes no more.
    let mut twice = paig("sweep");
    twice.args(["--task", "spring_color", "--seeds", "3", "--grid", "join.batch=4,4", "--status"]);
    let status = text(&twice.output().unwrap());
    assert_eq!(status.matches("seed=3").count(), 1, "{status}");
    assert!(refused(&["--task", "spring_color", "--set", "join.batch=5"]).contains("--name"));
    assert!(refused(&["--task", "spring_color", "--name", "a/b"]).contains("folder's name"));
    assert!(refused(&["--task", "spring_color", "--recipe", "slow"]).contains("fast, paper"));
    assert!(refused(&["--task", "spring_color", "--set", "join.bach=5", "--name", "x"]).contains("bach"));
    // Two tasks of one name are no one run.
    let folder = tempfile::tempdir().unwrap();
    let files = ["first.toml", "second.toml"].map(|name| folder.path().join(name));
    let mine = tasks::find("spring_color").unwrap().to_table();
    for (file, dt) in files.iter().zip([0.3, 0.2]) {
        let mut mine = mine.clone();
        mine.insert("name".into(), "mine".into());
        mine["system"]["dt"] = dt.into();
        fs::write(file, toml::to_string(&mine).unwrap()).unwrap();
    }
    let [first, second] = files.each_ref().map(|file| file.to_str().unwrap());
    let said = refused(&["--task", first, "--task", second, "--status"]);
    assert!(said.contains("first.toml and ") && said.contains("would share the run folder"), "{said}");
}
