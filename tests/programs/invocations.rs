//! What each program says to a call that cannot be: the exact first line and the exit code of all calls in
//! `tests/data/bad_invocations.txt`. 0 is done, 1 failed, 2 bad usage or input.
//!
//! `PAIG_BLESS=1` writes what the programs say now into that file: read the difference before it is committed.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{dataset, spring, write_config};
use crate::programs::{paig, text};
use crate::project::project;
use crate::tiny::TINY;
use paig::support::device::{cores, most_threads};
use rayon::prelude::*;

/// A refusal comes before anything slow. Machines of tests are busy.
const AT_ONCE: Duration = Duration::from_secs(60);

fn table_file() -> PathBuf {
    project("tests/data/bad_invocations.txt")
}

/// What the calls find: a dataset, a run, and things that are none.
fn prepare(place: &Path) {
    std::os::unix::fs::symlink(dataset(), place.join("data")).unwrap();
    write_config(place, TINY);
    let mut command = spring(Path::new("run"));
    command.current_dir(place).args(["--data", "data", "--config", "test.toml", "--threads", "1"]);
    let done = command.output().unwrap();
    assert!(done.status.success(), "{}", text(&done));
    fs::create_dir_all(place.join("strange")).unwrap();
    fs::write(place.join("strange/diary.txt"), "dear diary").unwrap();
    fs::create_dir_all(place.join("empty")).unwrap();
    fs::write(place.join("text.txt"), "words").unwrap();
    fs::write(place.join("text.npz"), "words").unwrap();
    fs::write(place.join("text.toml"), "words").unwrap();
    fs::write(place.join("other.toml"), "task = \"pendulum\"\n").unwrap();
    assert!(Command::new("mkfifo").arg(place.join("pipe.npz")).status().unwrap().success());
    let mut video = fs::read(project("tests/data/numbered.mp4")).unwrap();
    fs::write(place.join("video.mp4"), &video).unwrap();
    video.truncate(2000);
    fs::write(place.join("cut.mp4"), video).unwrap();
    fs::write(place.join("huge.npz"), huge_npz()).unwrap();
}

/// An npz of a few hundred bytes whose array claims 10^9 clips.
fn huge_npz() -> Vec<u8> {
    let bytes = std::io::Cursor::new(Vec::new());
    let mut npz = ndarray_npy::NpzWriter::new(bytes);
    npz.add_array("test_x", &ndarray::Array5::<u8>::zeros((1, 30, 4, 4, 3))).unwrap();
    let mut bytes = npz.finish().unwrap().into_inner();
    let claim = b"(1, 30, 4, 4, 3)";
    let at = bytes.windows(claim.len()).position(|window| window == claim).unwrap();
    bytes[at..at + claim.len()].copy_from_slice(b"(999999999,9999)");
    bytes
}

/// The first line that a call prints to standard error, with its exit code.
fn said(call: &str, place: &Path) -> String {
    let words = shlex::split(call).unwrap();
    assert_eq!(words[0], "paig", "{call}");
    let mut command = paig(&words[1]);
    let start = Instant::now();
    // Without what this machine may have installed, such as ffmpeg.
    command.args(&words[2..]).current_dir(place).stdin(Stdio::null()).env("PATH", "");
    let output = command.output().unwrap();
    assert!(start.elapsed() < AT_ONCE, "{call}: took {:?}", start.elapsed());
    let error = String::from_utf8(output.stderr).unwrap();
    let of_this_machine = format!("at most {} on the {} cores", most_threads(), cores());
    let first = error.lines().next().unwrap_or_default().replace(&of_this_machine, "at most 64 on the N cores");
    let first = first.replace(&format!("{} cores", cores()), "N cores");
    // Wrong options are explained with the usage; everything else is one line.
    let usage = error.contains("For more information, try '--help'.");
    assert!(usage || error.trim_end().lines().count() == 1, "{call}: more than one line: {error}");
    let code = output.status.code().unwrap_or_else(|| panic!("{call}: {}", output.status));
    format!("{code} {first}")
}

/// What a call says when no other call is using its run.
fn said_alone(call: &str, place: &Path) -> String {
    let start = Instant::now();
    loop {
        let answer = said(call, place);
        if !answer.contains("another run is using") || start.elapsed() > AT_ONCE {
            return answer;
        }
    }
}

#[test]
fn bad_invocations_are_refused_in_these_words() {
    let folder = tempfile::tempdir().unwrap();
    prepare(folder.path());
    let table = fs::read_to_string(table_file()).unwrap();
    let calls: Vec<&str> = table.lines().filter_map(|line| line.strip_prefix("$ ")).collect();
    // Most of the time goes into loading libtorch, once for each call.
    let answers: Vec<String> = calls.par_iter().map(|call| said_alone(call, folder.path())).collect();
    let (mut found, mut answers, calls) = (String::new(), answers.iter(), calls.len());
    for line in table.lines() {
        if line.starts_with("$ ") {
            write!(found, "{line}\n{}\n", answers.next().unwrap()).unwrap();
        } else if line.starts_with('#') || line.is_empty() {
            writeln!(found, "{line}").unwrap();
        }
    }
    println!("{calls} bad invocations");
    assert!(calls >= 100, "{calls} calls");
    if std::env::var_os("PAIG_BLESS").is_some() {
        fs::write(table_file(), &found).unwrap();
    }
    for (expected, found) in table.lines().zip(found.lines()) {
        assert_eq!(found, expected);
    }
    assert_eq!(table, found);
    // Nothing was written among what was there.
    let names = |place: &Path| fs::read_dir(place).unwrap().map(|entry| entry.unwrap().file_name()).collect::<Vec<_>>();
    assert_eq!(names(&folder.path().join("strange")), ["diary.txt"]);
    assert!(names(&folder.path().join("empty")).is_empty());
}
