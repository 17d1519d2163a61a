//! SIGINT and SIGTERM: a run finishes its step, saves and stops.

use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Result, anyhow};

static ASKED: AtomicBool = AtomicBool::new(false);
static INSTALL: Once = Once::new();

/// Catches the signals from now on; a second one ends the process at once.
///
/// # Errors
/// A handler that cannot be installed.
pub fn catch() -> Result<()> {
    let mut outcome = Ok(());
    INSTALL.call_once(|| {
        outcome = ctrlc::set_handler(|| {
            if ASKED.swap(true, Ordering::SeqCst) {
                std::process::exit(130);
            }
            eprintln!("stopping after this step; once more to stop at once");
        });
    });
    outcome.map_err(|error| anyhow!("cannot catch interrupts: {error}"))
}

/// Whether the run has been asked to stop.
pub fn asked() -> bool {
    ASKED.load(Ordering::SeqCst)
}
