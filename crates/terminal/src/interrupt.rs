//! Signals that ask a program to stop: a run finishes its step, saves and stops.
//!
//! SIGINT (Ctrl-C), SIGTERM (`kill`, `scancel`, a time limit), SIGHUP (a terminal that closes) and SIGUSR1 (which engines
//! send some time before a limit).

use std::process::ExitCode;
use std::sync::Once;
use std::sync::atomic::{AtomicI32, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1};
use signal_hook::iterator::Signals;

use super::progress::write_error;
use paig::support::exit_codes::SIGNALLED;

/// The first signal that came; 0 before.
static ASKED: AtomicI32 = AtomicI32::new(0);
static INSTALL: Once = Once::new();

/// Signals within this time of the first are one and the same request: whoever stops all processes of a job reaches a run
/// more than once, by itself and through `sweep`.
const ONE_REQUEST: Duration = Duration::from_secs(5);

/// Catches the signals from now on; one that comes more than five seconds after the first ends the process at once.
///
/// # Errors
/// A handler that cannot be installed.
pub fn catch() -> Result<()> {
    let mut outcome = Ok(());
    INSTALL.call_once(|| {
        outcome =
            Signals::new([SIGINT, SIGTERM, SIGHUP, SIGUSR1]).context("cannot catch signals").map(|mut signals| {
                std::thread::spawn(move || watch(&mut signals));
            });
    });
    outcome
}

fn watch(signals: &mut Signals) {
    let mut first: Option<Instant> = None;
    for signal in signals.forever() {
        match first {
            None => {
                first = Some(Instant::now());
                ASKED.store(signal, Ordering::SeqCst);
                let seconds = ONE_REQUEST.as_secs();
                write_error(&format!("stopping after this step; once more after {seconds} s to stop at once"));
            }
            Some(first) if first.elapsed() < ONE_REQUEST => {}
            Some(_) => std::process::exit(SIGNALLED + signal),
        }
    }
}

/// Whether the program has been asked to stop.
pub fn asked() -> bool {
    ASKED.load(Ordering::SeqCst) != 0
}

/// The exit code of a program that was asked to stop and did: 130 for Ctrl-C, 143 for SIGTERM.
pub fn exit_code() -> ExitCode {
    let signal = match ASKED.load(Ordering::SeqCst) {
        0 => SIGINT,
        signal => signal,
    };
    ExitCode::from((SIGNALLED + signal) as u8)
}
