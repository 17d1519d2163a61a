//! Memory that is used again by the next step.

use std::sync::{Mutex, PoisonError};

/// What was given back, in any order.
#[derive(Debug)]
pub struct Recycled<T>(Mutex<Vec<T>>);

impl<T> Recycled<T> {
    pub fn new() -> Self {
        Recycled(Mutex::new(Vec::new()))
    }

    /// What was given back last, or something new.
    pub fn take(&self, new: impl FnOnce() -> T) -> T {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        kept.unwrap_or_else(new)
    }

    pub fn give(&self, used: T) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(used);
    }
}
