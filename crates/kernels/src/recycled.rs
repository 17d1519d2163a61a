//! Memory that is used again by the next step.

use std::sync::Mutex;

use super::threads::locked;

/// What was given back, in any order.
#[derive(Debug)]
pub struct Recycled<T>(Mutex<Vec<T>>);

impl<T> Recycled<T> {
    pub fn new() -> Self {
        Recycled(Mutex::new(Vec::new()))
    }

    /// What was given back last, or something new.
    pub fn take(&self, new: impl FnOnce() -> T) -> T {
        let kept = locked(&self.0).pop();
        kept.unwrap_or_else(new)
    }

    pub fn give(&self, used: T) {
        locked(&self.0).push(used);
    }
}
