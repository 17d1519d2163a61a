//! Child processes that outlive the server: each writes to a log that stays locked for as long as it runs.
//!
//! A server that is started anew finds them by these locks. A job has succeeded if its result file is there.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{Read, Seek, SeekFrom};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result, bail};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

const LOG: &str = "job.log";
const PROCESS: &str = "job.pid";
/// Marks a job that was asked to stop.
const STOPPED: &str = "job.stopped";
/// Bytes of the end of a log that are shown.
const TAIL: u64 = 4000;
/// Begins the line in which a program states why it failed.
const ERROR: &str = "error: ";

/// Attempts to lock a log, and the time between two.
const ATTEMPTS: usize = 20;
const PAUSE: Duration = Duration::from_millis(10);

/// A process by the folder it works for.
#[derive(Debug, Clone)]
pub struct ProjectJob {
    folder: PathBuf,
}

/// Whether a job is under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProcessStatus {
    /// It was never started.
    None,
    Running,
    Ended,
}

impl ProjectJob {
    pub fn new(folder: PathBuf) -> Self {
        ProjectJob { folder }
    }

    /// Starts a program. Its output goes to the log, which it holds locked.
    ///
    /// # Errors
    /// It runs already, the folder cannot be written, the program cannot be started.
    pub fn start(&self, program: &Path, arguments: &[String]) -> Result<()> {
        if self.progress() == ProcessStatus::Running {
            bail!("it is running already");
        }
        fs::create_dir_all(&self.folder)
            .with_context(|| format!("cannot make the folder {}", self.folder.display()))?;
        let path = self.folder.join(LOG);
        let log = OpenOptions::new().create(true).append(true).open(&path);
        let log = log.with_context(|| format!("cannot write {}", path.display()))?;
        lock(&log)?;
        log.set_len(0)?;
        let mark = self.folder.join(STOPPED);
        if mark.exists() {
            fs::remove_file(mark)?;
        }
        let mut command = Command::new(program);
        command.args(arguments).stdin(Stdio::null()).stderr(log.try_clone()?).stdout(log);
        // Ctrl-C in the terminal ends the server, not its jobs.
        let mut child =
            command.process_group(0).spawn().with_context(|| format!("cannot start {}", program.display()))?;
        // The command holds the log open, too.
        drop(command);
        fs::write(self.folder.join(PROCESS), child.id().to_string())?;
        // A process that nobody waits for stays in the system's table.
        std::thread::spawn(move || child.wait());
        Ok(())
    }

    pub fn progress(&self) -> ProcessStatus {
        let Ok(log) = File::open(self.folder.join(LOG)) else { return ProcessStatus::None };
        match log.try_lock_shared() {
            Err(TryLockError::WouldBlock) => ProcessStatus::Running,
            _ => ProcessStatus::Ended,
        }
    }

    /// Asks a running job to save what it has and to stop.
    ///
    /// # Errors
    /// The job does not run.
    pub fn stop(&self) -> Result<()> {
        if self.progress() != ProcessStatus::Running {
            bail!("it is not running");
        }
        let process: i32 = fs::read_to_string(self.folder.join(PROCESS))?.trim().parse()?;
        fs::write(self.folder.join(STOPPED), "")?;
        // Its whole group: a job may have started another program.
        kill(Pid::from_raw(-process), Signal::SIGINT).context("cannot be stopped")
    }

    /// Seconds since it was started.
    pub fn seconds(&self) -> Option<u64> {
        let started = fs::metadata(self.folder.join(PROCESS)).ok()?.modified().ok()?;
        Some(started.elapsed().unwrap_or_default().as_secs())
    }

    /// Whether it ended because it was asked to.
    pub fn was_stopped(&self) -> bool {
        self.folder.join(STOPPED).exists()
    }

    /// The end of the log.
    fn tail(&self) -> String {
        let read = || -> Result<String> {
            let mut log = File::open(self.folder.join(LOG))?;
            let length = log.metadata()?.len();
            log.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
            let mut bytes = Vec::new();
            log.take(TAIL).read_to_end(&mut bytes)?;
            Ok(String::from_utf8_lossy(&bytes).into_owned())
        };
        read().unwrap_or_default()
    }

    /// Why a job failed, as it stated.
    pub fn reason(&self) -> String {
        let tail = self.tail();
        // A job that fails because of a program that it started states so after that program.
        let stated = tail.lines().find_map(|line| line.strip_prefix(ERROR));
        stated.map_or_else(|| "the program ended unexpectedly; its log may help".into(), String::from)
    }
}

/// Locks a log that no job holds; a look at its progress may hold it for a moment.
fn lock(log: &File) -> Result<()> {
    for _ in 0..ATTEMPTS {
        match log.try_lock() {
            Ok(()) => return Ok(()),
            Err(TryLockError::WouldBlock) => std::thread::sleep(PAUSE),
            Err(TryLockError::Error(error)) => return Err(error).context("cannot lock the log"),
        }
    }
    bail!("it is running already")
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    /// A shell cannot trap a signal that was ignored when it began, as SIGINT is in the background of a script.
    fn shell(job: &ProjectJob, text: &str) -> Result<()> {
        let words = ["--default-signal=INT", "sh", "-c", text];
        job.start(Path::new("/usr/bin/env"), &words.map(Into::into))
    }

    fn await_that(happened: impl Fn() -> bool) {
        let begun = Instant::now();
        while !happened() {
            assert!(begun.elapsed() < Duration::from_secs(60), "it does not happen");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    fn wait(job: &ProjectJob) {
        await_that(|| job.progress() != ProcessStatus::Running);
    }

    #[test]
    fn a_job_is_found_again_by_its_folder_and_can_be_stopped() {
        let folder = tempfile::tempdir().unwrap();
        let job = ProjectJob::new(folder.path().join("job"));
        assert_eq!(job.progress(), ProcessStatus::None);
        shell(&job, "trap 'echo asked; exit 130' INT; echo begun; while :; do sleep 0.1; done").unwrap();
        // A signal before its trap would be lost.
        await_that(|| job.tail().contains("begun"));
        let again = ProjectJob::new(folder.path().join("job"));
        assert_eq!(again.progress(), ProcessStatus::Running);
        assert!(shell(&again, "true").is_err(), "two at a time");
        again.stop().unwrap();
        wait(&again);
        assert_eq!(again.progress(), ProcessStatus::Ended);
        assert!(again.was_stopped() && again.stop().is_err());
        shell(&job, "true").unwrap();
        assert!(!job.was_stopped());
    }

    #[test]
    fn a_job_that_fails_leaves_its_reason() {
        let folder = tempfile::tempdir().unwrap();
        let job = ProjectJob::new(folder.path().join("job"));
        shell(&job, "echo first; echo 'error: no such thing' >&2; exit 2").unwrap();
        wait(&job);
        assert_eq!(job.reason(), "no such thing");
        shell(&job, "echo 'error: cause'; echo 'error: consequence'; exit 1").unwrap();
        wait(&job);
        assert_eq!(job.reason(), "cause");
        shell(&job, "kill -9 $$").unwrap();
        wait(&job);
        assert!(job.reason().contains("unexpectedly"), "{}", job.reason());
    }
}
