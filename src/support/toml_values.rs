//! The values of a TOML file.

use std::collections::BTreeMap;

use toml::{Table, Value};

/// A text as TOML writes it: Rust's own quotes escape some letters, such as combining accents, in a way TOML has not.
pub fn quoted(text: &str) -> String {
    Value::from(text).to_string()
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
