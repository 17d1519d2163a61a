//! Lines and progress bars: a bar on a terminal, now and then a plain line elsewhere.

use std::borrow::Cow;
use std::fmt::Arguments;
use std::io::{ErrorKind, IsTerminal, Write};
use std::sync::Mutex;
use std::time::Duration;

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};

/// Why the first line that could not be written was not, unless its reader had gone away.
static UNWRITTEN: Mutex<Option<std::io::Error>> = Mutex::new(None);

/// `println!` of one line that does not panic: a reader that went away (`| head`) is no error, and a full disk stops no
/// training; the program says it at its end (see [`ensure_written`]). Line breaks in the line are those of a name: they are
/// escaped.
#[macro_export]
macro_rules! say {
    () => {
        $crate::say!("")
    };
    ($($line:tt)*) => {{
        $crate::progress::write_line(format_args!($($line)*));
    }};
}

/// What [`say!`] does.
pub fn write_line(line: Arguments) {
    write(&format!("{}\n", escaped(&line.to_string())));
}

/// The same of a text with line breaks of its own, the last one included.
pub fn write_text(text: &str) {
    write(&escaped_in_lines(text));
}

fn write(text: &str) {
    if let Err(error) = std::io::stdout().write_all(text.as_bytes())
        && error.kind() != ErrorKind::BrokenPipe
    {
        UNWRITTEN.lock().unwrap_or_else(std::sync::PoisonError::into_inner).get_or_insert(error);
    }
}

/// `eprintln!` that does not panic: where nobody reads it, as on a terminal that has closed, it is lost, no more. Line breaks
/// in the text are its own: those of names in it are escaped before.
pub fn write_error(text: &str) {
    let _ = writeln!(std::io::stderr(), "{}", escaped_in_lines(text));
}

/// A line without the characters by which a file's name could steer a terminal or begin a line of its own.
pub fn escaped(line: &str) -> Cow<'_, str> {
    without(line, steers)
}

/// A text of several lines without the characters that steer a terminal; its line breaks and tabs stay.
fn escaped_in_lines(text: &str) -> Cow<'_, str> {
    without(text, |c| steers(c) && !['\n', '\t'].contains(&c))
}

/// Control characters, line and paragraph separators, and what turns the direction of the text that follows.
fn steers(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn without(text: &str, steers: impl Fn(char) -> bool + Copy) -> Cow<'_, str> {
    if !text.contains(steers) {
        return Cow::Borrowed(text);
    }
    let one = |c: char| if steers(c) { c.escape_default().to_string() } else { c.to_string() };
    Cow::Owned(text.chars().map(one).collect())
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
        bar.set_prefix(escaped(name).into_owned());
        bar.set_position(done);
        PhaseProgress { bar, terminal }
    }

    /// Something that takes a while, nobody knows how long.
    pub fn busy(name: &str) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = if terminal { ProgressBar::new_spinner() } else { ProgressBar::hidden() };
        bar.set_style(ProgressStyle::with_template("{prefix:>9} {spinner} {elapsed}").expect("the template is sound"));
        bar.set_prefix(escaped(name).into_owned());
        bar.enable_steady_tick(TICK);
        PhaseProgress { bar, terminal }
    }

    /// One step further.
    pub fn step(&self, message: impl FnOnce() -> String) {
        if self.terminal {
            self.bar.set_message(escaped(&message()).into_owned());
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
    use super::*;

    #[test]
    fn control_characters_are_shown_and_not_obeyed() {
        for (text, shown) in [
            ("a\u{1b}[31mb\r\n\tc\u{9b}\0", "a\\u{1b}[31mb\\r\\n\\tc\\u{9b}\\u{0}"),
            ("\u{202e}4pm\u{2066}.\u{2069}\u{200f}\u{61c}", "\\u{202e}4pm\\u{2066}.\\u{2069}\\u{200f}\\u{61c}"),
            ("a\u{2028}error: b\u{85}", "a\\u{2028}error: b\\u{85}"),
        ] {
            assert_eq!(escaped(text), shown);
        }
        assert_eq!(escaped_in_lines("a\n\tb\r\u{7f}"), "a\n\tb\\r\\u{7f}");
        assert!(matches!(escaped("Größe 1 µm"), Cow::Borrowed(_)));
    }
}
