//! When a run of a task is a success.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::network::physics_models::losses::Loss;

/// Limits that a finished run has to keep, all of them.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Success {
    /// Largest error of a parameter by symbol, per cent of its truth. Counts where the parameter is learned.
    pub parameters: BTreeMap<String, f64>,
    /// Largest test losses.
    pub losses: BTreeMap<Loss, f64>,
    /// What a reader should know of these limits.
    pub note: Option<String>,
}

impl Success {
    /// Whether there are no limits: then no run is a success or a failure.
    pub fn is_empty(&self) -> bool {
        self.parameters.is_empty() && self.losses.is_empty()
    }
}
