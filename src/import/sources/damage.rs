//! Damaged files must end in an error, whatever the library that reads them does.

use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, set_hook, take_hook};

use anyhow::{Result, anyhow};

/// Libraries whose panics are turned into errors here.
const GUARDED: [&str; 2] = ["re_mp4", "rusty_h264"];

/// Runs what reads foreign bytes; a panic in it is an error.
pub(super) fn guarded<T>(what: &str, read: impl FnOnce() -> Result<T>) -> Result<T> {
    catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| Err(anyhow!("{what}: the file is damaged")))
}

/// Keeps panics that become errors from being printed, too. For programs: it changes the hook of the whole process.
pub fn quiet_decoders() {
    let usual = take_hook();
    set_hook(Box::new(move |panic: &PanicHookInfo| {
        let file = panic.location().map_or("", |location| location.file());
        if !GUARDED.iter().any(|name| file.contains(name)) {
            usual(panic);
        }
    }));
}
