//! The suite's report: results.json, a page with the matrix, and a picture of each scene.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use image::ImageFormat;
use image::imageops::FilterType;

use super::list::StressList;
use super::matrix::SceneOutcome;
use paig::network::physics_models::losses::Loss;
use paig::runs::run::StoredRun;
use paig::support::output::FileSet;
use paig::support::storage::storage;
use paig::support::{atomic, json_lines, picture_file};

/// The report's files.
const RESULTS: &str = "results.json";
const PAGE: &str = "report.md";
const PICTURES: &str = "scenes";
const TITLE: &str = "# Scenes unlike the paper's";
/// The files of the report. The page comes last: it shows whose the others are.
pub const FILES: FileSet = FileSet {
    name: "the suite's report",
    files: &[PICTURES, RESULTS, PAGE],
    recognizes: |page| page.starts_with(TITLE.as_bytes()),
};
/// Of a run's example picture this share of the width, drawn at this share of its size.
const SHOWN: f64 = 0.38;
const SCALE: f64 = 0.4;

/// Writes the report of these outcomes into a folder; `pictured` is a run of each scene, none of a report without pictures.
///
/// # Errors
/// A folder that cannot be written.
pub(super) fn write(
    out: &Path,
    list: &StressList,
    outcomes: &[SceneOutcome],
    pictured: Option<&BTreeMap<String, StoredRun>>,
) -> Result<()> {
    FILES.replace(out, |out| {
        let pictures = out.join(PICTURES);
        storage().create_folder(&pictures).with_context(|| format!("cannot create {}", pictures.display()))?;
        for (scene, run) in pictured.into_iter().flatten() {
            picture(&run.folder.join("example0.png"), &pictures.join(format!("{scene}.png")))?;
        }
        atomic::write_file(&out.join(RESULTS), |file| Ok(json_lines::write(file, &outcomes, 1)?))?;
        let text = page(list, outcomes, &|scene| pictures.join(format!("{scene}.png")).exists());
        atomic::write_file(&out.join(PAGE), |file| Ok(std::io::Write::write_all(file, text.as_bytes())?))
    })
}

/// The beginning of an example: input and prediction, truth, reconstruction.
fn picture(from: &Path, to: &Path) -> Result<()> {
    if !from.exists() {
        return Ok(());
    }
    let example = picture_file::read(from)?;
    let (width, height) = (example.width(), example.height());
    let shown = example.crop_imm(0, 0, (f64::from(width) * SHOWN) as u32, height);
    let size = |length: u32| ((f64::from(length) * SCALE) as u32).max(1);
    let shown = shown.resize_exact(size(shown.width()), size(height), FilterType::Triangle);
    atomic::write_file(to, |file| Ok(shown.write_to(&mut std::io::BufWriter::new(file), ImageFormat::Png)?))
}

fn page(list: &StressList, outcomes: &[SceneOutcome], has_picture: &dyn Fn(&str) -> bool) -> String {
    let mut page = String::new();
    let succeeded = outcomes.iter().filter(|outcome| outcome.succeeded).count();
    let systems: Vec<String> = list.systems().into_iter().map(|(task, scenes)| format!("{task} {scenes}")).collect();
    let _ = writeln!(
        page,
        "{TITLE}\n\nMade by `make stress`. {} scenes ({}), {} of which have runs, each with \
         the plain `fast` recipe: no key is changed for a scene. A run succeeds within the limits of the plain task, \
         those of losses in proportion to the number of objects; where noise sets a floor, a loss may be 1.1 floors \
         larger. *Found* is the run's own verdict, made without the \
         truth.\n\n\
         **{succeeded} of {} runs succeeded.** {}{}\n",
        list.scenes.len(),
        systems.join(", "),
        outcomes.iter().map(|outcome| &outcome.scene).collect::<BTreeSet<_>>().len(),
        outcomes.len(),
        without_results(outcomes),
        agreement(outcomes)
    );
    let _ = writeln!(
        page,
        "| scene | runs | succeeded | found | parameters (worst error) | L_rec | L_pred | L_extrap | noise floors | \
         seconds | missed |\n\
         |---|---|---|---|---|---|---|---|---|---|---|"
    );
    for scene in &list.scenes {
        let runs: Vec<&SceneOutcome> = outcomes.iter().filter(|outcome| outcome.scene == scene.name).collect();
        let count = |holds: fn(&SceneOutcome) -> bool| runs.iter().filter(|outcome| holds(outcome)).count();
        let range = |number: fn(&SceneOutcome) -> Option<f64>| range(runs.iter().filter_map(|outcome| number(outcome)));
        let floor = runs.iter().find_map(|outcome| outcome.noise_floor);
        let mut missed: Vec<&str> = runs.iter().flat_map(|outcome| &outcome.missed).map(String::as_str).collect();
        missed.sort_unstable();
        missed.dedup();
        let _ = writeln!(
            page,
            "| {} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |",
            scene.name,
            runs.len(),
            count(|outcome| outcome.succeeded),
            count(|outcome| outcome.found),
            worst_errors(&runs),
            range(|outcome| outcome.recons_loss),
            range(|outcome| outcome.pred_loss),
            range(|outcome| outcome.extrap_loss),
            floor.map_or("-".into(), |floor| Loss::ALL.map(|loss| format!("{:.2}", floor.of(loss))).join(" / ")),
            range(|outcome| outcome.seconds.map(f64::round)),
            missed.join(", ")
        );
    }
    let disagree: Vec<&SceneOutcome> = outcomes.iter().filter(|outcome| outcome.found != outcome.succeeded).collect();
    page.push_str("\n## Where the verdict is wrong\n\n");
    if disagree.is_empty() {
        page.push_str("Nowhere.\n");
    }
    for outcome in disagree {
        let SceneOutcome { scene, data_seed, seed, missed, failed_checks, .. } = outcome;
        let _ = if outcome.found {
            writeln!(
                page,
                "- miss: {scene}, data {data_seed}, seed {seed}: found, yet beyond the limit of {}",
                missed.join(", ")
            )
        } else {
            writeln!(page, "- false alarm: {scene}, data {data_seed}, seed {seed}: {} failed", failed_checks.join(", "))
        };
    }
    let pictured: Vec<_> = list.scenes.iter().filter(|scene| has_picture(&scene.name)).collect();
    page.push_str("\n## The scenes\n\n");
    page.push_str(match pictured.is_empty() {
        false => "Of each its first run: input and prediction, truth, reconstruction.\n",
        true => "`stress --report-only` with these data seeds draws the first run of each.\n",
    });
    for scene in pictured {
        let _ = writeln!(page, "\n**{}**\n\n![{}]({PICTURES}/{}.png)", scene.name, scene.name, scene.name);
    }
    page
}

/// How many of the runs that count have no results.
fn without_results(outcomes: &[SceneOutcome]) -> String {
    match outcomes.iter().filter(|outcome| !outcome.finished).count() {
        0 => String::new(),
        count => format!("Without results, since they have not finished or cannot be read: {count}. "),
    }
}

/// How often the verdict of a finished run agrees with the truth.
fn agreement(outcomes: &[SceneOutcome]) -> String {
    let finished: Vec<&SceneOutcome> = outcomes.iter().filter(|outcome| outcome.finished).collect();
    let count = |found: bool, succeeded: bool| {
        finished.iter().filter(|outcome| outcome.found == found && outcome.succeeded == succeeded).count()
    };
    let right = count(true, true) + count(false, false);
    format!(
        "The verdict was right on {right} of {}: {} false alarms, {} misses.",
        finished.len(),
        count(false, true),
        count(true, false)
    )
}

/// The error of each parameter that is farthest from its truth.
fn worst_errors(runs: &[&SceneOutcome]) -> String {
    let mut worst: BTreeMap<&str, f64> = BTreeMap::new();
    for (name, learned) in runs.iter().flat_map(|outcome| &outcome.parameters) {
        let Some(error) = learned.error_percent() else { continue };
        let known = worst.entry(name).or_insert(error);
        if error.abs() > known.abs() {
            *known = error;
        }
    }
    let texts: Vec<String> = worst.into_iter().map(|(name, error)| format!("{name} {error:+.2} %")).collect();
    if texts.is_empty() { "-".into() } else { texts.join(", ") }
}

fn range(values: impl Iterator<Item = f64>) -> String {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    let text = |x: f64| if x >= 100.0 { format!("{x:.0}") } else { format!("{x:.2}") };
    match low.total_cmp(&high) {
        std::cmp::Ordering::Greater => "-".into(),
        std::cmp::Ordering::Equal => text(low),
        std::cmp::Ordering::Less => format!("{} to {}", text(low), text(high)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stress::outcome;

    #[test]
    fn a_run_without_results_counts_as_one_that_did_not_succeed() {
        let folder = tempfile::tempdir().unwrap();
        let list =
            StressList::read(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/stress.toml"))).unwrap();
        let scene = &list.scenes[0];
        // As a run leaves it that is killed while its data are read.
        let place = folder.path().join("data=1").join(&scene.task.name).join("fast/seed=1");
        std::fs::create_dir_all(&place).unwrap();
        std::fs::write(place.join("output.log"), "").unwrap();
        let runs = scene.runs(Path::new("data"), folder.path(), 1).unwrap();
        let [(1, run)] = &runs[..] else { panic!("{runs:?}") };
        let failed = outcome(scene, 1, 1, run).unwrap();
        let well = SceneOutcome { finished: true, succeeded: true, found: true, missed: Vec::new(), ..failed.clone() };
        let well = SceneOutcome { data_seed: 2, recons_loss: Some(0.1), ..well };
        let page = page(&list, &[failed, well], &|_| false);
        for line in [
            "**1 of 2 runs succeeded.** Without results, since they have not finished or cannot be read: 1. The verdict was \
             right on 1 of 1: 0 false alarms, 0 misses.",
            "`stress --report-only` with these data seeds draws the first run of each.",
            &format!("| {} | 2 | 1 | 1 | - | 0.10 | - | - | - | - | unreadable |", scene.name),
        ] {
            assert!(page.contains(line), "{line:?} is not in:\n{page}");
        }
    }
}
