//! A study: many experiments, played after each other, with their results in one file.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::Deserialize;

use super::experiment::{Experiment, ExperimentEvent, ExperimentWatch};
use super::figures;
use super::results::{ControlResults, FORMAT, PlannerRow};
use paig::Error;
use paig::support::storage;

/// One experiment of a study.
#[derive(Debug, Clone, PartialEq)]
pub struct StudyLine {
    /// Folder of its pictures, in that of the results.
    pub name: String,
    /// Its settings as the file has them. Earlier results with the same settings may be taken over.
    pub arguments: String,
    pub experiment: Experiment,
}

/// What happens in a study.
#[derive(Debug)]
pub enum StudyEvent<'a> {
    /// A line begins, by its name.
    Begins(&'a str),
    /// Its rows are those of an earlier run of the study.
    TakenOver,
    Experiment(ExperimentEvent<'a>),
}

/// A study's file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StudyFile {
    play: Vec<Play>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Play {
    name: String,
    arguments: String,
}

/// Reads a study; `parse` reads the settings of a line.
///
/// # Errors
/// A file that cannot be read or holds no study, settings that `parse` refuses.
pub fn read(path: &Path, parse: &dyn Fn(&str) -> Result<Experiment>) -> Result<Vec<StudyLine>> {
    let text = storage::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    let file: StudyFile = toml::from_str(&text).with_context(|| format!("{}", path.display()))?;
    let line = |Play { name, arguments }| {
        let experiment = parse(&arguments).with_context(|| format!("{}: {name}", path.display()))?;
        Ok(StudyLine { name, arguments, experiment })
    };
    file.play.into_iter().map(line).collect()
}

/// Plays the lines of a study, each into a folder of its own in `out`; with `take_over`, not those whose results are there.
/// Returns the rows of all; none where it was stopped.
///
/// # Errors
/// As for [`Experiment::run`], with the line's name; results that cannot be read or written.
pub fn play(
    lines: &[StudyLine],
    out: &Path,
    take_over: bool,
    observe: &dyn Fn(StudyEvent),
    stop: &dyn Fn() -> bool,
) -> Result<Option<Vec<PlannerRow>>, Error> {
    ControlResults::claim(out)?;
    let mut rows = Vec::new();
    for StudyLine { name, arguments, experiment } in lines {
        observe(StudyEvent::Begins(name));
        let path = out.join(name).join(ControlResults::FILE);
        if let Some(before) = take_over.then(|| taken_over(&path, arguments)).transpose()?.flatten() {
            observe(StudyEvent::TakenOver);
            rows.extend(before);
            continue;
        }
        let watch = ExperimentWatch { observe: &|event| observe(StudyEvent::Experiment(event)), stop };
        let played = experiment.run(&out.join(name), watch).with_context(|| name.clone())?;
        let Some(played) = played else { return Ok(None) };
        let results = ControlResults { format: FORMAT, line: Some(arguments.clone()), rows: played };
        results.write(&path).map_err(Error::of_work)?;
        rows.extend(results.rows);
    }
    Ok(Some(rows))
}

/// The rows of earlier results with these settings, if there are any.
fn taken_over(path: &Path, arguments: &String) -> Result<Option<Vec<PlannerRow>>> {
    if !path.exists() {
        return Ok(None);
    }
    let before = ControlResults::read(path)?;
    Ok((before.line.as_ref() == Some(arguments)).then_some(before.rows))
}

/// Writes the rows of an experiment or a study into `out`, and the figure of them. Returns the file.
///
/// # Errors
/// Files that cannot be written.
pub fn write(out: &Path, rows: Vec<PlannerRow>) -> Result<PathBuf, Error> {
    written(out, rows).map_err(Error::of_work)
}

fn written(out: &Path, rows: Vec<PlannerRow>) -> Result<PathBuf> {
    figures::write_clips(&out.join("clips.png"), &rows)?;
    let path = out.join(ControlResults::FILE);
    ControlResults { format: FORMAT, line: None, rows }.write(&path)?;
    Ok(path)
}
