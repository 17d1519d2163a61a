//! What a person sees of a run: a bar on a terminal, now and then a plain line elsewhere.

use std::fmt::Arguments;
use std::io::{ErrorKind, IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use indicatif::{HumanDuration, ProgressBar, ProgressStyle};

use crate::training::config::Config;
use crate::training::observer::{Event, Observer};
use crate::training::recorder;

/// Why the first line that could not be written was not, unless its reader had gone away.
static UNWRITTEN: Mutex<Option<std::io::Error>> = Mutex::new(None);

/// `println!` that does not panic: a reader that went away (`| head`) is no error, and a full disk stops no training; the
/// program says it at its end (see [`ensure_written`]).
#[macro_export]
macro_rules! say {
    () => {
        $crate::say!("")
    };
    ($($line:tt)*) => {{
        $crate::cli::progress::write_line(format_args!("{}\n", format_args!($($line)*)));
    }};
}

/// What [`say!`] does.
pub fn write_line(line: Arguments) {
    if let Err(error) = std::io::stdout().write_fmt(line)
        && error.kind() != ErrorKind::BrokenPipe
    {
        UNWRITTEN.lock().unwrap_or_else(std::sync::PoisonError::into_inner).get_or_insert(error);
    }
}

/// `eprintln!` that does not panic: where nobody reads it, as on a terminal that has closed, it is lost, no more.
pub fn write_error_line(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

/// # Errors
/// A line that could not be written to standard output, to a full disk for example.
pub fn ensure_written() -> Result<()> {
    let unwritten = UNWRITTEN.lock().unwrap_or_else(std::sync::PoisonError::into_inner).take();
    unwritten.map_or(Ok(()), Err).context("cannot write to standard output; what is there is not complete")
}

/// From one picture of what turns while one waits to the next.
const TICK: Duration = Duration::from_millis(120);

/// Progress of one phase.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
    terminal: bool,
}

impl Progress {
    /// A bar of `steps` steps, standing at `done`.
    pub fn new(name: &str, steps: u64, done: u64) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = if terminal { ProgressBar::new(steps) } else { ProgressBar::hidden() };
        let style = ProgressStyle::with_template("{prefix:>9} {bar:30} {pos}/{len} {elapsed} (left {eta}) {msg}")
            .expect("the template is sound");
        bar.set_style(style);
        bar.set_prefix(name.to_string());
        bar.set_position(done);
        Progress { bar, terminal }
    }

    /// Something that takes a while, nobody knows how long.
    pub fn busy(name: &str) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = if terminal { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
        bar.set_style(ProgressStyle::with_template("{prefix:>9} {spinner} {elapsed}").expect("the template is sound"));
        bar.set_prefix(name.to_string());
        bar.enable_steady_tick(TICK);
        Progress { bar, terminal }
    }

    /// One step further.
    pub fn step(&self, message: impl FnOnce() -> String) {
        if self.terminal {
            self.bar.set_message(message());
            self.bar.inc(1);
        }
    }

    /// A line that stays: above the bar on a terminal, on standard output elsewhere.
    pub fn line(&self, text: &str) {
        if self.terminal { self.bar.println(text) } else { say!("{text}") }
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// Shows a training: a bar for each phase, and a line for each record.
#[derive(Debug)]
pub struct Screen {
    progress: Option<Progress>,
    /// The phases to come, with the frames that they take at most.
    later: Vec<(&'static str, f64)>,
    pace: Option<Pace>,
}

/// How fast a phase goes.
#[derive(Debug)]
struct Pace {
    since: Instant,
    steps: u64,
    left: u64,
    frames_per_step: f64,
}

impl Pace {
    fn step(&mut self) {
        self.steps += 1;
        self.left = self.left.saturating_sub(1);
    }

    /// Seconds to the end of the run if every phase takes all its steps, `later` frames after this phase.
    fn seconds_left(&self, later: f64) -> f64 {
        let seconds_per_step = self.since.elapsed().as_secs_f64() / self.steps as f64;
        seconds_per_step * (self.left as f64 + later / self.frames_per_step)
    }
}

impl Screen {
    /// Shows a training with this config.
    pub fn new(config: &Config) -> Self {
        let phases = config.phases();
        let later = phases.iter().map(|phase| (phase.name(), phase.frames(&config.task.system))).collect();
        Screen { progress: None, later, pace: None }
    }

    /// A line that stays.
    fn line(&self, text: &str) {
        match &self.progress {
            Some(progress) => progress.line(text),
            None => say!("{text}"),
        }
    }

    fn begin(&mut self, phase: &str, done: u64, of: u64) {
        self.progress = Some(if of > 0 { Progress::new(phase, of, done) } else { Progress::busy(phase) });
        let place = self.later.iter().position(|(name, _)| *name == phase);
        let here = place.map(|place| self.later.drain(..=place).next_back().map_or(0.0, |(_, frames)| frames));
        self.pace = here.filter(|frames| *frames > 0.0 && of > 0).map(|frames| Pace {
            since: Instant::now(),
            steps: 0,
            left: of.saturating_sub(done),
            frames_per_step: frames / of as f64,
        });
    }

    /// `run: at most 2 minutes, `.
    fn left(&self) -> String {
        let later = self.later.iter().map(|(_, frames)| frames).sum();
        let Some(pace) = &self.pace else { return String::new() };
        let left = Duration::from_secs_f64(pace.seconds_left(later).min(1e9));
        format!("run: at most {}, ", HumanDuration(left))
    }
}

impl Observer for Screen {
    fn observe(&mut self, event: &Event) -> Result<()> {
        match event {
            Event::Resumed { steps, checkpoint, damaged } => {
                damaged.iter().for_each(|what| say!("warning: {what}; the checkpoint before it is taken"));
                say!("resuming after step {steps} ({checkpoint})");
            }
            Event::PhaseBegins { phase, done, of } => self.begin(phase, *done, *of),
            Event::Step { loss, model } => {
                self.pace.iter_mut().for_each(Pace::step);
                let left = self.left();
                if let Some(progress) = &self.progress {
                    let values =
                        || model.parameter_values().into_iter().map(|(name, value)| format!("{name}={value:.3}"));
                    progress.step(|| format!("{left}loss {loss:.3} {}", values().collect::<Vec<_>>().join(" ")));
                }
            }
            Event::Recorded(record) => {
                if let Some(line) = recorder::line(record) {
                    self.line(&format!("{:>9} {line} ({:.0} s)", record.phase, record.seconds.unwrap_or_default()));
                }
            }
            Event::Note(line) => self.line(line),
            Event::Checkpoint { .. } => {}
            Event::PhaseEnds { .. } => {
                if let Some(progress) = self.progress.take() {
                    progress.finish();
                }
            }
        }
        Ok(())
    }
}
