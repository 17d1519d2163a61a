//! The stress suite: scenes unlike the paper's, learned with the plain recipe, in a matrix of scene x dataset x seed.

pub mod list;
mod matrix;
mod page;
mod suite;

pub use list::{DataSeed, Scene, StressList};
pub use matrix::{Outcome, outcome};
pub use suite::{Ended, Reported, StressEvent, Suite, Watch};
