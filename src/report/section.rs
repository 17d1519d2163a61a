//! The section of one group: its seeds, pictures, times, and the commands that make it again.

use std::collections::BTreeSet;
use std::fmt::Write;

use anyhow::Result;

use super::criteria;
use super::frames;
use super::groups::Group;
use super::markdown::{NONE, code, duration, minutes, percent, row, show, table, text};
use super::pictures::Pictures;
use super::reproduce;
use super::reproducible;
use super::runs::{Loss, Run, Summary};
use super::statistics::significant;
use crate::viz::seeds::Outcome;

pub(super) fn write(page: &mut String, group: &Group, pictures: &Pictures) -> Result<()> {
    writeln!(page, "## {}, {}\n", text(group.task.key), text(&group.label))?;
    writeln!(page, "{} of {} seeds succeeded.", group.count(Outcome::Succeeded), group.runs.len())?;
    let cut_off = group.count(Outcome::Unfinished);
    if cut_off > 0 {
        writeln!(page, "{cut_off} of them did not finish.")?;
    }
    writeln!(page, "A success is: {}.", criteria::text(group.task.key))?;
    if !group.changes.is_empty() {
        let changes: Vec<_> = group.changes.iter().map(|change| code(change)).collect();
        writeln!(page, "Changed in the recipe: {}.", changes.join(", "))?;
    }
    writeln!(page)?;
    seeds(page, group)?;
    if reproducible::is_protocol(group) {
        writeln!(page, "Its plots are in the section on whether the paper is reproducible.\n")?;
    } else {
        pictures.seeds.iter().try_for_each(|picture| show(page, picture))?;
    }
    frames::write(page, &frames::of(group))?;
    for (title, pictures) in &pictures.runs {
        writeln!(page, "### {title}\n")?;
        pictures.iter().try_for_each(|picture| show(page, picture))?;
    }
    times(page, group)?;
    writeln!(page, "### To make these runs again\n\n```")?;
    reproduce::commands(group)?.iter().try_for_each(|line| writeln!(page, "{line}"))?;
    writeln!(page, "```\n")?;
    Ok(())
}

fn seeds(page: &mut String, group: &Group) -> Result<()> {
    let parameters = group.parameters();
    let mut head = vec!["seed", "outcome"];
    head.extend(&parameters);
    head.extend(Loss::ALL.map(Loss::symbol));
    head.extend(["steps", "folder"]);
    let rows: Vec<_> = group.runs.iter().map(|run| seed_row(run, &parameters)).collect();
    table(page, &head, &rows)?;
    for run in &group.runs {
        if let Err(error) = &run.trace {
            writeln!(page, "Seed {} is in no plot: {}.\n", run.config.seed, code(&format!("{error:#}")))?;
        }
    }
    Ok(())
}

fn seed_row(run: &Run, parameters: &[&str]) -> String {
    let outcome = match run.outcome() {
        Outcome::Succeeded => "succeeded".into(),
        Outcome::Missed => "criterion missed".into(),
        Outcome::Unfinished => format!("cut off after {}", run.length()),
    };
    let mut cells = vec![run.config.seed.to_string(), outcome];
    match &run.summary {
        Some(summary) => {
            cells.extend(parameters.iter().map(|name| match summary.parameters.get(*name) {
                Some(parameter) => {
                    let error = parameter.truth.map(|truth| percent(parameter.learned, truth));
                    error
                        .map_or(significant(parameter.learned), |e| format!("{} ({e})", significant(parameter.learned)))
                }
                None => NONE.into(),
            }));
            cells.extend(Loss::ALL.map(|loss| summary.test.loss(loss).map_or(NONE.into(), significant)));
        }
        None => cells.extend((0..parameters.len() + Loss::ALL.len()).map(|_| "missing".to_string())),
    }
    cells.push(run.steps().map_or(NONE.into(), |steps| steps.to_string()));
    cells.push(code(&run.folder.display().to_string()));
    row(&cells)
}

/// Every run's own time, also of those that did not finish.
fn times(page: &mut String, group: &Group) -> Result<()> {
    writeln!(page, "### Time and machine\n")?;
    if let Some(wall) = group.wall_seconds() {
        writeln!(page, "Wall time of the finished runs: {}.\n", wall.text(minutes))?;
    }
    let versions: BTreeSet<_> = group.finished().map(|(_, summary)| versions(summary)).collect();
    if versions.len() > 1 {
        writeln!(page, "Made with {} versions of the program: {}.\n", versions.len(), join(versions))?;
    }
    let rows: Vec<_> = group.runs.iter().map(time_row).collect();
    let head = [
        "seed",
        "wall time",
        "phases",
        "clips: train, valid, test",
        "processor",
        "cores",
        "threads",
        "device",
        "versions",
    ];
    table(page, &head, &rows)
}

fn time_row(run: &Run) -> String {
    let seed = run.config.seed.to_string();
    let none = || NONE.to_string();
    let Some(summary) = &run.summary else {
        let so_far = run.trace.as_ref().ok().and_then(|trace| trace.seconds());
        let so_far = so_far.map_or_else(none, |seconds| format!("{} until it was cut off", minutes(seconds)));
        return row(&[seed, so_far, none(), none(), none(), none(), none(), run.config.device.clone(), none()]);
    };
    let phases: Vec<_> = summary.phase_seconds.iter().map(|(name, s)| format!("{name} {}", duration(*s))).collect();
    let clips = run.data.as_ref().map(|data| [data.training_clips, data.validation_clips, data.test_clips]);
    let clips = clips.map_or_else(none, |clips| clips.map(|clips| clips.to_string()).join(", "));
    let hardware = summary.hardware.as_ref();
    row(&[
        seed,
        minutes(summary.wall_seconds),
        phases.join(", "),
        clips,
        hardware.and_then(|hardware| hardware.processor.clone()).unwrap_or_else(none),
        hardware.map_or_else(none, |hardware| hardware.cores.to_string()),
        summary.threads.to_string(),
        summary.device.clone(),
        versions(summary),
    ])
}

fn versions(summary: &Summary) -> String {
    join(summary.versions.iter().map(|(name, version)| format!("{name} {version}")))
}

fn join(parts: impl IntoIterator<Item = String>) -> String {
    parts.into_iter().collect::<Vec<_>>().join(", ")
}
