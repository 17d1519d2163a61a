//! The report's pictures: plots over all seeds, and those that single runs made.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::frames;
use super::groups::{Group, Purpose};
use super::records;
use super::runs::Run;
use crate::viz::seeds::{self, Outcome, Trace};

/// The folder of what is drawn here, in that of the report.
pub(super) const FOLDER: &str = "pictures";
/// Examples shown of a run.
const EXAMPLES: usize = 2;

/// One picture, with its place relative to the report.
#[derive(Debug)]
pub(super) struct Picture {
    pub caption: String,
    pub path: String,
}

/// The pictures of a group. One that differs from the recipe shows its parameters alone, or its losses if it has none.
#[derive(Debug, Default)]
pub(super) struct Pictures {
    /// Over all seeds: losses, parameters, scores of the predicted frames.
    pub seeds: Vec<Picture>,
    /// Of the shown runs, each with its pictures in the order of the paper's figures.
    pub runs: Vec<(String, Vec<Picture>)>,
}

/// Draws the pictures of each group into their folder in `out` and copies those of single runs to their records (`places`).
pub(super) fn write(out: &Path, groups: &[Group], places: &[Vec<PathBuf>]) -> Result<Vec<Pictures>> {
    let folder = out.join(FOLDER);
    fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let groups = groups.iter().zip(places).enumerate();
    groups
        .map(|(number, (group, places))| of_group(out, &format!("{FOLDER}/{number}-{}", group.task.key), group, places))
        .collect()
}

fn of_group(out: &Path, prefix: &str, group: &Group, places: &[PathBuf]) -> Result<Pictures> {
    let traces: Vec<(Outcome, &Trace)> =
        group.runs.iter().filter_map(|run| Some((run.outcome(), run.trace.as_ref().ok()?))).collect();
    let mut pictures = Pictures::default();
    let mut add = |name: &str, caption: &str, draw: &dyn Fn(&Path) -> Result<bool>| -> Result<()> {
        let path = format!("{prefix}-{name}.png");
        if draw(&out.join(&path))? {
            pictures.seeds.push(Picture { caption: caption.into(), path });
        }
        Ok(())
    };
    let plain = group.purpose() == Purpose::Plain;
    if plain || group.parameters().is_empty() {
        add("losses", "validation losses of all seeds", &|path| seeds::write_losses(path, group.task, &traces))?;
    }
    add("parameters", "physical parameters of all seeds", &|path| seeds::write_parameters(path, group.task, &traces))?;
    if !plain {
        return Ok(pictures);
    }
    let caption =
        "SSIM and squared error of every predicted test frame, input | T_pred | T_ext, over all finished seeds";
    let scores = frames::of(group);
    add("frames", caption, &|path| frames::draw(path, group.task, &scores))?;
    // The first of each kind in the order of the seeds: no choice by looks.
    for (outcome, word) in [(Outcome::Succeeded, "that succeeded"), (Outcome::Missed, "that missed the criterion")] {
        if let Some((run, place)) = group.runs.iter().zip(places).find(|(run, _)| run.outcome() == outcome) {
            let title = format!("Seed {}, the first one {word}", run.config.seed);
            let copied = of_run(out, place, run)?;
            if !copied.is_empty() {
                pictures.runs.push((title, copied));
            }
        }
    }
    Ok(pictures)
}

/// Copies what a run left into `out/place`; pictures that it did not make are left out.
fn of_run(out: &Path, place: &Path, run: &Run) -> Result<Vec<Picture>> {
    let examples = (0..EXAMPLES).map(|clip| {
        (format!("example{clip}.png"), format!("test clip {clip}: input and prediction, truth, reconstruction"))
    });
    let others = [
        ("templates.png", "learned contents and masks of the decoder, and the background"),
        ("encoder_masks.png", "the encoder's masks"),
    ];
    let others = others.map(|(name, caption)| (name.to_string(), caption.to_string()));
    let mut copied = Vec::new();
    for (name, caption) in examples.chain(others) {
        let path = place.join(&name);
        if records::copy(&run.folder.join(&name), &out.join(&path))? {
            copied.push(Picture { caption, path: path.display().to_string() });
        }
    }
    Ok(copied)
}
