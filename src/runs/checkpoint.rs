//! Checkpoints: everything a run needs to go on to the same bits as if it had never stopped.
//!
//! `checkpoints/step_<n>/` holds `weights.safetensors`, `slots.safetensors` (the optimizer's) and `state.json`, each with a
//! checksum. The last two are kept: where the last one is damaged, the one before it is taken.
//! `checkpoints/index.json` says for people and scripts which is the last. Folders and index each appear in one step, so a
//! run killed at any moment finds a complete checkpoint. `checkpoints/best.safetensors` holds the weights with the best
//! validation score of the last phase, `checkpoints/best_<phase>.safetensors` those of an earlier one.

use std::fs;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use serde::{Deserialize, Serialize};
use tch::Tensor;

use super::weights::{self, NamedTensors, first_not_finite};
use crate::datasets::dataset::are_the_same;
use crate::support::atomic;
use crate::support::error::{self, Error};
use crate::support::random::fnv1a;
use crate::support::run_names::{CHECKPOINTS, CONFIG, LOG, METRICS};
use crate::support::storage::{self, storage};

/// Version of the form of `state.json` and `index.json`. Files of before it have none.
const FORMAT: u32 = 2;
/// The first form with checksums.
const FORMAT_WITH_CHECKSUMS: u32 = 2;

/// Where a run stands between two steps. What an earlier version wrote besides is not read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunState {
    #[serde(default)]
    pub format: u32,
    /// Name of the task: a checkpoint of another task is refused.
    pub task: String,
    /// Place in the recipe's list of phases.
    pub phase: usize,
    /// Steps taken in this phase, the optimizer's too: its slots belong to the phase.
    pub step: u64,
    /// Steps taken in all phases.
    pub steps: u64,
    /// Validation scores of this phase.
    pub validations: Vec<f64>,
    /// Seconds of computing so far, and those of each finished phase by name.
    pub seconds: f64,
    pub phase_seconds: Vec<(String, f64)>,
    /// The commits whose builds took the steps; none of a run of an earlier version.
    #[serde(default)]
    pub commits: Vec<String>,
    /// Lengths of log.txt and metrics.jsonl at this moment, bytes: what came later is cut off on resuming.
    pub log_bytes: u64,
    pub metrics_bytes: u64,
    /// Checksum of the config.toml that the run was begun with; empty in those of earlier versions.
    #[serde(default)]
    pub config: String,
    /// Checksums of the clips that the run learns from; empty in those of earlier versions.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub clips: String,
    /// Checksum of the film beside the clips; empty where there is none, and in those of earlier versions.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub film: String,
    /// Checksum of the test clips; empty in those of earlier versions.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub test: String,
    /// Checksum of the first `metrics_bytes` of metrics.jsonl; empty where there are none, and in those of earlier versions.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    metrics: String,
    /// Checksums of the weights and slots beside the state; empty in those of earlier versions.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    weights: String,
    #[serde(default, skip_serializing_if = "String::is_empty")]
    slots: String,
    /// Of all the rest; empty in those of earlier versions.
    #[serde(default)]
    checksum: String,
}

impl RunState {
    /// A run that has not begun.
    pub fn new(task: &str) -> Self {
        RunState {
            format: FORMAT,
            task: task.into(),
            phase: 0,
            step: 0,
            steps: 0,
            validations: Vec::new(),
            seconds: 0.0,
            phase_seconds: Vec::new(),
            commits: Vec::new(),
            log_bytes: 0,
            metrics_bytes: 0,
            config: String::new(),
            clips: String::new(),
            film: String::new(),
            test: String::new(),
            metrics: String::new(),
            weights: String::new(),
            slots: String::new(),
            checksum: String::new(),
        }
    }

    /// What the run was begun with.
    pub fn data(&self) -> DataChecksums {
        let RunState { clips, film, test, .. } = self;
        DataChecksums { clips: clips.clone(), film: film.clone(), test: test.clone() }
    }

    /// The text of state.json, with its checksum.
    fn to_json(&self) -> Result<Vec<u8>> {
        let checksum = self.sum()?;
        Ok(serde_json::to_vec_pretty(&RunState { checksum, ..self.clone() })?)
    }

    fn sum(&self) -> Result<String> {
        let bare = RunState { checksum: String::new(), ..self.clone() };
        Ok(checksum(&serde_json::to_vec(&bare)?))
    }

    fn from_json(text: &[u8]) -> Result<Self> {
        let state: Self = serde_json::from_slice(text)?;
        ensure!(
            state.format <= FORMAT,
            "it has form {}; this program knows forms up to {FORMAT}: use a newer one",
            state.format
        );
        let checked = state.format >= FORMAT_WITH_CHECKSUMS || !state.checksum.is_empty();
        ensure!(!checked || state.checksum == state.sum()?, "it was changed or damaged: its checksum does not fit");
        Ok(state)
    }
}

/// Which folder is the last checkpoint.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
struct CheckpointIndex {
    format: u32,
    last: String,
}

/// Which of a run's weights.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SavedWeights {
    /// Of the last checkpoint.
    #[default]
    Last,
    /// With the best validation score of the last phase.
    Best,
}

/// The phase whose best weights are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BestOf<'a> {
    LastPhase,
    Earlier(&'a str),
}

/// What a checkpoint holds besides the weights.
#[derive(Debug)]
pub struct Loaded {
    /// The checkpoint's folder.
    pub name: String,
    pub state: RunState,
    /// The optimizer's values by variable and slot.
    pub slots: NamedTensors,
    /// Later checkpoints that are damaged, and how.
    pub damaged: Option<String>,
}

/// The checkpoints of a run folder.
#[derive(Debug, Clone)]
pub struct Store {
    run: PathBuf,
}

/// What to do about a checkpoint that cannot be read where there is no other one.
const ADVICE: &str = "put it back from a copy, or begin the run again in another folder";

const INDEX: &str = "index.json";
const WEIGHTS: &str = "weights.safetensors";
const SLOTS: &str = "slots.safetensors";
const STATE: &str = "state.json";
const BEST: &str = "best.safetensors";
/// The name of a checkpoint's folder begins with it; their order is that of their steps.
const STEP: &str = "step_";
/// Checkpoints that are kept.
const KEPT: usize = 2;

/// The parts of one checkpoint.
struct CheckpointParts {
    state: RunState,
    weights: NamedTensors,
    slots: NamedTensors,
}

impl Store {
    /// Of the run in this folder.
    pub fn new(run: &Path) -> Self {
        Store { run: run.to_path_buf() }
    }

    fn folder(&self) -> PathBuf {
        self.run.join(CHECKPOINTS)
    }

    /// Checksum of the run's config.toml; empty where there is none.
    ///
    /// # Errors
    /// A config that cannot be read.
    pub(crate) fn config_checksum(&self) -> Result<String> {
        let path = self.run.join(CONFIG);
        if !path.exists() {
            return Ok(String::new());
        }
        let text = storage::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        Ok(checksum(&text))
    }

    /// Checks that weights, of this checksum of a config, are of this run; those of earlier versions have none.
    fn check_run(&self, weights: &Path, config: &str) -> Result<()> {
        ensure!(
            config.is_empty() || config == self.config_checksum()?,
            "{} and {} are of different runs, or the config was edited; put them back as they were",
            weights.display(),
            self.run.join(CONFIG).display()
        );
        Ok(())
    }

    /// Saves a checkpoint with all variables of a model, and removes those before the one before it. The lengths of the logs are
    /// written into the state.
    ///
    /// # Errors
    /// A full disk; the earlier checkpoints stay as they are. A variable that is not finite.
    pub fn save(&self, weights: &[(String, Tensor)], slots: &[(String, Tensor)], state: &mut RunState) -> Result<()> {
        let _guard = tch::no_grad_guard();
        [state.log_bytes, state.metrics_bytes] = [self.synced_length(LOG)?, self.synced_length(METRICS)?];
        state.metrics = checksum_of_course(&self.recorded(state.metrics_bytes)?);
        state.format = FORMAT;
        ensure_finite(weights, state.steps)?;
        let folder = self.folder();
        let last = format!("{STEP}{:08}_phase_{}", state.steps, state.phase);
        let path = folder.join(&last);
        make_folder(&folder)?;
        // A damaged one that the run went back behind.
        if path.exists() {
            storage().remove_folder(&path).with_context(|| format!("cannot replace {}", path.display()))?;
        }
        let [weights, slots] = [weights::to_bytes(weights, &self.config_checksum()?)?, weights::to_bytes(slots, "")?];
        [state.weights, state.slots] = [&weights, &slots].map(|bytes| checksum(bytes));
        let text = state.to_json()?;
        atomic::write_folder(&path, |folder| {
            for (name, bytes) in [(WEIGHTS, &weights), (SLOTS, &slots)] {
                atomic::write_file(&folder.join(name), |file| Ok(file.write_all(bytes)?))?;
            }
            atomic::write_file(&folder.join(STATE), |file| Ok(file.write_all(&text)?))
        })?;
        let index = CheckpointIndex { format: FORMAT, last };
        atomic::write_file(&folder.join(INDEX), |file| Ok(serde_json::to_writer_pretty(file, &index)?))?;
        remove_others(&folder, &index)
    }

    /// Keeps the weights beside the checkpoints, in the place of those that were the best of a phase before.
    ///
    /// # Errors
    /// A full disk; the earlier ones stay. A variable that is not finite.
    pub(crate) fn save_best(&self, weights: &[(String, Tensor)], steps: u64, of: BestOf) -> Result<()> {
        let _guard = tch::no_grad_guard();
        ensure_finite(weights, steps)?;
        make_folder(&self.folder())?;
        weights::write_of_run(&self.best(of), weights, &self.config_checksum()?)
    }

    /// Gives the variables of a model the weights that `save_best` kept last.
    ///
    /// # Errors
    /// A file that is missing or damaged.
    pub fn load_best(&self, variables: NamedTensors, of: BestOf) -> Result<()> {
        let path = self.best(of);
        self.check_run(&path, &weights::run_of(&path)?)?;
        weights::load_into(&path, variables)
    }

    /// Each phase has a file of its own: a run that goes back to an earlier checkpoint may go back to an earlier phase.
    fn best(&self, of: BestOf) -> PathBuf {
        match of {
            BestOf::LastPhase => self.folder().join(BEST),
            BestOf::Earlier(phase) => self.folder().join(format!("best_{phase}.safetensors")),
        }
    }

    /// Loads the last checkpoint that is whole, if there is any, into the variables of a model, and cuts off what was logged
    /// after it.
    ///
    /// # Errors
    /// Checkpoints that are all damaged; one of another task or of a config that was changed since, or whose variables
    /// differ from the model's in name, shape or type; files that cannot be read.
    pub fn load(&self, variables: NamedTensors, task: &str) -> Result<Option<Loaded>> {
        let folder = self.folder();
        let names = names(&folder)?;
        if names.is_empty() {
            let index = folder.join(INDEX);
            ensure!(!index.exists(), "{} names a checkpoint that is not there; {ADVICE}", index.display());
            self.shorten([(LOG, 0), (METRICS, 0)])?;
            return Ok(None);
        }
        let mut damage = Vec::new();
        for name in names {
            let path = folder.join(&name);
            let CheckpointParts { state, weights, slots } = match read_parts(&path)? {
                Ok(parts) => parts,
                Err(error) => {
                    damage.push(format!("checkpoint {}: {error:#}", path.display()));
                    continue;
                }
            };
            ensure!(state.task == task, "checkpoint {} is of task {}, not of {task}", path.display(), state.task);
            self.check_config(&state)?;
            weights::fill(variables, &weights).with_context(|| path.join(WEIGHTS).display().to_string())?;
            self.check_metrics(&state)?;
            self.shorten([(LOG, state.log_bytes), (METRICS, state.metrics_bytes)])?;
            let damaged = (!damage.is_empty()).then(|| damage.join("; "));
            return Ok(Some(Loaded { name, state, slots, damaged }));
        }
        Err(Error::new(error::ErrorKind::Corrupt, anyhow!("{}; {ADVICE}", damage.join("; "))).into())
    }

    /// A run goes on with what it was begun with.
    fn check_config(&self, state: &RunState) -> Result<()> {
        ensure!(
            state.config.is_empty() || state.config == self.config_checksum()?,
            "{} was edited after the run had begun, and is not what the checkpoints were made with; put it back as it was, \
             or begin another run in another folder",
            self.run.join(CONFIG).display()
        );
        Ok(())
    }

    /// Checks, before a run goes on, that its config and these data are those of its last checkpoint. A checkpoint that cannot be
    /// read is left to [`Store::load`], which may have an earlier one.
    ///
    /// # Errors
    /// An edited config, other data.
    pub(crate) fn check_begun_with(&self, data: &DataChecksums) -> Result<()> {
        let last = find_weights(&self.run, SavedWeights::Last).and_then(|weights| state_beside(&weights));
        let Ok(Some(state)) = last else { return Ok(()) };
        self.check_config(&state)?;
        data.ensure_are(&state.data())
    }

    /// What was recorded until the checkpoint will be read at the end of the run; what comes after it is cut off.
    fn check_metrics(&self, state: &RunState) -> Result<()> {
        let path = self.run.join(METRICS);
        let bytes = match storage::read(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            read => read.with_context(|| format!("cannot read {}", path.display()))?,
        };
        let advice =
            "the run cannot go on: its plots and reports are made of that file; put it back from a copy, or remove it";
        let recorded = bytes.get(..state.metrics_bytes as usize).with_context(|| {
            format!(
                "{} was cut off: it has {} bytes, at the checkpoint it had {}; {advice}",
                path.display(),
                bytes.len(),
                state.metrics_bytes
            )
        })?;
        super::metrics::parse(recorded)
            .with_context(|| path.display().to_string())
            .and_then(|_| self.check_course(state, recorded))
            .context(advice)
    }

    /// Checks that metrics.jsonl is the run's own, as far as its last checkpoint says so.
    ///
    /// # Errors
    /// Records of another run, or that cannot be read.
    pub(super) fn check_recorded(&self) -> Result<()> {
        let Some(last) = names(&self.folder())?.into_iter().next() else { return Ok(()) };
        // A damaged checkpoint says nothing of the records.
        let Some(state) = state_beside(&self.folder().join(last).join(WEIGHTS)).ok().flatten() else { return Ok(()) };
        self.check_course(&state, &self.recorded(state.metrics_bytes)?)
    }

    fn check_course(&self, state: &RunState, recorded: &[u8]) -> Result<()> {
        ensure!(
            state.metrics.is_empty() || state.metrics == checksum_of_course(recorded),
            "{} is of another run, or was edited",
            self.run.join(METRICS).display()
        );
        Ok(())
    }

    /// The first bytes of metrics.jsonl, as many as there are of these.
    fn recorded(&self, bytes: u64) -> Result<Vec<u8>> {
        if bytes == 0 {
            return Ok(Vec::new());
        }
        let path = self.run.join(METRICS);
        let mut all = storage::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        all.truncate(bytes as usize);
        Ok(all)
    }

    /// Length of a log in bytes, once on the disk.
    fn synced_length(&self, name: &str) -> Result<u64> {
        let path = self.run.join(name);
        let length = || match fs::metadata(&path) {
            Ok(file) => {
                storage().sync(&path)?;
                Ok(file.len())
            }
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(0),
            Err(error) => Err(error),
        };
        length().with_context(|| format!("cannot write {}", path.display()))
    }

    /// Cuts logs off at these lengths. One that was deleted stays short: what it held is lost, the run is not.
    fn shorten(&self, lengths: [(&str, u64); 2]) -> Result<()> {
        for (name, length) in lengths {
            let path = self.run.join(name);
            match storage().shorten(&path, length) {
                Err(error) if error.kind() != ErrorKind::NotFound => {
                    return Err(error).with_context(|| format!("cannot shorten {}", path.display()));
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// Empty where nothing is recorded.
fn checksum_of_course(recorded: &[u8]) -> String {
    if recorded.is_empty() { String::new() } else { checksum(recorded) }
}

fn ensure_finite(weights: &[(String, Tensor)], steps: u64) -> Result<()> {
    match first_not_finite(weights) {
        Some(name) => bail!("variable {name} is not finite after step {steps}; nothing was saved"),
        None => Ok(()),
    }
}

fn make_folder(folder: &Path) -> Result<()> {
    storage().create_folder(folder).with_context(|| format!("cannot create {}", folder.display()))
}

/// The checkpoints of a folder, the last one first; none where the folder is not there.
fn names(folder: &Path) -> Result<Vec<String>> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.with_context(|| format!("cannot list {}", folder.display()))?,
    };
    let mut names = Vec::new();
    for entry in entries {
        let name = entry.with_context(|| format!("cannot list {}", folder.display()))?.file_name();
        if !atomic::is_partial(&name) {
            names.extend(name.into_string().ok().filter(|name| name.starts_with(STEP)));
        }
    }
    names.sort_by(|a, b| b.cmp(a));
    Ok(names)
}

/// A checkpoint, or what is damaged in it.
///
/// # Errors
/// A file that is there and cannot be read, too little memory.
fn read_parts(path: &Path) -> Result<Result<CheckpointParts>> {
    let mut files = Vec::new();
    for name in [STATE, WEIGHTS, SLOTS] {
        match storage::read(&path.join(name)) {
            Ok(bytes) => files.push(bytes),
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Err(anyhow!("{name} is missing"))),
            Err(error) => return Err(error).with_context(|| format!("cannot read {}", path.join(name).display())),
        }
    }
    let parts = || {
        let state = RunState::from_json(&files[0]).context(STATE)?;
        let tensors = |bytes: &[u8]| {
            let saved = weights::parse(bytes)?;
            ensure!(
                saved.checked || state.format < FORMAT_WITH_CHECKSUMS,
                "it is not what was saved there: it has no checksum"
            );
            Ok(saved.tensors)
        };
        let (weights, slots) = (tensors(&files[1]).context(WEIGHTS)?, tensors(&files[2]).context(SLOTS)?);
        for (name, bytes, known) in [(WEIGHTS, &files[1], &state.weights), (SLOTS, &files[2], &state.slots)] {
            let same = known.is_empty() || *known == checksum(bytes);
            ensure!(same, "{name}: it is not what was saved there, or damaged: its checksum does not fit");
        }
        Ok(CheckpointParts { state, weights, slots })
    };
    Ok(parts())
}

/// Checksums of what a run learns from and is scored on; each is empty where it is not known.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct DataChecksums {
    /// Of the clips.
    pub clips: String,
    /// Of the film beside them.
    pub film: String,
    /// Of the test clips.
    pub test: String,
}

impl DataChecksums {
    /// Whether clips, film and test clips are those of before, as far as both are known.
    pub fn is_as(&self, before: &DataChecksums) -> [bool; 3] {
        let known = |now: &str, before: &str| !now.is_empty() && !before.is_empty();
        let same = |now: &str, before: &str| !known(now, before) || now == before;
        let clips = !known(&self.clips, &before.clips) || are_the_same(&self.clips, &before.clips);
        [clips, same(&self.film, &before.film), same(&self.test, &before.test)]
    }

    /// Checks that a run may go on with these.
    ///
    /// # Errors
    /// Other clips, another film or other test clips than before.
    pub fn ensure_are(&self, before: &DataChecksums) -> Result<()> {
        let names =
            ["the clips are not those", "the film beside the clips is not the one", "the test clips are not those"];
        for (same, what) in self.is_as(before).into_iter().zip(names) {
            ensure!(
                same,
                "{what} that the run was begun with; put back what was there, or begin another run in another folder"
            );
        }
        Ok(())
    }

    /// As the last checkpoint of a run has them.
    ///
    /// # Errors
    /// A folder without checkpoint, or whose last one is damaged.
    pub fn of_run(run: &Path) -> Result<Self> {
        let weights = find_weights(run, SavedWeights::Last)?;
        let state = state_beside(&weights)?;
        Ok(state.map_or_else(Self::default, |state| state.data()))
    }
}

/// The state in the checkpoint of a weights file; none where the file stands alone.
fn state_beside(weights: &Path) -> Result<Option<RunState>> {
    let path = weights.with_file_name(STATE);
    if weights.file_name().is_none_or(|name| name != WEIGHTS) || !path.exists() {
        return Ok(None);
    }
    let read = || RunState::from_json(&storage::read(&path)?);
    read().map(Some).with_context(|| format!("{}; {ADVICE}", path.display()))
}

/// Finds the weights of a run as [`find_weights`], and checks that they are its own: of its config, and what the checkpoint was saved
/// with. Weights of earlier versions have no checksums, and those of a file or of a checkpoint alone no config.
///
/// # Errors
/// As for [`find_weights`]; weights or a config of another run, or that were edited since.
pub fn find_own_weights(path: &Path, which: SavedWeights) -> Result<PathBuf> {
    let weights = find_weights(path, which)?;
    let of_run = path.join(CONFIG).exists().then(|| Store::new(path));
    match state_beside(&weights)? {
        Some(state) => {
            let bytes = storage::read(&weights).with_context(|| format!("cannot read {}", weights.display()))?;
            ensure!(
                state.weights.is_empty() || state.weights == checksum(&bytes),
                "{} is not what was saved there, or damaged: its checksum does not fit; {ADVICE}",
                weights.display()
            );
            of_run.iter().try_for_each(|store| store.check_config(&state))?;
        }
        None => {
            let config = weights::run_of(&weights)?;
            of_run.iter().try_for_each(|store| store.check_run(&weights, &config))?;
        }
    }
    Ok(weights)
}

/// Checksum of a file, as states have it.
pub fn checksum(bytes: &[u8]) -> String {
    format!("{:016x}", fnv1a(bytes))
}

/// The weights file of a run folder, of a checkpoint folder, or the file itself.
///
/// # Errors
/// A path that is none of these; a run that has not come to its last phase has no best weights.
pub fn find_weights(path: &Path, which: SavedWeights) -> Result<PathBuf> {
    if path.is_file() {
        return Ok(path.to_path_buf());
    }
    if which == SavedWeights::Best {
        let best = path.join(CHECKPOINTS).join(BEST);
        ensure!(best.exists(), "{}: there are no best weights; the last phase has not begun", path.display());
        return Ok(best);
    }
    for folder in [path.to_path_buf(), path.join(CHECKPOINTS)] {
        if folder.join(WEIGHTS).exists() {
            return Ok(folder.join(WEIGHTS));
        }
        if let Some(last) = names(&folder)?.first() {
            return Ok(folder.join(last).join(WEIGHTS));
        }
    }
    ensure!(
        !path.join(CONFIG).exists(),
        "{}: a run without a checkpoint: it has not saved one yet, or only its records are kept here",
        path.display()
    );
    bail!("{}: neither a run folder, nor a checkpoint, nor a weights file", path.display())
}

/// Removes all checkpoints but the last ones, and those that a run went back behind.
fn remove_others(folder: &Path, index: &CheckpointIndex) -> Result<()> {
    let names = names(folder)?;
    let (later, kept): (Vec<_>, Vec<_>) = names.into_iter().partition(|name| *name > index.last);
    for name in later.iter().chain(kept.iter().skip(KEPT)) {
        let path = folder.join(name);
        storage().remove_folder(&path).with_context(|| format!("cannot remove {}", path.display()))?;
    }
    Ok(())
}
