//! What tch says where libtorch fails: it panics.

use std::any::Any;

/// The first line of what a panic said; those after it are a trace of libtorch's own calls.
pub fn first_line(panic: &(dyn Any + Send)) -> &str {
    let said = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    said.and_then(|said| said.lines().next()).unwrap_or("it panicked")
}
