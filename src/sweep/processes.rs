//! The runs of a sweep as processes, a few at a time.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use super::display::{Display, last_line};
use super::{DONE, Job, OUTPUT, Stage};
use crate::cli::interrupt;
use crate::support::atomic;

/// How often the processes are looked at.
const TICK: Duration = Duration::from_millis(100);

/// How a sweep ended.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Summary {
    pub finished: usize,
    /// Had finished before.
    pub skipped: usize,
    /// Asked to stop, or not begun because of that.
    pub stopped: usize,
    /// What each failed run printed, with the reason in its last lines.
    pub failed: Vec<PathBuf>,
}

/// One run that is under way.
struct Running<'a> {
    job: &'a Job,
    child: Child,
    since: Instant,
}

/// Runs the jobs with the training program, `at_once` at a time, in their order. One that fails stops no other one.
/// SIGINT and SIGTERM are handed on once: the runs save and stop.
///
/// # Errors
/// Signals that cannot be caught.
pub fn run(program: &Path, jobs: &[Job], at_once: usize) -> Result<Summary> {
    interrupt::catch()?;
    let mut display = Display::new(jobs.len());
    let mut summary = Summary::default();
    let mut waiting = jobs.iter();
    let mut running: Vec<Running> = Vec::new();
    let mut told = false;
    loop {
        while running.len() < at_once && !interrupt::asked() {
            let Some(job) = waiting.next() else { break };
            match start(program, job) {
                Ok(Some((child, word))) => {
                    display.started(&job.folder, word);
                    running.push(Running { job, child, since: Instant::now() });
                }
                Ok(None) => {
                    summary.skipped += 1;
                    display.ended(&job.folder, "finished before");
                }
                Err(error) => summary.failed.push(fail(job, &error, &mut display)),
            }
        }
        if running.is_empty() {
            break;
        }
        std::thread::sleep(TICK);
        if interrupt::asked() && !told {
            told = true;
            for one in &running {
                // One that has just ended by itself needs no signal.
                let _ = kill(Pid::from_raw(one.child.id() as i32), Signal::SIGINT);
            }
        }
        let mut still = Vec::new();
        for mut one in running {
            let Some(status) = one.child.try_wait().context("cannot wait for a run")? else {
                still.push(one);
                continue;
            };
            let outcome = match status.code() {
                Some(0) => mark(one.job).map(|()| true),
                _ if told => Ok(false),
                // Its last line says why.
                _ => Err(anyhow::anyhow!(
                    "the run ended with {status}: {}",
                    last_line(&one.job.folder.join(OUTPUT)).unwrap_or_default()
                )),
            };
            match outcome {
                Ok(true) => {
                    summary.finished += 1;
                    display
                        .ended(&one.job.folder, &format!("finished after {:.0} s", one.since.elapsed().as_secs_f64()));
                }
                Ok(false) => {
                    summary.stopped += 1;
                    display.ended(&one.job.folder, "stopped");
                }
                Err(error) => summary.failed.push(fail(one.job, &error, &mut display)),
            }
        }
        running = still;
        display.refresh();
    }
    summary.stopped += waiting.count();
    display.close();
    Ok(summary)
}

/// Starts or continues a run; none if it has finished before.
fn start(program: &Path, job: &Job) -> Result<Option<(Child, &'static str)>> {
    let stage = job.stage()?;
    let mut command = Command::new(program);
    let word = match stage {
        Stage::Finished => return Ok(None),
        Stage::New => {
            command.args(&job.arguments);
            "started"
        }
        Stage::CutOff => {
            command.arg("--resume");
            "resumed"
        }
    };
    let output = open_output(job)?;
    // A group of its own: Ctrl-C reaches a run through the sweep alone, and only once.
    command.arg("--out").arg(&job.folder).process_group(0);
    command.stdin(Stdio::null()).stdout(output.try_clone()?).stderr(output);
    let child = command.spawn().with_context(|| format!("cannot start {}", program.display()))?;
    Ok(Some((child, word)))
}

fn open_output(job: &Job) -> Result<File> {
    fs::create_dir_all(&job.folder).with_context(|| format!("cannot create {}", job.folder.display()))?;
    let path = job.folder.join(OUTPUT);
    OpenOptions::new().create(true).append(true).open(&path).with_context(|| format!("cannot open {}", path.display()))
}

/// Marks a run as finished.
fn mark(job: &Job) -> Result<()> {
    atomic::write_file(&job.folder.join(DONE), |_| Ok(()))
}

/// Notes a failure in the run's output and on the display; returns where the output is.
fn fail(job: &Job, error: &anyhow::Error, display: &mut Display) -> PathBuf {
    let path = job.folder.join(OUTPUT);
    // Where even the folder cannot be written, the display is the only place left.
    if let Ok(mut output) = open_output(job) {
        let _ = writeln!(output, "sweep: {error:#}");
    }
    display.ended(&job.folder, &format!("FAILED: {error:#}"));
    path
}
