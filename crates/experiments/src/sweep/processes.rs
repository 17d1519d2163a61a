//! The runs of a sweep as processes, a few at a time.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, ensure};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

use super::plan::{JobStage, SweepJob};
use paig::Error;
use paig::runs::folder::RunFolder;
use paig::support::atomic;
use paig::support::exit_codes::SIGNALLED;
use paig::support::run_names::{DONE, OUTPUT};
use paig::support::storage::{self, storage};

/// The program that trains.
const PROGRAM: &str = "paig";
/// How often the processes are looked at.
const TICK: Duration = Duration::from_millis(100);
/// Stands before the reason of a failure in what a run printed.
const NOTE: &str = "sweep: ";
/// Bytes in which a last line is looked for.
const TAIL: u64 = 600;
/// Bytes of what a run printed in which its error is looked for.
const MOST_PRINTED: u64 = 1 << 24;

/// The program that trains, by its command `train`: the one beside this program.
///
/// # Errors
/// It was not built.
pub fn training_program() -> Result<PathBuf> {
    let this = std::env::current_exe().context("cannot find this program's own place")?;
    let beside = this.with_file_name(PROGRAM);
    ensure!(beside.exists(), "{} is missing; build it with `make build`", beside.display());
    Ok(beside)
}

/// How a sweep ended.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct SweepSummary {
    pub finished: usize,
    /// Had finished before.
    pub skipped: usize,
    /// Asked to stop, or not begun because of that.
    pub stopped: usize,
    /// Left alone: another process runs them.
    pub in_use: usize,
    /// What each failed run printed, with the reason in its last lines.
    pub failed: Vec<PathBuf>,
}

/// What happens to the runs of a sweep, each by its folder.
#[derive(Debug)]
pub enum SweepEvent<'a> {
    Started(&'a Path),
    Resumed(&'a Path),
    /// It had finished before the sweep.
    Skipped(&'a Path),
    Finished(&'a Path, Duration),
    /// It was asked to stop, and saved.
    Stopped(&'a Path),
    /// Another process runs it, on this machine or another one.
    InUse(&'a Path),
    Failed(&'a Path, &'a anyhow::Error),
    /// Runs are under way; comes some times a second.
    Waiting,
}

/// What a process of the program does, in a folder of its own.
pub trait Work {
    fn folder(&self) -> &Path;

    /// How far it is.
    ///
    /// # Errors
    /// A folder that belongs to other work.
    fn stage(&self) -> Result<JobStage>;

    /// Words of the program's command line but for the folder, from a stage that is not [`JobStage::Finished`].
    fn words(&self, stage: JobStage) -> Vec<OsString>;
}

impl Work for SweepJob {
    fn folder(&self) -> &Path {
        &self.folder
    }

    fn stage(&self) -> Result<JobStage> {
        SweepJob::stage(self)
    }

    fn words(&self, stage: JobStage) -> Vec<OsString> {
        let train = [OsString::from("train")].into_iter();
        match stage {
            JobStage::CutOff => train.chain(["--resume".into()]).collect(),
            JobStage::New | JobStage::Finished => train.chain(self.options.words().iter().cloned()).collect(),
        }
    }
}

/// One run that is under way.
struct Running<'a, W> {
    job: &'a W,
    child: Child,
    since: Instant,
    /// Where what it prints begins in the output, bytes.
    from: u64,
}

/// Runs the jobs with the program, `at_once` at a time, in their order. One that fails stops no other one.
/// `stop` is asked some times a second; once it says so, no further run begins, and those under way are told to save and
/// stop (SIGINT). `observe` is told what happens.
///
/// # Errors
/// A process that cannot be waited for.
pub fn run<W: Work>(
    program: &Path,
    jobs: &[W],
    at_once: usize,
    stop: &dyn Fn() -> bool,
    observe: &mut dyn FnMut(SweepEvent),
) -> Result<SweepSummary, Error> {
    let mut summary = SweepSummary::default();
    let mut tell = |event: SweepEvent| {
        match event {
            SweepEvent::Skipped(_) => summary.skipped += 1,
            SweepEvent::Finished(..) => summary.finished += 1,
            SweepEvent::Stopped(_) => summary.stopped += 1,
            SweepEvent::InUse(_) => summary.in_use += 1,
            SweepEvent::Failed(folder, error) => summary.failed.push(note_failure(folder, error)),
            SweepEvent::Started(_) | SweepEvent::Resumed(_) | SweepEvent::Waiting => {}
        }
        observe(event);
    };
    let mut waiting = jobs.iter();
    let mut running: Vec<Running<W>> = Vec::new();
    let mut stopping = false;
    loop {
        while running.len() < at_once && !stop() {
            let Some(job) = waiting.next() else { break };
            running.extend(start(program, job, &mut tell));
        }
        if running.is_empty() {
            break;
        }
        std::thread::sleep(TICK);
        if stop() && !stopping {
            stopping = true;
            for one in &running {
                // One that has just ended by itself needs no signal.
                let _ = kill(Pid::from_raw(one.child.id() as i32), Signal::SIGINT);
            }
        }
        let mut still = Vec::new();
        for mut one in running {
            let folder = one.job.folder();
            match one.child.try_wait().context("cannot wait for a run").map_err(Error::of_work)? {
                None => still.push(one),
                Some(status) if status.success() => match atomic::write_file(&folder.join(DONE), |_| Ok(())) {
                    Ok(()) => tell(SweepEvent::Finished(folder, one.since.elapsed())),
                    Err(error) => tell(SweepEvent::Failed(folder, &error)),
                },
                Some(status) if stopping && was_signalled(status) => tell(SweepEvent::Stopped(folder)),
                // One that another process began in the same moment.
                Some(_) if RunFolder::is_in_use(folder) => tell(SweepEvent::InUse(folder)),
                Some(status) => {
                    let reason = reason(&folder.join(OUTPUT), one.from).unwrap_or_default();
                    let reason = if reason.is_empty() { "it printed nothing; is the disk full?" } else { &reason };
                    tell(SweepEvent::Failed(folder, &anyhow!("the run ended with {status}: {reason}")));
                }
            }
        }
        running = still;
        tell(SweepEvent::Waiting);
    }
    summary.stopped += waiting.count();
    Ok(summary)
}

/// Whether a signal ended a run: it saved and stopped, or was not yet so far that it could save. One that fails by
/// itself has another exit code.
fn was_signalled(status: ExitStatus) -> bool {
    status.signal().is_some() || status.code().is_some_and(|code| code > SIGNALLED)
}

/// Starts or continues a run; none if it has finished before or cannot be started.
fn start<'a, W: Work>(program: &Path, job: &'a W, tell: &mut dyn FnMut(SweepEvent)) -> Option<Running<'a, W>> {
    let folder = job.folder();
    if RunFolder::is_in_use(folder) {
        tell(SweepEvent::InUse(folder));
        return None;
    }
    let from = fs::metadata(folder.join(OUTPUT)).map_or(0, |output| output.len());
    let (event, child) = match job.stage().and_then(|stage| Ok((stage, spawn(program, job, stage)?))) {
        Ok((JobStage::New, child)) => (SweepEvent::Started(folder), child),
        Ok((JobStage::CutOff, child)) => (SweepEvent::Resumed(folder), child),
        Ok((JobStage::Finished, _)) => (SweepEvent::Skipped(folder), None),
        Err(error) => {
            tell(SweepEvent::Failed(folder, &error));
            return None;
        }
    };
    tell(event);
    child.map(|child| Running { job, child, since: Instant::now(), from })
}

/// The process of a run that is not finished.
fn spawn(program: &Path, job: &impl Work, stage: JobStage) -> Result<Option<Child>> {
    if stage == JobStage::Finished {
        return Ok(None);
    }
    let mut command = Command::new(program);
    command.args(job.words(stage));
    let output = open_output(job.folder())?;
    // A group of its own: Ctrl-C reaches a run through the sweep alone, and only once.
    command.arg("--out").arg(job.folder()).process_group(0);
    command.stdin(Stdio::null()).stdout(output.try_clone()?).stderr(output);
    command.spawn().map(Some).with_context(|| format!("cannot start {}", program.display()))
}

fn open_output(folder: &Path) -> Result<File> {
    storage().create_folder(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let path = folder.join(OUTPUT);
    ensure!(!atomic::is_stream(&path), "{} is a pipe or a device", path.display());
    OpenOptions::new().create(true).append(true).open(&path).with_context(|| format!("cannot open {}", path.display()))
}

/// Why a run failed: the last error in what it printed, else its last line.
fn reason(path: &Path, from: u64) -> std::io::Result<String> {
    let mut file = storage::open(path)?;
    file.seek(SeekFrom::Start(from))?;
    let mut printed = Vec::new();
    file.take(MOST_PRINTED).read_to_end(&mut printed)?;
    let printed = String::from_utf8_lossy(&printed);
    let lines = || printed.lines().filter(|line| !line.trim().is_empty());
    let error = lines().rfind(|line| line.starts_with("error: ")).or(lines().next_back());
    Ok(error.unwrap_or_default().trim().to_string())
}

/// Notes a failure in what the run printed; returns where that is.
pub fn note_failure(folder: &Path, error: &anyhow::Error) -> PathBuf {
    // Where even the folder cannot be written, the observer is the only one to know.
    if let Ok(mut output) = open_output(folder) {
        let _ = writeln!(output, "{NOTE}{error:#}");
    }
    folder.join(OUTPUT)
}

/// Why the last try of a run failed; none if it did not, is under way or was only stopped.
pub fn failure(folder: &Path) -> Option<String> {
    let last = last_line(&folder.join(OUTPUT)).ok()?;
    let noted = last.strip_prefix(NOTE).filter(|_| !RunFolder::is_in_use(folder));
    noted.map(String::from)
}

/// Takes back what was noted of a run that prints nothing of its own, before it is tried again.
///
/// # Errors
/// A file that cannot be removed.
pub fn forget_failure(folder: &Path) -> Result<()> {
    let path = folder.join(OUTPUT);
    storage().remove_if_there(&path).with_context(|| format!("cannot remove {}", path.display()))
}

/// The last line of a file that is not empty: what a run printed last.
///
/// # Errors
/// A file that cannot be read.
pub fn last_line(path: &Path) -> std::io::Result<String> {
    let mut file = storage::open(path)?;
    let length = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
    let mut tail = Vec::new();
    file.read_to_end(&mut tail)?;
    let tail = String::from_utf8_lossy(&tail);
    Ok(tail.lines().rfind(|line| !line.trim().is_empty()).unwrap_or_default().trim().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_fails_by_itself_was_not_stopped() {
        let exited = |code: i32| ExitStatus::from_raw(code << 8);
        let asked = [Signal::SIGINT, Signal::SIGTERM];
        assert!(asked.into_iter().all(|signal| was_signalled(exited(SIGNALLED + signal as i32))));
        assert!(was_signalled(ExitStatus::from_raw(Signal::SIGKILL as i32)));
        // Failed, refused, a panic.
        assert!(![1, 2, 101].into_iter().any(|code| was_signalled(exited(code))));
    }
}
