//! Filmed videos: [`import`] turns them into tasks, [`measure`] finds the parameters of their motion with intervals,
//! [`run`] does both parts of a whole run, [`track`] follows objects without an equation, [`batch`] puts many measurements into
//! one table.

#![deny(clippy::print_stdout, clippy::print_stderr, clippy::exit)]

pub mod batch;
pub mod calibration;
pub mod import;
pub mod measure;
pub mod reference_track;
pub mod run;
pub mod track;
