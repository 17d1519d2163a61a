//! Names of the files in a run's folder.

/// What was asked for.
pub const CONFIG: &str = "config.toml";
/// The original's lines.
pub const LOG: &str = "log.txt";
/// The course of the training.
pub const METRICS: &str = "metrics.jsonl";
/// The same course for TensorBoard, which looks for `tfevents` in a name.
pub const TENSORBOARD: &str = "events.out.tfevents.paig";
/// What came out.
pub const SUMMARY: &str = "summary.json";
/// The folder of the checkpoints.
pub const CHECKPOINTS: &str = "checkpoints";
/// What says all of a run in few bytes.
pub const RECORDS: [&str; 3] = [CONFIG, METRICS, SUMMARY];
/// What a run printed under `sweep`.
pub const OUTPUT: &str = "output.log";
/// Marks a run that has finished under `sweep`.
pub const DONE: &str = "DONE";
/// Held while a program runs in the folder.
pub const LOCK: &str = ".lock";
