//! The stress suite: scenes unlike the paper's, learned with the plain recipe, in a matrix of scene x dataset x seed.

pub mod list;
mod matrix;
pub mod page;
mod suite;

pub use list::{DataSeed, StressList, SuiteScene};
pub use matrix::{SceneOutcome, outcome};
pub use suite::{Reported, StressEvent, Suite, SuiteEnd, SuiteWatch};
