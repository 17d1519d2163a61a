//! The text of a config, of whatever version.

use anyhow::Result;
use toml::{Table, Value};

/// Keys that had another name in earlier versions, whose configs and records still read: section, then, now.
const EARLIER_NAMES: [(&str, &str, &str); 5] = [
    ("discover", "clip", "clip_gradients"),
    ("model", "hold", "fixed"),
    ("join", "clip", "clip_gradients"),
    ("join", "latent", "position_consistency"),
    ("join", "velocity", "velocity_consistency"),
];

/// A config or a part of one as a table, keys under their present names.
///
/// # Errors
/// Text that is no TOML.
pub fn parse(text: &str) -> Result<Table> {
    let mut table = text.parse::<Table>()?;
    for (section, then, now) in EARLIER_NAMES {
        if let Some(Value::Table(section)) = table.get_mut(section)
            && let Some(value) = section.remove(then)
        {
            section.insert(now.into(), value);
        }
    }
    Ok(table)
}
