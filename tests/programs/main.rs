//! The programs, as a user calls them.

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/inputs.rs"]
mod inputs;
#[path = "../common/process.rs"]
mod process;
#[path = "../common/programs.rs"]
mod programs;
#[path = "../common/project.rs"]
mod project;
#[path = "../common/random.rs"]
mod random;
#[path = "../common/tiny.rs"]
mod tiny;

mod baselines;
mod command_line;
mod control;
mod convert;
mod dataset_files;
mod evaluate;
mod gallery;
mod goldens;
mod import;
mod invocations;
mod learning;
mod manual;
mod measure;
mod outputs;
mod own_task;
mod parsers;
mod places;
mod report;
mod signals;
mod strange_files;
mod studio;
mod swapped_files;
mod sweep;
mod training;
