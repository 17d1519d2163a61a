//! Numbers beside the accelerations as they stand in a task file.

use serde::{Deserialize, Serialize};

/// A number beside the accelerations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "a number, or the name of a parameter")]
pub enum TableNumber {
    Number(f64),
    Parameter(String),
}
