//! Files of the project, from whatever package a test belongs to.

use std::path::{Path, PathBuf};

/// A file or folder by its path in the project.
pub fn project(path: &str) -> PathBuf {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root =
        package.ancestors().find(|folder| folder.join("Cargo.lock").exists()).expect("a workspace has a lock file");
    root.join(path)
}
