//! Sweeps, scenes, comparisons, control, by calls.

#[path = "../common/project.rs"]
mod project;
#[path = "../common/random.rs"]
mod random;

mod planet;
mod scenes;
