//! What a long training holds on to, and a dataset that is larger than the memory it may take. `make torture` runs it;
//! what it prints, one line of JSON, goes into `reports/torture`.
//!
//! `cargo xtask resources STEPS` needs `paig` in `target/release`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use anyhow::{Result, ensure};
use clap::Args;
use ndarray::{Axis, concatenate};
use paig::datasets::files::{ClipShape, DatasetFile};
use paig::tasks;

use serde_json::{Value, json};

use crate::programs::{self, done, last_weights};

/// A training whose last phase goes on for as long as it is told.
const LONG: &str = "[discover]\nframes = 4\nmax_steps = 40\n[discover.guide]\nfull_until = 10\nzero_from = 20\n\
    [identify]\nclips = 4\nhorizons = [3]\nmax_iterations = 2\n\
    [join]\nbatch = 2\nvalidation_clips = 2\n[join.schedule]\nvalidate_every = 100\nplateau = 0.0\n\
    [output]\nprint_every = 10\ncheckpoint_every = 100\nexamples = 1\n";
/// Times that the small dataset's clips stand in the large one: 1.5 GiB of frames.
const TIMES: usize = 44;
/// Addresses that the training on it may take, in kB: too few to hold it, enough for everything else.
const LIMIT: u64 = 2_600_000;

/// Shows what a long training holds on to, and learns from a dataset larger than the memory it may take.
#[derive(Debug, Args)]
pub struct ResourcesArguments {
    /// Of the long training
    steps: u64,
}

/// # Errors
/// A program that is not built, that fails, or that does what it must not.
pub fn run(arguments: &ResourcesArguments) -> Result<()> {
    let steps = &arguments.steps.to_string();
    let folder = tempfile::tempdir()?;
    let trial = ResourceTrial { place: folder.path().into(), paig: programs::paig()? };
    fs::write(trial.place.join("long.toml"), LONG)?;
    done(&trial.generate("data", 12)?)?;
    let held = trial.held_over(steps)?;
    let larger = trial.larger_than_memory()?;
    println!("{}", json!({"steps": held, "larger_than_memory": larger}));
    Ok(())
}

/// Where it is tried.
struct ResourceTrial {
    place: PathBuf,
    paig: PathBuf,
}

impl ResourceTrial {
    fn generate(&self, out: &str, clips: usize) -> Result<Output> {
        let mut command = Command::new(&self.paig);
        command.current_dir(&self.place).args([
            "generate",
            "--task",
            "spring_color",
            "--valid",
            "4",
            "--test",
            "4",
            "--out",
            out,
        ]);
        Ok(command.args(["--train", &clips.to_string()]).output()?)
    }

    /// A training on one thread, which may take so many kB of addresses.
    fn train(&self, data: &str, out: &str, steps: &str, limit: Option<u64>) -> Command {
        let mut command = Command::new("sh");
        let limit = limit.map_or(String::new(), |limit| format!("ulimit -v {limit} && "));
        command.current_dir(&self.place).arg("-c").arg(format!("{limit}exec \"$0\" \"$@\""));
        command.arg(&self.paig).args(["train", "--task", "spring_color", "--config", "long.toml"]);
        command.args(["--threads", "1", "--data", data, "--out", out, "--set", &format!("join.max_steps={steps}")]);
        command
    }

    /// Memory, open files and threads of a training of so many steps, each time another tenth of it is done.
    fn held_over(&self, steps: &str) -> Result<Vec<Value>> {
        let all: u64 = steps.parse()?;
        let mut child = self.train("data", "long", steps, None).stdout(Stdio::null()).spawn()?;
        let mut held: Vec<Value> = Vec::new();
        while child.try_wait()?.is_none() {
            std::thread::sleep(Duration::from_millis(50));
            let step = last_step(&self.place.join("long/metrics.jsonl"));
            if step >= (held.len() as u64 + 1) * all / 10 {
                let process = PathBuf::from(format!("/proc/{}", child.id()));
                let Some(now) = holds(&process, step) else { continue };
                held.push(now);
            }
        }
        ensure!(child.wait()?.success(), "the long training failed");
        Ok(held)
    }

    /// A dataset that does not fit under a limit of memory is learned from to the same bits as without the limit.
    fn larger_than_memory(&self) -> Result<Value> {
        done(&self.generate("small", 1000)?)?;
        let task = tasks::find("spring_color")?;
        let (small, large) = (self.place.join("small"), self.place.join("large"));
        for (file, shape, times) in
            [(&task.train_file, ClipShape::training(&task), TIMES), (&task.test_file, ClipShape::test(&task), 1)]
        {
            let DatasetFile { train, valid, test, actions } = DatasetFile::read(&small.join(file), &shape)?;
            let train = concatenate(Axis(0), &vec![train.view(); times])?;
            DatasetFile { train, valid, test, actions }.write(&large.join(file))?;
        }
        let trained = |out: &str, limit| -> Result<Vec<u8>> {
            let output = self.train("large", out, "20", limit).output()?;
            done(&output)?;
            let on_disk = String::from_utf8_lossy(&output.stdout).contains("read from the disk");
            ensure!(on_disk == limit.is_some(), "{out}: read from the disk: {on_disk}");
            last_weights(&self.place.join(out))
        };
        // Steps of all frames at once would take hundreds of GiB: refused before anything is written.
        let frames = format!("discover.frames={}", 1000 * TIMES * task.train_frames);
        let refused = self.train("large", "refused", "20", Some(LIMIT)).args(["--set", &frames]).output()?;
        let said = String::from_utf8_lossy(&refused.stderr).contains("this training needs more memory than there is");
        ensure!(said && !self.place.join("refused").exists(), "a training that cannot fit: {refused:?}");
        let same = trained("limited", Some(LIMIT))? == trained("free", None)?;
        let clips = 1000 * TIMES;
        let frames = clips * task.train_frames * task.system.side.pow(2) * task.system.channels;
        Ok(json!({"frames_mb": frames >> 20, "limit_mb": LIMIT >> 10, "same_bits": same, "too_large_refused": said}))
    }
}

/// The step of the last whole line of metrics.jsonl of the phase join.
fn last_step(metrics: &Path) -> u64 {
    let text = fs::read_to_string(metrics).unwrap_or_default();
    let records = text.lines().rev().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let mut joined = records.filter(|record| record["phase"] == "join");
    joined.find_map(|record| record["step"].as_u64()).unwrap_or(0)
}

/// What a process holds now.
fn holds(process: &Path, step: u64) -> Option<Value> {
    let status = fs::read_to_string(process.join("status")).ok()?;
    let number = |name: &str| -> Option<u64> {
        status.lines().find_map(|line| line.strip_prefix(name))?.split_whitespace().next()?.parse().ok()
    };
    let files = fs::read_dir(process.join("fd")).ok()?.count();
    Some(json!({"step": step, "memory_mb": number("VmRSS:")? >> 10, "files": files, "threads": number("Threads:")?}))
}
