//! Lines and progress bars: a bar on a terminal, now and then a plain line elsewhere.

use std::borrow::Cow;
use std::fmt::Arguments;
use std::io::{ErrorKind, IsTerminal, Write};
use std::ops::RangeInclusive;
use std::sync::Mutex;
use std::time::Duration;

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};

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
        $crate::progress::write_line(format_args!("{}\n", format_args!($($line)*)));
    }};
}

/// What [`say!`] does.
pub fn write_line(line: Arguments) {
    if let Err(error) = std::io::stdout().write_all(escaped(&line.to_string()).as_bytes())
        && error.kind() != ErrorKind::BrokenPipe
    {
        UNWRITTEN.lock().unwrap_or_else(std::sync::PoisonError::into_inner).get_or_insert(error);
    }
}

/// `eprintln!` that does not panic: where nobody reads it, as on a terminal that has closed, it is lost, no more.
pub fn write_error_line(line: &str) {
    let _ = writeln!(std::io::stderr(), "{}", escaped(line));
}

/// A text without the control characters by which a file's name could steer a terminal; line breaks and tabs stay.
pub fn escaped(text: &str) -> Cow<'_, str> {
    let steers = |c: char| (c.is_control() && !['\n', '\t'].contains(&c)) || TURNS.contains(&c);
    if !text.contains(steers) {
        return Cow::Borrowed(text);
    }
    let one = |c: char| if steers(c) { c.escape_unicode().to_string() } else { c.to_string() };
    Cow::Owned(text.chars().map(one).collect())
}

/// Characters that turn the direction of what follows.
const TURNS: RangeInclusive<char> = '\u{202a}'..='\u{202e}';

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
pub struct PhaseProgress {
    bar: ProgressBar,
    terminal: bool,
}

impl PhaseProgress {
    /// A bar of `steps` steps, standing at `done`.
    pub fn new(name: &str, steps: u64, done: u64) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = if terminal { ProgressBar::new(steps) } else { ProgressBar::hidden() };
        let style = ProgressStyle::with_template("{prefix:>9} {bar:30} {pos}/{len} {elapsed} (left {eta}) {msg}")
            .expect("the template is sound");
        bar.set_style(style);
        bar.set_prefix(name.to_string());
        bar.set_position(done);
        PhaseProgress { bar, terminal }
    }

    /// Something that takes a while, nobody knows how long.
    pub fn busy(name: &str) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = if terminal { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
        bar.set_style(ProgressStyle::with_template("{prefix:>9} {spinner} {elapsed}").expect("the template is sound"));
        bar.set_prefix(name.to_string());
        bar.enable_steady_tick(TICK);
        PhaseProgress { bar, terminal }
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
        if self.terminal { self.bar.println(escaped(text)) } else { say!("{text}") }
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::escaped;

    #[test]
    fn control_characters_are_shown_and_not_obeyed() {
        assert_eq!(escaped("a\u{1b}[31mb\r\n\tc\u{9b}\u{202e}d"), "a\\u{1b}[31mb\\u{d}\n\tc\\u{9b}\\u{202e}d");
        assert!(matches!(escaped("Größe 1 µm"), std::borrow::Cow::Borrowed(_)));
    }
}
