//! A small dataset on the disk and the programs that are tested, for the tests of whole runs.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use tempfile::TempDir;

use crate::programs::{paig, text, train};

/// Clips of the training split of [`dataset`].
pub const TRAIN_CLIPS: usize = 300;

/// Folder with a small spring_color dataset, made once for a test binary by the program a user would call.
pub fn dataset() -> &'static Path {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    FOLDER
        .get_or_init(|| {
            let folder = tempfile::tempdir().unwrap();
            let made = paig("generate")
                .args(["--task", "spring_color", "--valid", "40", "--test", "20", "--train", &TRAIN_CLIPS.to_string()])
                .arg("--out")
                .arg(folder.path())
                .output()
                .unwrap();
            assert!(made.status.success(), "{}", text(&made));
            folder
        })
        .path()
}

/// The training program on the small dataset with one thread.
pub fn spring(out: &Path) -> Command {
    let mut command = train("spring_color");
    command.arg("--out").arg(out);
    command
}

/// The arguments of a new run: data and threads.
pub fn fresh(command: &mut Command) -> &mut Command {
    command.args(["--threads", "1", "--data"]).arg(dataset())
}

/// A config file of that text in the folder.
pub fn write_config(folder: &Path, text: &str) -> PathBuf {
    let path = folder.join("test.toml");
    std::fs::write(&path, text).unwrap();
    path
}
