//! How a program ends: 0 done, 1 failed, 2 bad usage or input; 128 and the signal's number where it was asked to stop.
//!
//! Whatever goes wrong is one line on standard error that begins with `error: `. A panic, an exception of libtorch and too
//! little memory are no exception to that.

use std::any::Any;
use std::error::Error as StdError;
use std::io;
use std::panic::{self, AssertUnwindSafe, PanicHookInfo};
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Result, anyhow};
use nix::errno::Errno;
use paig::{Error, ErrorKind, Excerpt};

use super::interrupt;
use super::progress::{ensure_written, escaped, write_error};
use super::surroundings;
use paig_kernels::{flush_subnormals, vector_path};

/// Where the last panic came from.
static PANIC: Mutex<Option<String>> = Mutex::new(None);

/// Bad usage or input; a wrong option has the same.
const REFUSED: u8 = 2;
/// Digits of a number from which on an error shows only those at its ends.
const MOST_DIGITS: usize = 40;
const ENDS: usize = 3;
/// What libtorch says where it gets no memory.
const NO_MEMORY: [&str; 3] = ["can't allocate memory", "CUDA out of memory", "bad_alloc"];

/// Runs a program to its end and gives its exit code. An error is printed with its causes on one line; where it marks a
/// place in a text, with the lines that show it. Output that could not be written is an error, unless the terminal has
/// closed and the program was asked to stop.
pub fn exit_code(program: impl FnOnce() -> Result<ExitCode>) -> ExitCode {
    one_line_on_abort();
    match surroundings::check().and_then(|()| guarded(program)) {
        Ok(code) => match ensure_written() {
            Err(error) if !(interrupt::asked() && is_hung_up(&error)) => failed(error),
            _ => code,
        },
        Err(error) => failed(error),
    }
}

/// Does work of the library as all programs do it: subnormal numbers count as 0 in this thread from now on, and a panic is an
/// error.
///
/// # Errors
/// The work's own, a panic, a vector path that this processor lacks.
pub fn guarded<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
    flush_subnormals();
    panic::set_hook(Box::new(note));
    let checked = || vector_path().as_ref().map_err(anyhow::Error::msg).and_then(|_| work());
    panic::catch_unwind(AssertUnwindSafe(checked)).unwrap_or_else(|panic| Err(panicked(panic).into()))
}

/// Where memory runs out in Rust or an exception leaves a thread of libtorch, the process is aborted after a line that says
/// so. It leaves as a failure instead of dumping its memory.
fn one_line_on_abort() {
    // Where it cannot be had, an abort is an abort.
    let _ = signal_hook::flag::register_conditional_shutdown(
        signal_hook::consts::SIGABRT,
        1,
        Arc::new(AtomicBool::new(true)),
    );
}

fn failed(error: anyhow::Error) -> ExitCode {
    let text = without_long_numbers(&text(&error));
    let said = if error.chain().any(|cause| cause.is::<Excerpt>()) { text } else { one_line(&text) };
    write_error(&format!("error: {}", said.trim_end()));
    code_of(Error::from(error).kind())
}

/// The exit code of an error.
fn code_of(kind: ErrorKind) -> ExitCode {
    match kind {
        ErrorKind::Input | ErrorKind::Missing | ErrorKind::Corrupt | ErrorKind::Device => ExitCode::from(REFUSED),
        ErrorKind::Interrupted => interrupt::exit_code(),
        ErrorKind::Resources | ErrorKind::Failed | ErrorKind::Defect => ExitCode::FAILURE,
    }
}

/// Whether output was lost as it is on a terminal that has closed: no failure of a program that a signal told so.
fn is_hung_up(error: &anyhow::Error) -> bool {
    let mut of_system = error.chain().filter_map(|cause| cause.downcast_ref::<io::Error>());
    of_system.any(|error| error.raw_os_error() == Some(Errno::EIO as i32))
}

/// An error with its causes, each once: many an error repeats its cause in its own words. Control characters of names in it are
/// escaped.
pub fn text(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(escaped_cause) {
        if text.is_empty() {
            text = cause;
        } else if !text.contains(cause.trim()) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// A cause without control characters but for line breaks of its own.
fn escaped_cause(cause: &(dyn StdError + 'static)) -> String {
    let in_lines = cause.is::<Excerpt>() || cause.is::<toml::de::Error>() || cause.is::<tch::TchError>();
    let text = cause.to_string();
    if in_lines { text } else { escaped(&text).into_owned() }
}

/// A text whose numbers of very many digits, as a float of 1e300 has them, are cut in their middle.
fn without_long_numbers(text: &str) -> String {
    let (mut short, mut rest) = (String::new(), text);
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        let digits = rest[start..].find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len() - start);
        let (before, number) = (&rest[..start], &rest[start..start + digits]);
        short += before;
        if digits > MOST_DIGITS {
            short += &format!("{}..{} ({digits} digits)", &number[..ENDS], &number[digits - ENDS..]);
        } else {
            short += number;
        }
        rest = &rest[start + digits..];
    }
    short + rest
}

fn one_line(text: &str) -> String {
    text.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}

/// Keeps where a panic came from; what is caught within the program says nothing.
fn note(info: &PanicHookInfo) {
    let place = info.location().map(ToString::to_string).unwrap_or_default();
    *PANIC.lock().unwrap_or_else(PoisonError::into_inner) = Some(place);
}

fn panicked(panic: Box<dyn Any + Send>) -> Error {
    // An error where there is no other way to hand it on, such as a disk that fails within a step.
    let panic = match panic.downcast::<anyhow::Error>() {
        Ok(error) => return Error::of_work(*error),
        Err(panic) => panic,
    };
    let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
    let text = text.unwrap_or("an unknown failure");
    if NO_MEMORY.iter().any(|words| text.contains(words)) {
        let advice = "out of memory; take smaller batches or fewer clips, or raise the limit (ulimit -v)";
        return Error::new(ErrorKind::Resources, anyhow!(advice));
    }
    // The lines after libtorch's first are a trace of its own calls.
    let what = text.split("Exception raised from").next().unwrap_or(text);
    let place = PANIC.lock().unwrap_or_else(PoisonError::into_inner).take().unwrap_or_default();
    let defect = anyhow!("{} (at {place}; this is a defect of the program, please report it)", one_line(what));
    Error::new(ErrorKind::Defect, defect)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_said_once() {
        let error =
            anyhow::anyhow!("No space left (os error 28)").context("cannot write a: No space left (os error 28)");
        assert_eq!(text(&error.context("the run ended")), "the run ended: cannot write a: No space left (os error 28)");
    }

    /// A message's own line breaks are joined or stay; those of a name are shown.
    #[test]
    fn line_breaks_in_names_are_escaped() {
        let named = |error: anyhow::Error| text(&error.context("cannot read a\nerror: b"));
        let table = toml::from_str::<toml::Table>("words").unwrap_err();
        assert!(
            one_line(&named(table.into()))
                .starts_with("cannot read a\\nerror: b: TOML parse error at line 1, column 6 | 1")
        );
        let marked = named(Excerpt("column 1: wrong\n  x\n  ^".into()).into());
        assert_eq!(marked, "cannot read a\\nerror: b: column 1: wrong\n  x\n  ^");
        assert_eq!(named(anyhow!("no\tfile")), "cannot read a\\nerror: b: no\\tfile");
    }

    #[test]
    fn numbers_of_hundreds_of_digits_are_cut() {
        let said = without_long_numbers(&format!("radius = -{} px: at most 16.5", 1e300));
        assert!(said.starts_with("radius = -100..") && said.ends_with("(301 digits) px: at most 16.5"), "{said}");
        assert!(said.len() < 60, "{said}");
        assert_eq!(without_long_numbers("18446744073709551615 and a3"), "18446744073709551615 and a3");
    }

    #[test]
    fn a_terminal_that_closed_is_no_full_disk() {
        let unwritten =
            |code: Errno| anyhow::Error::from(io::Error::from_raw_os_error(code as i32)).context("cannot write");
        let (closed, full) = (unwritten(Errno::EIO), unwritten(Errno::ENOSPC));
        assert!(is_hung_up(&closed) && !is_hung_up(&full));
        assert_eq!([closed, full].map(|error| Error::from(error).kind()), [ErrorKind::Input, ErrorKind::Resources]);
    }

    #[test]
    fn exceptions_of_libtorch_lose_their_trace() {
        let words = "Torch(\"[enforce fail at alloc_cpu.cpp:118] err == 0. DefaultCPUAllocator: can't allocate memory: you \
                     tried to allocate 7 bytes.\\nException raised from ..\")";
        let panicked = |text: &str| panicked(Box::new(text.to_string()));
        let full = panicked(words);
        assert!(full.to_string().starts_with("out of memory") && full.kind() == ErrorKind::Resources);
        let said = panicked("shapes differ\nException raised from f at g.cpp:1");
        assert_eq!(said.kind(), ErrorKind::Defect);
        let said = said.to_string();
        assert!(said.starts_with("shapes differ (at ") && !said.contains("g.cpp"), "{said}");
    }
}
