//! Compares the port with golden tensors of the original, tensor by tensor, and prints one table.
//!
//! Exit code 0: no row fails. 1: a row fails, or a file has no case. 2: bad input. A row that rounding alone moves too
//! far to say anything is counted as uninformative and fails only if its tensor's single steps do (see
//! `tolerances.rs`).

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::Args;
use paig::kernels::Kernels;
use paig::support::atomic;
use paig::support::output::{FileKind, has_keys};
use tch::Kind;

use crate::harness::case::{Case, CaseRun, RoundingNoise};
use crate::harness::golden::Golden;
use crate::harness::row::{ParityRow, RowVerdict};
use crate::harness::table::Table;
use crate::harness::verdict;
use crate::{cases, tolerances};

/// Compares the port with golden tensors of the original TensorFlow code.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  paig compare --file-filter spring")]
pub struct ParityArguments {
    /// Folder of .npz files; every one of them is compared.
    #[arg(long, default_value = "compare/goldens")]
    goldens: PathBuf,
    /// Only files whose name contains this.
    #[arg(long, value_name = "TEXT")]
    file_filter: Option<String>,
    /// Compute in double precision: tells rounding from error (the golden tensors stay what float32 made of them).
    #[arg(long)]
    f64: bool,
    /// Write the comparisons as one JSON object a line to this file as well.
    #[arg(long, value_name = "FILE")]
    rows: Option<PathBuf>,
    /// Take the weights of whole models from this file of a checkpoint, not from the formula.
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,
}

/// Comparisons as a file that the program recognizes.
const ROWS: FileKind = FileKind {
    name: "comparisons of `paig compare`",
    recognizes: |lines| {
        let first = lines.split(|byte| *byte == b'\n').next().unwrap_or_default();
        has_keys(first, &["file", "tensor", "tolerance", "verdict"])
    },
};

/// Compares and prints.
///
/// # Errors
/// Golden files that cannot be read.
pub fn run(arguments: &ParityArguments) -> Result<ExitCode> {
    // Sums in one order on every machine.
    tch::set_num_threads(1);
    Ok(if compare(arguments)? { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Whether every file has a case and no row fails.
fn compare(arguments: &ParityArguments) -> Result<bool> {
    let kind = if arguments.f64 { Kind::Double } else { Kind::Float };
    let files = golden_files(&arguments.goldens, arguments.file_filter.as_deref().unwrap_or_default())?;
    let rows_file = arguments.rows.as_deref().map(|path| ROWS.check(path, &[&arguments.goldens])).transpose()?;
    let mut table = Table::new(&files);
    let mut lines = String::new();
    for path in &files {
        let rows =
            compare_file(path, kind, arguments.weights.as_deref()).with_context(|| path.display().to_string())?;
        let judged = rows.map(verdict::judge);
        for each in judged.iter().flatten() {
            let _ = writeln!(lines, "{}", each.json(path));
        }
        table.add(path, judged.as_deref());
    }
    if let Some(path) = rows_file {
        atomic::write_file(&path, |file| Ok(file.write_all(lines.as_bytes())?))?;
    }
    Ok(table.finish())
}

/// The `.npz` files of a folder whose name contains `filter`, sorted.
fn golden_files(folder: &Path, filter: &str) -> Result<Vec<PathBuf>> {
    let entries = folder.read_dir().with_context(|| format!("cannot read the folder {}", folder.display()))?;
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.with_context(|| format!("cannot read the folder {}", folder.display()))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.ends_with(".npz") && name.contains(filter) {
            files.push(path);
        }
    }
    files.sort();
    ensure!(!files.is_empty(), "no .npz file with {filter:?} in its name in {}", folder.display());
    Ok(files)
}

/// The rows of one file; none if no case knows files of its name.
fn compare_file(path: &Path, kind: Kind, weights: Option<&Path>) -> Result<Option<Vec<ParityRow>>> {
    let golden = Golden::read(path)?;
    let own = |kind, noise| CaseRun { kind, kernels: Kernels::Own, noise };
    let Some(mut rows) = run_case(&golden, own(kind, None), weights)? else { return Ok(None) };
    golden.ensure_all_looked_at()?;
    if rows.iter().any(|row| !row.within_tolerance()) {
        // Both precisions by libtorch: what is wrong with the port's own kernels is no rounding.
        let by_libtorch = |kind| {
            let run = CaseRun { kind, kernels: Kernels::Libtorch, noise: None };
            Ok::<_, anyhow::Error>(run_case(&golden, run, weights)?.unwrap_or_default())
        };
        let (single, double) = (by_libtorch(Kind::Float)?, by_libtorch(Kind::Double)?);
        let pairs = single.iter().zip(&double);
        rows.iter_mut().zip(pairs).for_each(|(row, (single, double))| row.allow_between(single, double));
        // Then moved inputs in the precision of the golden tensors.
        for probe in 1..=tolerances::MOST_PROBES {
            if probe > tolerances::PROBES && rows.iter().all(|row| row.verdict() != RowVerdict::Fail) {
                break;
            }
            let size = if probe > tolerances::PROBES { tolerances::LARGE_STEP } else { 1.0 };
            let noise = RoundingNoise::new(probe, size);
            let probe = run_case(&golden, own(Kind::Float, Some(noise)), weights)?.unwrap_or_default();
            rows.iter_mut().zip(&probe).for_each(|(row, probe)| row.allow_for(probe, size));
        }
    }
    Ok(Some(rows))
}

/// Runs the case that knows files of this name.
fn run_case(golden: &Golden, run: CaseRun, weights: Option<&Path>) -> Result<Option<Vec<ParityRow>>> {
    let mut case = Case::new(golden, run, weights);
    cases::compare(&mut case).map(|compared| compared.map(|()| case.rows)).transpose()
}
