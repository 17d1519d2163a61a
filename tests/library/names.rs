//! Names of types: each stands for one type of the whole workspace.
//!
//! Only files that git tracks count, as in [`super::repository`].

use std::collections::BTreeMap;
use std::fs;

use super::repository::{root, tracked_files};

/// Names that several types share.
const SHARED: [(&str, &str); 1] =
    [("Result", "the alias of a library crate for its own error type, as `std::io::Result`")];

/// The name that a line declares a type by. A `type` that is indented is an associated one, whose name its trait gives.
fn declared(line: &str) -> Option<&str> {
    let mut text = line.trim_start();
    let indented = text.len() < line.len();
    if let Some(rest) = text.strip_prefix("pub(") {
        text = rest.split_once(") ")?.1;
    }
    text = text.strip_prefix("pub ").unwrap_or(text);
    text = text.strip_prefix("unsafe ").unwrap_or(text);
    let (keyword, rest) = text.split_once(' ')?;
    let is_type = ["struct", "enum", "trait", "union"].contains(&keyword) || keyword == "type" && !indented;
    let name = rest.split(|c: char| !c.is_alphanumeric() && c != '_').next()?;
    (is_type && name.starts_with(char::is_uppercase)).then_some(name)
}

#[test]
fn no_two_types_share_a_name() {
    let Some(files) = tracked_files() else { return };
    let mut types: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for file in files.iter().filter(|file| file.ends_with(".rs")) {
        let text = fs::read_to_string(root().join(file)).unwrap();
        for (number, line) in text.lines().enumerate() {
            if let Some(name) = declared(line) {
                types.entry(name.to_string()).or_default().push(format!("{file}:{}", number + 1));
            }
        }
    }
    assert!(types.len() > 500, "found only {} types", types.len());
    let shared: Vec<_> = types.iter().filter(|(_, places)| places.len() > 1).collect();
    let unexpected: Vec<_> = shared.iter().filter(|(name, _)| SHARED.iter().all(|(known, _)| known != name)).collect();
    assert!(unexpected.is_empty(), "types that share a name: {unexpected:#?}");
    for (name, reason) in SHARED {
        assert!(types.get(name).is_some_and(|places| places.len() > 1), "no types share {name} any more ({reason})");
    }
}

#[test]
fn declarations_are_recognized() {
    for line in
        ["struct A;", "pub struct A<'a> {", "    pub(crate) enum A {", "unsafe trait A: B {", "pub type A = u8;"]
    {
        assert_eq!(declared(line), Some("A"), "{line}");
    }
    for line in ["    type A = u8;", "struct_a A", "// struct A", "let a = A;", "impl A {", "type_of A"] {
        assert_eq!(declared(line), None, "{line}");
    }
}
