//! Damaged files must end in an error, whatever the library that reads them does.

use std::cell::Cell;
use std::io::{self, Read, Seek, SeekFrom};
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, set_hook, take_hook};

use anyhow::{Result, anyhow};

/// Libraries whose panics are turned into errors here.
const GUARDED: [&str; 2] = ["re_mp4", "rusty_h264"];

thread_local! {
    /// Whether this thread reads foreign bytes.
    static READING: Cell<bool> = const { Cell::new(false) };
}

/// Runs what reads foreign bytes; a panic in it is an error.
pub(super) fn guarded<T>(what: &str, read: impl FnOnce() -> Result<T>) -> Result<T> {
    let before = READING.replace(true);
    let outcome = catch_unwind(AssertUnwindSafe(read));
    READING.set(before);
    outcome.unwrap_or_else(|_| Err(anyhow!("{what}: the file is damaged")))
}

/// Keeps panics that become errors from being printed, too. For programs: it changes the hook of the whole process.
pub fn quiet_decoders() {
    let usual = take_hook();
    set_hook(Box::new(move |panic: &PanicHookInfo| {
        let file = panic.location().map_or("", |location| location.file());
        // A library may panic in a thread of its own.
        if !READING.get() && !GUARDED.iter().any(|name| file.contains(name)) {
            usual(panic);
        }
    }));
}

/// A file of boxes that hides some of them and ends in an error after so many reads and seeks: a description that leads back
/// to itself is read for ever otherwise.
pub(super) struct Bounded<R> {
    file: R,
    at: u64,
    calls_left: u64,
    /// Where the names of boxes stand that are shown as free room.
    hidden: Vec<u64>,
}

impl<R> Bounded<R> {
    /// A file that stands at its beginning.
    pub(super) fn new(file: R, calls: u64, hidden: Vec<u64>) -> Self {
        Bounded { file, at: 0, calls_left: calls, hidden }
    }

    fn count(&mut self) -> io::Result<()> {
        self.calls_left =
            self.calls_left.checked_sub(1).ok_or_else(|| io::Error::other("its description leads back to itself"))?;
        Ok(())
    }
}

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.count()?;
        let read = self.file.read(bytes)?;
        for name in &self.hidden {
            for (place, letter) in (*name..).zip(b"free") {
                let byte =
                    place.checked_sub(self.at).and_then(|place| bytes[..read].get_mut(usize::try_from(place).ok()?));
                byte.into_iter().for_each(|byte| *byte = *letter);
            }
        }
        self.at += read as u64;
        Ok(read)
    }
}

impl<R: Seek> Seek for Bounded<R> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.count()?;
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}
