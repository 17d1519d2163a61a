//! The report's pictures: plots over all seeds, and those that single runs made.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::Serialize;

use super::criteria::{Status, status};
use super::groups::{GroupRole, RunGroup};
use super::plots;
use super::records;
use paig::runs::run::StoredRun;
use paig::support::storage::storage;
use paig::viz::{self, CHART_HEIGHT, chart};

/// The folder of what is drawn here, in that of the report.
pub(super) const FOLDER: &str = "pictures";
/// What is shown of a run, as far as it made it.
const OF_RUN: [&str; 4] = ["example0", "example1", "templates", "encoder_masks"];

/// Whether a report has pictures. One without is small: its page and its numbers stand for themselves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WithPictures {
    Shown,
    LeftOut,
}

/// A picture by its name, with its place relative to the report.
#[derive(Debug, Serialize)]
pub(super) struct ReportPicture {
    name: &'static str,
    path: String,
}

/// The pictures of a group. One that differs from the recipe shows its parameters alone, or its losses if it has none.
#[derive(Debug, Default, Serialize)]
pub(super) struct GroupPictures {
    /// Over all seeds: losses, parameters, scores of the predicted frames.
    seeds: Vec<ReportPicture>,
    /// Of the shown runs, each with its pictures in the order of the paper's figures.
    runs: Vec<(u64, Status, Vec<ReportPicture>)>,
}

/// Draws the pictures of each group into their folder in `out` and copies those of single runs to their records (`places`).
/// Without pictures the folder is empty: it replaces that of an earlier report.
pub(super) fn write(
    out: &Path,
    groups: &[RunGroup],
    places: &[Vec<PathBuf>],
    shown: WithPictures,
) -> Result<Vec<GroupPictures>> {
    let folder = out.join(FOLDER);
    storage().create_folder(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    if shown == WithPictures::LeftOut {
        return Ok(groups.iter().map(|_| GroupPictures::default()).collect());
    }
    let groups = groups.iter().zip(places).enumerate();
    groups.map(|(number, (group, places))| of_group(out, number, group, places)).collect()
}

fn of_group(out: &Path, number: usize, group: &RunGroup, places: &[PathBuf]) -> Result<GroupPictures> {
    let plain = group.role() == GroupRole::Plain;
    let mut plots = vec![("parameters", plots::parameters(group))];
    if plain || group.learned().next().is_none() {
        plots.insert(0, ("losses", plots::losses(group)));
    }
    if plain {
        plots.push(("frames", viz::frame_charts(&group.task, &group.frames())));
    }
    let mut pictures = GroupPictures::default();
    for (name, charts) in plots {
        let path = format!("{FOLDER}/{number}-{}-{name}.png", group.task.name);
        if chart::write(&out.join(&path), CHART_HEIGHT, charts)? {
            pictures.seeds.push(ReportPicture { name, path });
        }
    }
    if !plain {
        return Ok(pictures);
    }
    // The first of each kind in the order of the seeds: no choice by looks.
    for kind in [Status::Succeeded, Status::Missed, Status::Unjudged] {
        if let Some((run, place)) = group.runs.iter().zip(places).find(|(run, _)| status(run) == kind) {
            let copied = of_run(out, place, run)?;
            pictures.runs.extend((!copied.is_empty()).then_some((run.config.seed, kind, copied)));
        }
    }
    Ok(pictures)
}

/// Copies what a run left into `out/place`; pictures that it did not make, or that cannot be read, are left out.
fn of_run(out: &Path, place: &Path, run: &StoredRun) -> Result<Vec<ReportPicture>> {
    let mut copied = Vec::new();
    for name in OF_RUN {
        let file = format!("{name}.png");
        let path = place.join(&file);
        if records::copy(&run.folder.join(&file), &out.join(&path))? {
            copied.push(ReportPicture { name, path: path.display().to_string() });
        }
    }
    Ok(copied)
}
