//! What a person sees of a run: a bar on a terminal, now and then a plain line elsewhere.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};

/// `println!` for lines that nobody has to read: a reader that went away (`| head`) neither stops a program nor makes it
/// panic.
#[macro_export]
macro_rules! say {
    () => {
        $crate::say!("")
    };
    ($($line:tt)*) => {{
        let _ = std::io::Write::write_fmt(&mut std::io::stdout(), format_args!("{}\n", format_args!($($line)*)));
    }};
}

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
