//! The Python module `paig._paig`: calls of the library for the package in `../python/paig`, which has the types and
//! documentation that users see.
//!
//! Requests and results that are no arrays pass as JSON, whose form is that of the library's own types. Work is done on
//! threads of its own with the GIL released.

#![cfg(feature = "module")]
#![deny(clippy::print_stdout, clippy::print_stderr, clippy::exit)]

mod arrays;
mod attend;
mod errors;
mod events;
mod films;
mod generators;
mod library;
mod model;
mod runs;

use paig::run::Program;
use pyo3::pymodule;

/// This build, as results name it: that of the program in the same wheel.
const PROGRAM: Program = Program { version: env!("CARGO_PKG_VERSION"), commit: env!("PAIG_COMMIT") };

#[pymodule]
mod _paig {
    #[pymodule_export]
    use super::films::{import_video, measure, track};
    #[pymodule_export]
    use super::generators::{generate, generate_clips};
    #[pymodule_export]
    use super::library::{check_equation, task, task_file, tasks, versions};
    #[pymodule_export]
    use super::model::Model;
    #[pymodule_export]
    use super::runs::{config, describe, run_folders, train};
}
