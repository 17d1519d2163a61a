//! What a person sees of a sweep: bars on a terminal, plain lines elsewhere.

use std::fs::File;
use std::io::{IsTerminal, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::say;
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use super::OUTPUT;

/// How often the last lines of the runs are read.
const REFRESH: Duration = Duration::from_secs(1);
/// Bytes in which a last line is looked for.
const TAIL: u64 = 600;

/// A bar for all runs and a line for each that is under way.
pub(super) struct Display {
    terminal: bool,
    bars: MultiProgress,
    all: ProgressBar,
    running: Vec<(PathBuf, ProgressBar)>,
    refreshed: Instant,
}

impl Display {
    pub(super) fn new(runs: usize) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bars = MultiProgress::new();
        let all = bars.add(if terminal { ProgressBar::new(runs as u64) } else { ProgressBar::hidden() });
        let style = ProgressStyle::with_template("    sweep {bar:30} {pos}/{len} runs {elapsed}");
        all.set_style(style.expect("the template is sound"));
        Display { terminal, bars, all, running: Vec::new(), refreshed: Instant::now() }
    }

    pub(super) fn started(&mut self, folder: &Path, word: &str) {
        if self.terminal {
            let bar = self.bars.add(ProgressBar::new_spinner());
            let style = ProgressStyle::with_template("{prefix} {elapsed} {wide_msg}");
            bar.set_style(style.expect("the template is sound"));
            bar.set_prefix(folder.display().to_string());
            self.running.push((folder.into(), bar));
        }
        self.line(&format!("{}: {word}", folder.display()));
    }

    pub(super) fn ended(&mut self, folder: &Path, how: &str) {
        for (_, bar) in self.running.extract_if(.., |(path, _)| path == folder) {
            bar.finish_and_clear();
        }
        self.all.inc(1);
        self.line(&format!("{}: {how}", folder.display()));
    }

    /// Shows the last line that each run printed.
    pub(super) fn refresh(&mut self) {
        if !self.terminal || self.refreshed.elapsed() < REFRESH {
            return;
        }
        self.refreshed = Instant::now();
        self.all.tick();
        for (folder, bar) in &self.running {
            bar.set_message(last_line(&folder.join(OUTPUT)).unwrap_or_default());
        }
    }

    pub(super) fn close(&self) {
        self.all.finish_and_clear();
    }

    fn line(&self, text: &str) {
        if self.terminal {
            // Above the bars; a terminal that has gone away is no reason to stop the runs.
            let _ = self.bars.println(text);
        } else {
            say!("{text}");
        }
    }
}

/// The last line of a file that is not empty.
pub(super) fn last_line(path: &Path) -> std::io::Result<String> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
    let mut tail = Vec::new();
    file.read_to_end(&mut tail)?;
    let tail = String::from_utf8_lossy(&tail);
    Ok(tail.lines().rfind(|line| !line.trim().is_empty()).unwrap_or_default().trim().to_string())
}
