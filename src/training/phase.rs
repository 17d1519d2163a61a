//! A phase of a training: its config, and all it does.
//!
//! The original trains everything together from the first step (`join` alone, the `paper` recipe). The `fast` recipe
//! finds the objects first, then the parameters, then joins.

use std::fmt::Debug;

use anyhow::Result;

use super::base::{Session, TrainingOutcome};
use crate::network::System;

/// One of the phases that a config lists; the config's section is the phase.
pub trait Phase: Debug {
    fn name(&self) -> &'static str;

    /// Frames that go through the networks if the phase takes all its steps: what its time goes by. 0 where next to none
    /// do, or where that depends on the data.
    fn frames(&self, _system: &System) -> f64 {
        0.0
    }

    /// Takes the session's model through the phase, from the session's step on.
    ///
    /// # Errors
    /// A loss that is not a number, data that do not suffice, an observer's error.
    fn run(&self, session: &mut Session) -> Result<TrainingOutcome>;
}
