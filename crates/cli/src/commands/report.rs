//! Writes a report of run folders. See `paig report --help`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use paig_report::{self as report, WithPictures};
use paig_terminal::say;

/// Writes a report of all runs in and under the given folders: report.md, report.html (one file, with its pictures),
/// results.json, and the runs' records (config, course, summary), which `report` reads as it reads runs.
///
/// Every run counts, also those that failed or have not finished; the tables say how many seeds were tried and how
/// many succeeded, beside the published numbers.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  paig report runs --out report\n  paig report report/records runs --out newer")]
pub struct ReportArguments {
    /// Run folders, or folders that hold some
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// Folder of the report; what an earlier report left there is replaced
    #[arg(long, default_value = "report")]
    out: PathBuf,
    /// Draw no pictures: a report that is small enough to be kept in a repository
    #[arg(long)]
    no_pictures: bool,
}

pub fn run(arguments: &ReportArguments) -> Result<ExitCode> {
    let pictures = if arguments.no_pictures { WithPictures::LeftOut } else { WithPictures::Shown };
    let found = report::write(&arguments.runs, &arguments.out, pictures)?;
    let report::RunCounts { finished, unfinished, unreadable, without_course } = found;
    without_course.iter().for_each(|reason| say!("warning: {reason}; the run has no course in the report"));
    say!("{finished} finished, {unfinished} unfinished, {unreadable} unreadable runs");
    say!("{}", arguments.out.join("report.html").display());
    Ok(ExitCode::SUCCESS)
}
