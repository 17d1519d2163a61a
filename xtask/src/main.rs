//! Tools for development, `cargo xtask TOOL`: faults, kills, fuzzing, resources, coverage of intervals.

mod dataset;
mod equation_choice;
mod fuzz;
#[path = "../../tests/common/inputs.rs"]
mod inputs;
mod interval_coverage;
mod paper;
mod programs;
#[path = "../../tests/common/project.rs"]
mod project;
mod recordings;
mod report_files;
mod resources;
mod seeds;
mod synthetic_video;
mod tables;
mod torture;
mod torture_report;
mod trajectory;

use anyhow::Result;
use clap::Parser;

/// Tools for development.
#[derive(Debug, Parser)]
enum Tool {
    Fuzz(fuzz::FuzzArguments),
    Recordings(recordings::RecordingsArguments),
    Resources(resources::ResourcesArguments),
    Torture(torture::TortureArguments),
    /// Writes reports/torture from what the parts of `make torture` printed.
    TortureReport,
    IntervalCoverage(interval_coverage::IntervalCoverageArguments),
    Seeds(seeds::SeedsArguments),
    EquationChoice(equation_choice::EquationChoiceArguments),
    SyntheticVideo(synthetic_video::SyntheticVideoArguments),
    Tables(tables::TablesArguments),
    Paper(paper::PaperArguments),
    Dataset(dataset::DatasetArguments),
}

fn main() -> Result<()> {
    match Tool::parse() {
        Tool::Fuzz(arguments) => fuzz::run(&arguments),
        Tool::Recordings(arguments) => recordings::run(&arguments),
        Tool::Resources(arguments) => resources::run(&arguments),
        Tool::Torture(arguments) => torture::run(&arguments),
        Tool::TortureReport => torture_report::run(),
        Tool::IntervalCoverage(arguments) => interval_coverage::run(&arguments),
        Tool::Seeds(arguments) => seeds::run(&arguments),
        Tool::EquationChoice(arguments) => equation_choice::run(&arguments),
        Tool::SyntheticVideo(arguments) => synthetic_video::run(&arguments),
        Tool::Tables(arguments) => tables::run(&arguments),
        Tool::Paper(arguments) => paper::run(&arguments),
        Tool::Dataset(arguments) => dataset::run(&arguments),
    }
}
