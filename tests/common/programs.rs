//! The program as a user calls it.

use std::path::Path;
use std::process::{Command, Output};

/// A command of `paig`.
pub fn paig(command: &str) -> Command {
    let mut program = Command::new(env!("CARGO_BIN_EXE_paig"));
    program.arg(command);
    program
}

/// `paig train` on a task.
pub fn train(task: &str) -> Command {
    let mut command = paig("train");
    command.args(["--task", task]);
    command
}

/// `paig train-baseline` of a model.
pub fn baseline(model: &str) -> Command {
    let mut command = paig("train-baseline");
    command.arg(model);
    command
}

/// Standard output and error together.
pub fn text(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// Runs a command of `paig` in a folder; it must succeed. Returns what it printed.
#[track_caller]
pub fn run(folder: &Path, command: &str, arguments: &[&str]) -> String {
    let output = paig(command).current_dir(folder).args(arguments).output().unwrap();
    assert!(output.status.success(), "{command} {arguments:?}: {}", text(&output));
    text(&output)
}
