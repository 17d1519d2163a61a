//! What a person sees of a sweep: bars on a terminal, plain lines elsewhere.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use paig_experiments::sweep::{OUTPUT, SweepEvent, SweepSummary, last_line};
use paig_terminal::progress::escaped;
use paig_terminal::{interrupt, say};

/// How often the last lines of the runs are read.
const REFRESH: Duration = Duration::from_secs(1);

/// A bar for all runs and a line for each that is under way.
#[derive(Debug)]
pub struct SweepDisplay {
    terminal: bool,
    bars: MultiProgress,
    all: ProgressBar,
    running: Vec<(PathBuf, ProgressBar)>,
    refreshed: Instant,
}

impl SweepDisplay {
    /// For a sweep of so many runs.
    pub fn new(runs: usize) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bars = MultiProgress::new();
        let all = bars.add(if terminal { ProgressBar::new(runs as u64) } else { ProgressBar::hidden() });
        let style = ProgressStyle::with_template("    sweep {bar:30} {pos}/{len} runs {elapsed}");
        all.set_style(style.expect("the template is sound"));
        SweepDisplay { terminal, bars, all, running: Vec::new(), refreshed: Instant::now() }
    }

    /// Shows what happened.
    pub fn show(&mut self, event: &SweepEvent) {
        match event {
            SweepEvent::Started(folder) => self.started(folder, "started"),
            SweepEvent::Resumed(folder) => self.started(folder, "resumed"),
            SweepEvent::Skipped(folder) => self.ended(folder, "finished before"),
            SweepEvent::Finished(folder, after) => {
                self.ended(folder, &format!("finished after {:.0} s", after.as_secs_f64()));
            }
            SweepEvent::Stopped(folder) => self.ended(folder, "stopped"),
            SweepEvent::InUse(folder) => self.ended(folder, "under way in another process, left to it"),
            SweepEvent::Failed(folder, error) => self.ended(folder, &format!("FAILED: {error:#}")),
            SweepEvent::Waiting => self.refresh(),
        }
    }

    /// Takes the bars off the screen.
    pub fn close(&self) {
        self.all.finish_and_clear();
    }

    fn started(&mut self, folder: &Path, word: &str) {
        if self.terminal {
            let bar = self.bars.add(ProgressBar::new_spinner());
            let style = ProgressStyle::with_template("{prefix} {elapsed} {wide_msg}");
            bar.set_style(style.expect("the template is sound"));
            bar.set_prefix(escaped(&folder.display().to_string()).into_owned());
            self.running.push((folder.into(), bar));
        }
        self.line(&format!("{}: {word}", folder.display()));
    }

    fn ended(&mut self, folder: &Path, how: &str) {
        for (_, bar) in self.running.extract_if(.., |(path, _)| path == folder) {
            bar.finish_and_clear();
        }
        self.all.inc(1);
        self.line(&format!("{}: {how}", folder.display()));
    }

    /// Shows the last line that each run printed.
    fn refresh(&mut self) {
        if !self.terminal || self.refreshed.elapsed() < REFRESH {
            return;
        }
        self.refreshed = Instant::now();
        self.all.tick();
        for (folder, bar) in &self.running {
            let last = last_line(&folder.join(OUTPUT)).unwrap_or_default();
            bar.set_message(escaped(&last).into_owned());
        }
    }

    fn line(&self, text: &str) {
        if self.terminal {
            // Above the bars; a terminal that has gone away is no reason to stop the runs.
            let _ = self.bars.println(escaped(text));
        } else {
            say!("{text}");
        }
    }
}

/// Prints how the sweep ended; returns the exit code.
pub fn conclude(summary: &SweepSummary) -> ExitCode {
    let SweepSummary { finished, skipped, stopped, in_use, failed } = summary;
    let in_use = if *in_use > 0 { format!(", {in_use} under way elsewhere") } else { String::new() };
    say!("{finished} finished, {skipped} skipped, {stopped} stopped, {} failed{in_use}", failed.len());
    for output in failed {
        say!("failed: see {}", output.display());
    }
    match (failed.is_empty(), stopped) {
        (false, _) => ExitCode::FAILURE,
        (true, 0) => ExitCode::SUCCESS,
        (true, _) => interrupt::exit_code(),
    }
}
