//! Signals: whoever stops a job lets its runs save, however often the signal comes.

use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::common::{dataset, fresh, spring, write_config};
use crate::process::{Signal, signal};
use crate::programs::{paig, text};

/// A run that never ends by itself.
const ENDLESS: &str = "[discover]\nframes = 8\nmax_steps = 1000000\n[join]\nbatch = 4\nvalidation_clips = 4\n\
    [output]\nprint_every = 2\ncheckpoint_every = 1000000\nexamples = 0\n";

fn wait_for(path: &Path) {
    let started = Instant::now();
    while fs::metadata(path).map_or(0, |file| file.len()) < 400 {
        assert!(started.elapsed() < Duration::from_secs(300), "nothing in {} after five minutes", path.display());
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Stops an endless run by these signals, some tenths of a second apart; its exit code. It must have saved.
fn stopped(signals: &[Signal]) -> Option<i32> {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let config = write_config(folder.path(), ENDLESS);
    let mut command = spring(&run);
    fresh(&mut command).arg("--config").arg(&config).stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = command.spawn().unwrap();
    wait_for(&run.join("metrics.jsonl"));
    for sent in signals {
        signal(child.id(), *sent);
        std::thread::sleep(Duration::from_millis(100));
    }
    let output = child.wait_with_output().unwrap();
    assert!(run.join("checkpoints/index.json").exists(), "nothing was saved: {}", text(&output));
    assert!(text(&output).contains("go on with --resume"), "{}", text(&output));
    output.status.code()
}

#[test]
fn a_signal_that_comes_twice_is_one() {
    assert_eq!(stopped(&[Signal::SIGTERM, Signal::SIGINT, Signal::SIGTERM]), Some(143));
}

#[test]
fn a_warning_before_a_time_limit_saves_and_stops() {
    assert_eq!(stopped(&[Signal::SIGUSR1]), Some(138));
}

/// What `scancel` and a time limit do: every process of the job gets the signal, the run by itself and through the sweep.
#[test]
fn a_signal_to_all_processes_of_a_job_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let config = write_config(folder.path(), ENDLESS);
    let mut command = paig("sweep");
    command.args(["--task", "spring_color", "--name", "endless", "--threads-per-run", "1", "--config"]).arg(config);
    command.arg("--data").arg(dataset()).arg("--out").arg(folder.path());
    let sweep = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let run = folder.path().join("spring_color/fast-endless/seed=0");
    wait_for(&run.join("metrics.jsonl"));
    let children = fs::read_to_string(format!("/proc/{0}/task/{0}/children", sweep.id())).unwrap();
    let child = children.split_whitespace().next().expect("the sweep runs nothing");
    [child.parse().unwrap(), sweep.id()].into_iter().for_each(|process| signal(process, Signal::SIGTERM));
    let output = sweep.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(143), "{}", text(&output));
    assert!(text(&output).contains("1 stopped"), "{}", text(&output));
    let said = fs::read_to_string(run.join("output.log")).unwrap();
    assert!(said.contains("go on with --resume"), "{said}");
    assert!(run.join("checkpoints/index.json").exists());
}
