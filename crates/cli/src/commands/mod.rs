//! The commands.

mod baselines;
mod batch;
mod camera_options;
mod compare_track;
mod completions;
mod control;
mod convert;
mod demo;
mod evaluate;
mod generate;
mod import;
mod measure;
mod measurements;
mod predict;
mod report;
mod scene_options;
mod stress;
mod studio;
mod sweep;
mod track;
mod track_options;
mod train;
mod train_baseline;

use std::process::ExitCode;

use anyhow::Result;
use clap::Subcommand;
use paig_parity::{parity, speed};

/// What `paig` is asked to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    Demo(demo::DemoArguments),
    Train(train::TrainArguments),
    Generate(generate::GenerateArguments),
    Evaluate(evaluate::EvaluateArguments),
    Predict(predict::PredictArguments),
    Convert(convert::ConvertArguments),
    Import(Box<import::ImportArguments>),
    Measure(Box<measure::MeasureArguments>),
    Measurements(measurements::MeasurementsArguments),
    Batch(batch::BatchArguments),
    CompareTrack(compare_track::CompareTrackArguments),
    Track(track::TrackArguments),
    Studio(studio::StudioArguments),
    Sweep(sweep::SweepArguments),
    Report(report::ReportArguments),
    Stress(stress::StressArguments),
    Baselines(baselines::BaselinesArguments),
    TrainBaseline(train_baseline::TrainBaselineArguments),
    Control(Box<control::ControlArguments>),
    Compare(parity::ParityArguments),
    Bench(speed::SpeedArguments),
    Completions(completions::CompletionsArguments),
}

impl Command {
    /// # Errors
    /// Each command's own.
    pub fn run(self) -> Result<ExitCode> {
        let done = |()| ExitCode::SUCCESS;
        match self {
            Command::Demo(arguments) => demo::run(&arguments),
            Command::Train(arguments) => train::run(&arguments),
            Command::Generate(arguments) => generate::run(arguments).map(done),
            Command::Evaluate(arguments) => evaluate::run(&arguments),
            Command::Predict(arguments) => predict::run(&arguments),
            Command::Convert(arguments) => convert::run(&arguments).map(done),
            Command::Import(arguments) => import::run(*arguments).map(done),
            Command::Measure(arguments) => measure::run(&arguments).map(done),
            Command::Measurements(arguments) => measurements::run(&arguments).map(done),
            Command::Batch(arguments) => batch::run(arguments),
            Command::CompareTrack(arguments) => compare_track::run(&arguments).map(done),
            Command::Track(arguments) => track::run(&arguments).map(done),
            Command::Studio(arguments) => studio::run(&arguments).map(done),
            Command::Sweep(arguments) => sweep::run(arguments),
            Command::Report(arguments) => report::run(&arguments),
            Command::Stress(arguments) => stress::run(&arguments),
            Command::Baselines(arguments) => arguments.run(),
            Command::TrainBaseline(arguments) => train_baseline::run(arguments),
            Command::Control(arguments) => control::run(&arguments),
            Command::Compare(arguments) => parity::run(&arguments),
            Command::Bench(arguments) => speed::run(&arguments),
            Command::Completions(arguments) => completions::run(&arguments).map(done),
        }
    }
}
