//! `results.json`: what each planner reached.

use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use rand::Rng;
use serde::{Deserialize, Serialize};

use paig::support::atomic;
use paig::support::output::{FileSet, has_keys};
use paig::support::random::named_generator;
use paig::support::storage::{self, storage};

/// Number of the file's form.
pub const FORMAT: u32 = 2;
/// Samples drawn for an interval.
const RESAMPLES: usize = 2000;

/// The file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlResults {
    pub format: u32,
    /// The line of a study that these rows were played by.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub line: Option<String>,
    pub rows: Vec<PlannerRow>,
}

/// One planner in one world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannerRow {
    pub task: String,
    pub planner: String,
    /// The run whose model sees; none of planners without one.
    pub model: Option<String>,
    /// Clips that the run was trained on, if known.
    pub clips: Option<usize>,
    /// Degrees from upright, clockwise, or pixels from the left; none of Gymnasium's cost.
    pub goal: Option<f64>,
    /// The environment's, of a pendulum.
    pub gravity: Option<f64>,
    /// What else is not as usual.
    pub setting: String,
    pub episodes: usize,
    pub return_mean: f64,
    /// 95 % interval of the mean over episodes, by the bootstrap.
    pub return_low: f64,
    pub return_high: f64,
    /// Mean return of the planner that knows state and equation, in the same episodes.
    pub upper_bound: f64,
    /// Processor time of the thread that decides, drawing excluded: all there is with one thread, as by default.
    pub ms_per_decision: f64,
}

/// Mean of some returns with the ends of its 95 % interval, by the percentile bootstrap: `[mean, low, high]`. None
/// without returns.
pub fn mean_and_interval(returns: &[f64], seed: u64) -> Option<[f64; 3]> {
    if returns.is_empty() {
        return None;
    }
    let count = returns.len() as f64;
    let mut random = named_generator(seed, "bootstrap");
    let mut mean_of_draw = |_| {
        let drawn = (0..returns.len()).map(|_| returns[random.random_range(0..returns.len())]);
        drawn.sum::<f64>() / count
    };
    let mut means: Vec<f64> = (0..RESAMPLES).map(&mut mean_of_draw).collect();
    means.sort_by(f64::total_cmp);
    let at = |share: f64| means[((RESAMPLES - 1) as f64 * share).round() as usize];
    Some([returns.iter().sum::<f64>() / count, at(0.025), at(0.975)])
}

impl ControlResults {
    /// The file's name.
    pub const FILE: &str = "results.json";

    /// The file, by which the folder is recognized.
    const MARK: FileSet = FileSet {
        name: "results of `paig control`",
        files: &[Self::FILE],
        recognizes: |json| has_keys(json, &["format", "rows"]),
    };

    /// Makes a folder for results, which are empty at first: that shows whose the pictures of a killed experiment are.
    ///
    /// # Errors
    /// A folder with files that this program did not write, or that cannot be written.
    pub fn claim(folder: &Path) -> Result<()> {
        Self::MARK.check_alone(folder)?;
        storage().create_folder(folder).with_context(|| format!("cannot create {}", folder.display()))?;
        let path = folder.join(Self::FILE);
        if path.exists() {
            return Ok(());
        }
        ControlResults { format: FORMAT, line: None, rows: Vec::new() }.write(&path)
    }

    /// Reads the file.
    ///
    /// # Errors
    /// A file that is missing, damaged or of another form.
    pub fn read(path: &Path) -> Result<Self> {
        let text = storage::read(path).with_context(|| format!("cannot read {}", path.display()))?;
        let results: Self = serde_json::from_slice(&text).with_context(|| format!("{}", path.display()))?;
        ensure!(results.format == FORMAT, "{}: format {}, not {FORMAT}", path.display(), results.format);
        Ok(results)
    }

    /// Writes the file in one step.
    ///
    /// # Errors
    /// A folder that is missing or cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        atomic::write_file(path, |file| {
            serde_json::to_writer_pretty(&mut *file, self)?;
            Ok(file.write_all(b"\n")?)
        })
    }
}
