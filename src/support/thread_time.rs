//! Processor time of one thread: what a computation costs, whatever else runs on the machine.

use std::fs;
use std::sync::LazyLock;
use std::time::{Duration, Instant};

static BEGIN: LazyLock<Instant> = LazyLock::new(Instant::now);

/// Time that the calling thread has been computing, on Linux; elsewhere the time that has passed. Only differences mean
/// anything.
pub fn thread_time() -> Duration {
    let begin = *BEGIN;
    // The kernel's count for this thread in nanoseconds, then two others.
    let text = fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    let nanoseconds = text.split_whitespace().next().and_then(|number| number.parse().ok());
    nanoseconds.map_or_else(|| begin.elapsed(), Duration::from_nanos)
}
