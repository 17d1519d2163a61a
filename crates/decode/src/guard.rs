//! Panics of foreign decoders become errors.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, set_hook, take_hook};

use crate::error::{DecodeError, Result};

thread_local! {
    /// Whether this thread decodes foreign bytes.
    static DECODING: Cell<bool> = const { Cell::new(false) };
}

/// Runs a foreign decoder; a panic in it is damage of what it decodes.
pub(crate) fn guarded<T>(what: &str, decode: impl FnOnce() -> Result<T>) -> Result<T> {
    let before = DECODING.replace(true);
    let outcome = catch_unwind(AssertUnwindSafe(decode));
    DECODING.set(before);
    outcome.unwrap_or_else(|_| Err(DecodeError::corrupt(format!("{what}: the decoder gave up"))))
}

/// Keeps panics that become errors from being printed, too. For programs: it changes the panic hook of the process.
pub fn quiet_decoders() {
    let usual = take_hook();
    set_hook(Box::new(move |panic: &PanicHookInfo| {
        if !DECODING.get() {
            usual(panic);
        }
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error() {
        quiet_decoders();
        let outcome: Result<()> = guarded("codec", || panic!("index out of bounds"));
        assert_eq!(outcome.unwrap_err().to_string(), "codec: the decoder gave up; is the file damaged?");
        assert!(!DECODING.get());
    }
}
