//! Kills the programs at random moments, lets them run into full and read-only disks and into each other, and looks at
//! what is left. A part of `make torture`.
//!
//! `cargo xtask torture KILLS SECONDS` ends after so many kills, or at the latest after so many
//! seconds, and prints a line of JSON. It needs `paig` in `target/release`.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use clap::Args;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

use crate::programs::{self, done, last_weights};
use crate::project::project;

/// A training of all phases in a few seconds.
const TINY: &str = "[discover]\nframes = 4\nmax_steps = 40\n[discover.schedule]\nvalidate_every = 20\n\
    [discover.guide]\nfull_until = 10\nzero_from = 20\n[identify]\nclips = 4\nhorizons = [3, 5]\nmax_iterations = 2\n\
    [join]\nbatch = 2\nmax_steps = 20\nvalidation_clips = 2\n[join.schedule]\nvalidate_every = 10\n\
    [output]\nprint_every = 2\ncheckpoint_every = 3\nexamples = 1\n";
/// Size of the disk that is too small, and that it is given afterwards.
const SMALL: &str = "size=6m";
const LARGE: &str = "size=200m";

/// Kills of imports over an edited task, besides the others.
const IMPORT_KILLS: u32 = 200;
const IMPORT: &str = "import over an edited task";
/// The files of an imported task, and one of its user.
const TASK: [&str; 5] = ["task.toml", "train.npz", "test.npz", "film.npz", "contact-sheet.png"];
const NOTES: &str = "notes.txt";

/// What is torn at, and what came out.
struct Torture {
    place: PathBuf,
    paig: PathBuf,
    random: ChaCha8Rng,
    until: Instant,
    kills: BTreeMap<&'static str, u32>,
    most_kills: u32,
    /// What was lost or wrong, in words.
    lost: Vec<String>,
    notes: Vec<String>,
}

/// Kills the program at random moments, fills disks, and looks at what is left.
#[derive(Debug, Args)]
pub struct TortureArguments {
    /// Kills after which it ends
    kills: u32,
    /// Seconds after which it ends
    seconds: u64,
}

/// # Errors
/// Something was lost.
pub fn run(arguments: &TortureArguments) -> Result<()> {
    let folder = tempfile::tempdir()?;
    let mut torture = Torture {
        place: folder.path().into(),
        paig: programs::paig()?,
        random: ChaCha8Rng::from_os_rng(),
        until: Instant::now() + Duration::from_secs(arguments.seconds),
        kills: BTreeMap::new(),
        most_kills: arguments.kills,
        lost: Vec::new(),
        notes: Vec::new(),
    };
    let start = Instant::now();
    // What stops it is told with the rest.
    if let Err(error) = torture.run() {
        torture.lost.push(format!("{error:#}"));
    }
    let Torture { kills, lost, notes, .. } = torture;
    println!("{}", json!({"kills": kills, "lost": lost, "not_tried": notes, "seconds": start.elapsed().as_secs()}));
    ensure!(lost.is_empty(), "something was lost");
    Ok(())
}

impl Torture {
    fn run(&mut self) -> Result<()> {
        self.prepare()?;
        self.two_at_once()?;
        self.small_disk()?;
        self.future_dates()?;
        self.kill_imports()?;
        while self.goes_on() {
            self.kill_trainings()?;
            self.kill_writers()?;
            self.kill_sweep()?;
        }
        Ok(())
    }

    fn goes_on(&self) -> bool {
        let besides = self.kills.iter().filter(|(what, _)| **what != IMPORT).map(|(_, kills)| kills);
        Instant::now() < self.until && besides.sum::<u32>() < self.most_kills
    }

    fn command(&self, name: &str) -> Command {
        let mut command = Command::new(&self.paig);
        command.arg(name).current_dir(&self.place).stdin(Stdio::null()).env("OMP_NUM_THREADS", "1");
        command
    }

    fn train(&self, out: &Path) -> Command {
        let mut command = self.command("train");
        command.arg("--out").arg(out);
        if out.join("config.toml").exists() {
            command.arg("--resume");
        } else {
            command.args(["--task", "spring_color", "--config", "tiny.toml", "--data", "data", "--threads", "1"]);
        }
        command
    }

    fn generate(&self, out: &str) -> Command {
        let mut command = self.command("generate");
        command.args(["--task", "spring_color", "--train", "12", "--valid", "4", "--test", "4", "--out", out]);
        command.args(["--threads", "1"]);
        command
    }

    fn sweep(&self) -> Command {
        let mut command = self.command("sweep");
        command.args(["--task", "spring_color", "--seeds", "0-1", "--name", "tiny", "--config", "tiny.toml"]);
        command.args(["--data", "data", "--out", "sweep", "--threads-per-run", "1", "--jobs", "2"]);
        command
    }

    /// What is whole: a dataset, a run, and what the programs make of it.
    fn prepare(&mut self) -> Result<()> {
        fs::write(self.place.join("tiny.toml"), TINY)?;
        done(&self.generate("data").output()?)?;
        done(&self.train(Path::new("whole")).output()?)?;
        for (_, mut command) in self.writers("sound") {
            done(&command.output()?)?;
        }
        Ok(())
    }

    /// The programs that write what can be compared, each with the files it writes.
    fn writers(&self, out: &str) -> Vec<(Vec<String>, Command)> {
        let file = |name: &str| format!("{out}-{name}");
        let with = |name: &str, arguments: &[&str]| {
            let mut command = self.command(name);
            command.args(arguments);
            command
        };
        let dataset = ["color_spring_vx8_vy8_sl12_r2_k4_e6", "color_spring_vx8_vy8_sl30_r2_k4_e6"];
        let datasets = dataset.map(|name| format!("{}/spring_color/{name}.npz", file("data")));
        let prediction = ["frames.png", "states.csv", "rollout.npz", "animation.gif"];
        let (json, npz, folder) = (file("scores.json"), file("weights.npz"), file("prediction"));
        vec![
            (datasets.to_vec(), self.generate(&file("data"))),
            (vec![json.clone()], with("evaluate", &["whole", "--threads", "1", "--json", &json])),
            (
                prediction.map(|name| format!("{folder}/{name}")).to_vec(),
                with("predict", &["whole", "--threads", "1", "--frames", "8", "--out", &folder]),
            ),
            (vec![npz.clone()], with("convert", &["--task", "spring_color", "--force", "whole", &npz])),
            (vec![format!("{}/results.json", file("report"))], with("report", &["whole", "--out", &file("report")])),
        ]
    }

    /// Starts a program, waits for a random time and kills it; none if it was faster.
    fn kill(&mut self, what: &'static str, mut command: Command, most: f64) -> Result<Option<Output>> {
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
        std::thread::sleep(Duration::from_secs_f64(self.random.random_range(0.0..most)));
        let signal = if self.random.random_bool(0.6) { Signal::SIGKILL } else { Signal::SIGTERM };
        if ended(&mut child)?.is_none() {
            kill(Pid::from_raw(child.id() as i32), signal)?;
            // Who stops a job often does it twice.
            if signal == Signal::SIGTERM && self.random.random_bool(0.5) {
                let _ = kill(Pid::from_raw(child.id() as i32), signal);
            }
            *self.kills.entry(what).or_default() += 1;
        }
        let output = child.wait_with_output()?;
        if said_panic(&output) {
            self.lost.push(format!("{what}: {}", String::from_utf8_lossy(&output.stderr)));
        }
        Ok((!output.status.success()).then_some(output))
    }

    /// A training that is killed again and again ends with the bits of one that was not.
    fn kill_trainings(&mut self) -> Result<()> {
        let out = self.place.join("killed");
        let _ = fs::remove_dir_all(&out);
        let mut finished = false;
        for attempt in 0..60 {
            let command = self.train(&out);
            let patience = 0.5 + 0.2 * f64::from(attempt);
            match self.kill("training", command, patience)? {
                None => {
                    finished = true;
                    break;
                }
                // A signal's own exit, or the code for it.
                Some(output) if output.status.code().is_none_or(|code| code == 143) => {}
                Some(output) => {
                    self.lost.push(format!("training: {}", String::from_utf8_lossy(&output.stderr)));
                    return Ok(());
                }
            }
            if !self.goes_on() {
                break;
            }
        }
        // A busy machine may have killed it every time before its end.
        if !finished {
            done(&self.train(&out).output()?)?;
        }
        self.assert_same_run("training", &out)
    }

    fn assert_same_run(&mut self, what: &str, out: &Path) -> Result<()> {
        let whole = self.place.join("whole");
        if last_weights(out)? != last_weights(&whole)? {
            self.lost.push(format!("{what}: other weights"));
        }
        if records(out)? != records(&whole)? {
            self.lost.push(format!("{what}: another course"));
        }
        Ok(())
    }

    /// Files that are written are whole or not there, also after a kill.
    fn kill_writers(&mut self) -> Result<()> {
        for (place, (files, command)) in self.writers("torn").into_iter().enumerate() {
            let what = ["generate", "evaluate", "predict", "convert", "report"][place];
            self.kill(what, command, 1.5)?;
            let sound: Vec<_> = self.writers("sound").swap_remove(place).0;
            for (file, sound) in files.iter().zip(&sound) {
                let Ok(bytes) = fs::read(self.place.join(file)) else { continue };
                if bytes != fs::read(self.place.join(sound))? {
                    self.lost.push(format!("{what}: {file} is not what it should be"));
                }
            }
            if self.random.random_bool(0.3) {
                for file in &files {
                    let _ = fs::remove_file(self.place.join(file));
                }
            }
        }
        Ok(())
    }

    /// An import over a task that was edited leaves all of the old one or all of the new one, and what else lies there.
    fn kill_imports(&mut self) -> Result<()> {
        let video = project("tests/data/numbered.mp4");
        let import = |torture: &Self, out: &str, side: &str| {
            let mut command = torture.command("import");
            command.arg(&video).args(["--out", out, "--name", "scene", "--side", side, "--crop", "full", "--force"]);
            command.args(["--input-steps", "3", "--pred-steps", "3"]);
            command
        };
        let place = self.place.clone();
        let whole = |out: &str| TASK.map(|name| fs::read(place.join(out).join(name)).unwrap_or_default());
        done(&import(self, "task", "16").output()?)?;
        let text = fs::read_to_string(place.join("task/task.toml"))?;
        fs::write(place.join("task/task.toml"), text + "# my own equation\n")?;
        fs::write(place.join("task").join(NOTES), "dear diary")?;
        let begun = Instant::now();
        done(&import(self, "new", "32").output()?)?;
        let (most, old, new) = (begun.elapsed().as_secs_f64(), whole("task"), whole("new"));
        while self.kills.get(IMPORT).is_none_or(|kills| *kills < IMPORT_KILLS) && Instant::now() < self.until {
            let command = import(self, "task", "32");
            self.kill(IMPORT, command, most)?;
            let found = whole("task");
            if found != old && found != new {
                let missing = TASK.iter().zip(&found).filter(|(_, bytes)| bytes.is_empty()).map(|(name, _)| *name);
                self.lost.push(format!("{IMPORT}: of two tasks; missing: {:?}", missing.collect::<Vec<_>>()));
            }
            if fs::read(place.join("task").join(NOTES)).ok().as_deref() != Some(&b"dear diary"[..]) {
                self.lost.push(format!("{IMPORT}: {NOTES} is gone"));
            }
            // Back to the edited task.
            for (name, bytes) in TASK.iter().zip(&old) {
                fs::write(place.join("task").join(name), bytes)?;
            }
            fs::write(place.join("task").join(NOTES), "dear diary")?;
        }
        let left = fs::read_dir(&place)?.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        let left = left.filter(|name| name.starts_with("task.") && name.ends_with(".partial")).count();
        done(&import(self, "task", "32").output()?)?;
        let after = fs::read_dir(&place)?.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        if left > 1 || after.filter(|name| name.starts_with("task.")).count() > 0 {
            self.lost.push(format!("{IMPORT}: {left} half-written folders were left"));
        }
        Ok(())
    }

    /// A sweep that is killed, alone or with all its runs, goes on to the same bits.
    fn kill_sweep(&mut self) -> Result<()> {
        let out = self.place.join("sweep");
        let _ = fs::remove_dir_all(&out);
        for _ in 0..6 {
            if self.kill("sweep", self.sweep(), 3.0)?.is_none() {
                break;
            }
        }
        // Runs whose sweep was killed go on by themselves.
        for _ in 0..300 {
            if done(&self.sweep().output()?).is_ok() && out.join("spring_color/fast-tiny/seed=1/DONE").exists() {
                break;
            }
            std::thread::sleep(Duration::from_millis(200));
        }
        self.assert_same_run("sweep", &out.join("spring_color/fast-tiny/seed=0"))
    }

    /// Of two programs in one folder one is refused, and the other ends as if it were alone.
    fn two_at_once(&mut self) -> Result<()> {
        let out = self.place.join("shared");
        let start = |command: &mut Command| command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let children = [start(&mut self.train(&out))?, start(&mut self.train(&out))?];
        let outputs = children.map(Child::wait_with_output);
        let [first, second] = outputs;
        let ended = [first?.status.success(), second?.status.success()];
        if ended.iter().all(|ended| !ended) {
            self.lost.push("two at once: none went on".into());
        }
        self.assert_same_run("two at once", &out)
    }

    /// On a disk that fills up a run ends with one line, and goes on where there is room.
    fn small_disk(&mut self) -> Result<()> {
        let disk = self.place.join("disk");
        fs::create_dir(&disk)?;
        let mount =
            |options: &str| Command::new("mount").args(["-t", "tmpfs", "-o", options, "tmpfs"]).arg(&disk).status();
        if !mount(SMALL).is_ok_and(|status| status.success()) {
            self.notes.push("small disk, read-only disk: not tried, a file system cannot be mounted here".into());
            return Ok(());
        }
        let outcome = self.on_small_disk(&disk);
        let _ = Command::new("umount").arg(&disk).status();
        outcome
    }

    fn on_small_disk(&mut self, disk: &Path) -> Result<()> {
        let remount = |options: &str| {
            Command::new("mount").args(["-o", &format!("remount,{options}")]).arg(disk).status().map(drop)
        };
        let out = disk.join("run");
        let full = self.train(&out).output()?;
        self.assert_refused("full disk", &full, "No space left");
        remount(&format!("{LARGE},ro"))?;
        let refused = self.train(&out).output()?;
        self.assert_refused("read-only disk", &refused, "Read-only file system");
        remount(&format!("{LARGE},rw"))?;
        done(&self.train(&out).output()?)?;
        self.assert_same_run("full disk", &out)
    }

    fn assert_refused(&mut self, what: &str, output: &Output, words: &str) {
        let said = String::from_utf8_lossy(&output.stderr);
        let line = said.lines().rfind(|line| line.starts_with("error: ")).unwrap_or_default();
        if output.status.success() || !line.contains(words) {
            self.lost.push(format!("{what}: ended with {}: {said}", output.status));
        }
    }

    /// Files that are dated in the future, as after a clock that was set back, change nothing.
    fn future_dates(&mut self) -> Result<()> {
        let out = self.place.join("future");
        self.kill("training", self.train(&out), 4.0)?;
        let touch = "find \"$0\" -exec touch -d 2099-01-01 {} +";
        Command::new("sh").args(["-c", touch]).arg(&out).status()?;
        done(&self.train(&out).output()?)?;
        self.assert_same_run("clock", &out)
    }
}

fn ended(child: &mut Child) -> Result<Option<ExitStatus>> {
    child.try_wait().context("cannot wait")
}

fn said_panic(output: &Output) -> bool {
    let said = String::from_utf8_lossy(&output.stderr);
    said.contains("panicked") || said.contains("defect of the program")
}

/// metrics.jsonl without the times.
fn records(run: &Path) -> Result<Vec<Value>> {
    let text = fs::read_to_string(run.join("metrics.jsonl"))?;
    text.lines()
        .map(|line| {
            let mut record: Value = serde_json::from_str(line)?;
            record.as_object_mut().context("a line that is no object")?.remove("seconds");
            Ok(record)
        })
        .collect()
}
