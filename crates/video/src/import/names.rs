//! Files of an imported task, beside its film.

pub(crate) const TRAIN: &str = "train.npz";
pub(super) const TEST: &str = "test.npz";
pub(super) const SHEET: &str = "contact-sheet.png";
pub(crate) const TASK: &str = "task.toml";
