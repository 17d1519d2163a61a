//! The programs as a user calls them in a folder.

use std::path::Path;
use std::process::{Command, Output};

/// Standard output and error together.
pub fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// Runs a program in a folder; it must succeed. Returns what it printed.
#[track_caller]
pub fn run(folder: &Path, program: &str, arguments: &[&str]) -> String {
    let path = Path::new(env!("CARGO_BIN_EXE_run_physics")).with_file_name(program);
    let output = Command::new(path).current_dir(folder).args(arguments).output().unwrap();
    assert!(output.status.success(), "{program} {arguments:?}: {}", text(&output));
    text(&output)
}
