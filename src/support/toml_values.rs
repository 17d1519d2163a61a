//! The values of a TOML file.

use std::collections::BTreeMap;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use toml::{Table, Value};

/// A text as TOML writes it: Rust's own quotes escape some letters, such as combining accents, in a way TOML has not.
pub fn quoted(text: &str) -> String {
    Value::from(text).to_string()
}

/// Reads a list of exactly so many values: serde's own arrays drop what comes after.
///
/// # Errors
/// Another number of values.
pub fn exact<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(from: D) -> Result<[T; N], D::Error> {
    let values = Vec::<T>::deserialize(from)?;
    let found = values.len();
    values.try_into().map_err(|_| D::Error::custom(format!("expected {N} values, found {found}")))
}

/// The same of a key that may be missing.
///
/// # Errors
/// As for [`exact`].
pub fn exact_if_given<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
    from: D,
) -> Result<Option<[T; N]>, D::Error> {
    exact(from).map(Some)
}

/// All values by their full key, in TOML's notation.
pub(crate) fn leaves(table: &Table) -> BTreeMap<String, String> {
    fn walk(table: &Table, prefix: &str, leaves: &mut BTreeMap<String, String>) {
        for (key, value) in table {
            let key = format!("{prefix}{key}");
            match value {
                Value::Table(below) => walk(below, &format!("{key}."), leaves),
                value => drop(leaves.insert(key, value.to_string())),
            }
        }
    }
    let mut all = BTreeMap::new();
    walk(table, "", &mut all);
    all
}
