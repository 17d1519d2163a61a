//! The text of a config, of whatever version.

use anyhow::Result;
use toml::{Table, Value};

/// Keys that had another name in earlier versions, whose configs and records still read: section, then, now.
const EARLIER_NAMES: [(&str, &str, &str); 7] = [
    ("discover", "clip", "clip_gradients"),
    ("discover.guide", "colour", "identity"),
    ("identify", "recentre_above", "recentre"),
    ("model", "hold", "fixed"),
    ("join", "clip", "clip_gradients"),
    ("join", "latent", "position_consistency"),
    ("join", "velocity", "velocity_consistency"),
];
/// Keys of earlier versions that mean nothing any more: section, key.
const GONE: [(&str, &str); 1] = [("discover.guide", "temperature")];

/// A config or a part of one as a table, keys under their present names.
///
/// # Errors
/// Text that is no TOML.
pub(crate) fn parse(text: &str) -> Result<Table> {
    let mut table = text.parse::<Table>()?;
    for (place, then, now) in EARLIER_NAMES {
        if let Some(section) = section(&mut table, place)
            && let Some(value) = section.remove(then)
        {
            section.insert(now.into(), present(now, value));
        }
    }
    for (place, key) in GONE {
        section(&mut table, place).and_then(|section| section.remove(key));
    }
    Ok(table)
}

/// A section by its path, if it is there.
fn section<'a>(table: &'a mut Table, path: &str) -> Option<&'a mut Table> {
    path.split('.').try_fold(table, |table, name| table.get_mut(name)?.as_table_mut())
}

/// What was a limit of pixels, 0 for never, is a choice now.
fn present(key: &str, value: Value) -> Value {
    match (key, value.as_float()) {
        ("recentre", Some(limit)) => Value::Boolean(limit > 0.0),
        _ => value,
    }
}

#[cfg(test)]
mod tests {
    use super::parse;

    #[test]
    fn keys_of_earlier_versions_read() {
        let then = "[discover]\nclip = 1.0\n[discover.guide]\ntemperature = 0.1\ncolour = 10.0\n[identify]\nrecentre_above = 0.05\n";
        let now = "[discover]\nclip_gradients = 1.0\n[discover.guide]\nidentity = 10.0\n[identify]\nrecentre = true\n";
        assert_eq!(parse(then).unwrap(), parse(now).unwrap());
    }
}
