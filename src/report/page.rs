//! report.md.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::Result;

use super::criteria;
use super::groups::Group;
use super::pictures::{Picture, Pictures};
use super::published;
use super::reproduce;
use super::runs::{Loss, Run};
use super::statistics::significant;
use crate::tasks::{self, TASKS};
use crate::viz::seeds::Outcome;

const NONE: &str = "–";

/// The whole report.
pub(super) fn write(
    groups: &[Group],
    unreadable: &[(PathBuf, anyhow::Error)],
    pictures: &[Pictures],
    places: &[String],
) -> Result<String> {
    let mut page = String::from("# Physics-as-Inverse-Graphics: report of runs\n\n");
    let places: Vec<_> = places.iter().map(|place| code(place)).collect();
    writeln!(
        page,
        "Every run folder in {} is counted; nothing was selected. Ours is `median [min, max]` over all finished runs, \
         whether they succeeded or not. Losses are on the test file: squared error summed over a frame, averaged over \
         frames and clips.\n",
        places.join(", ")
    )?;
    overview(&mut page, groups)?;
    losses(&mut page, groups)?;
    parameters(&mut page, groups)?;
    writeln!(page, "{}\n", published::SOURCES)?;
    for (group, pictures) in groups.iter().zip(pictures) {
        section(&mut page, group, pictures)?;
    }
    if !unreadable.is_empty() {
        writeln!(page, "## Unreadable run folders\n")?;
        for (folder, error) in unreadable {
            writeln!(page, "- {}: {}", code(&folder.display().to_string()), code(&format!("{error:#}")))?;
        }
    }
    Ok(page)
}

fn overview(page: &mut String, groups: &[Group]) -> Result<()> {
    writeln!(page, "## Seeds tried and succeeded\n")?;
    let mut rows = Vec::new();
    for task in TASKS {
        let mut of_task = groups.iter().filter(|group| group.task.key == task.key).peekable();
        if of_task.peek().is_none() {
            rows.push(row(&[task.key, "no run", "0", "0", "0", &criteria::text(task.key)]));
        }
        for group in of_task {
            rows.push(row(&[
                task.key,
                &group.label,
                &group.runs.len().to_string(),
                &group.finished().count().to_string(),
                &format!("**{}**", group.count(Outcome::Succeeded)),
                &criteria::text(task.key),
            ]));
        }
    }
    table(page, &["task", "recipe", "tried", "finished", "succeeded", "a success is"], &rows)
}

fn losses(page: &mut String, groups: &[Group]) -> Result<()> {
    writeln!(page, "## Test losses\n")?;
    let mut rows = Vec::new();
    for task in TASKS {
        if let Some(paper) = tasks::paper_losses(task.key) {
            let (recons, pred) = (paper.reconstruction.to_string(), paper.prediction.to_string());
            rows.push(row(&[task.key, "paper", &recons, &pred, NONE, NONE]));
        }
        if task.key == published::RERUN_TASK {
            for other in published::RERUNS {
                let numbers = [other.recons, other.pred, other.extrap].map(|loss| loss.to_string());
                rows.push(row(&[task.key, other.who, &numbers[0], &numbers[1], &numbers[2], NONE]));
            }
        }
        for group in groups.iter().filter(|group| group.task.key == task.key) {
            let spreads = Loss::ALL.map(|loss| spread(group.loss(loss)));
            let who = format!("**ours, {}**", group.label);
            rows.push(row(&[task.key, &who, &spreads[0], &spreads[1], &spreads[2], &successes(group)]));
        }
    }
    table(page, &["task", "who", "L_rec", "L_pred", "L_extrap", "succeeded / tried"], &rows)
}

fn parameters(page: &mut String, groups: &[Group]) -> Result<()> {
    writeln!(page, "## Physical parameters (the paper's table 1)\n")?;
    let mut rows = Vec::new();
    for task in TASKS {
        for parameter in task.cell.parameters {
            let published = published::parameter(task.key, parameter.name);
            let paper = published.map_or((NONE.into(), NONE.into()), |row| (row.learned.to_string(), row.error()));
            let truth = task.truth.iter().find(|truth| truth.name == parameter.name).map(|truth| truth.value);
            let truth = truth.map_or(NONE.into(), |truth| truth.to_string());
            let ours: Vec<&Group> = groups.iter().filter(|group| group.task.key == task.key).collect();
            if ours.is_empty() {
                let cells = [task.key, parameter.name, &truth, &paper.0, &paper.1, "no run", NONE, NONE, NONE];
                rows.push(row(&cells));
            }
            for group in ours {
                let learned = group.parameter(parameter.name);
                let error = learned.zip(group.truth(parameter.name));
                let error = error.map_or(NONE.into(), |(spread, truth)| percent(spread.median, truth));
                let ours = learned.map_or(NONE.into(), |learned| format!("**{}**", spread(Some(learned))));
                let (label, seeds) = (&group.label, successes(group));
                rows.push(row(&[task.key, parameter.name, &truth, &paper.0, &paper.1, label, &ours, &error, &seeds]));
            }
        }
        // What the paper reports and this model cannot learn.
        for other in published::PARAMETERS.iter().filter(|row| row.task == task.key) {
            if task.cell.parameters.iter().all(|parameter| parameter.name != other.name) {
                let (truth, learned) = (other.truth.to_string(), other.learned.to_string());
                rows.push(row(&[
                    task.key,
                    other.name,
                    &truth,
                    &learned,
                    &other.error(),
                    "not learned",
                    NONE,
                    NONE,
                    NONE,
                ]));
            }
        }
    }
    let head =
        ["task", "", "truth", "paper", "its error", "recipe", "ours", "error of the median", "succeeded / tried"];
    table(page, &head, &rows)
}

fn section(page: &mut String, group: &Group, pictures: &Pictures) -> Result<()> {
    writeln!(page, "## {}, {}\n", group.task.key, text(&group.label))?;
    writeln!(page, "{} of {} seeds succeeded.", group.count(Outcome::Succeeded), group.runs.len())?;
    writeln!(page, "A success is: {}.", criteria::text(group.task.key))?;
    if !group.changes.is_empty() {
        let changes: Vec<_> = group.changes.iter().map(|change| code(change)).collect();
        writeln!(page, "Changed in the recipe: {}.", changes.join(", "))?;
    }
    writeln!(page)?;
    seeds(page, group)?;
    for picture in [&pictures.losses, &pictures.parameters].into_iter().flatten() {
        show(page, picture)?;
    }
    for (title, pictures) in &pictures.runs {
        writeln!(page, "### {title}\n")?;
        pictures.iter().try_for_each(|picture| show(page, picture))?;
    }
    times(page, group)?;
    writeln!(page, "### To make these runs again\n\n```")?;
    writeln!(page, "generate --task {}", group.task.key)?;
    for run in &group.runs {
        writeln!(page, "{}", reproduce::command(run, &group.changes)?)?;
    }
    writeln!(page, "```\n")?;
    Ok(())
}

fn seeds(page: &mut String, group: &Group) -> Result<()> {
    let parameters = group.parameters();
    let mut head = vec!["seed", "outcome"];
    head.extend(&parameters);
    head.extend(Loss::ALL.map(Loss::symbol));
    head.extend(["steps", "wall time", "folder"]);
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
        Outcome::Succeeded => "succeeded",
        Outcome::Missed => "criterion missed",
        Outcome::Unfinished => "unfinished",
    };
    let mut cells = vec![run.config.seed.to_string(), outcome.to_string()];
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
            cells.extend([summary.steps.to_string(), duration(summary.wall_seconds)]);
        }
        None => {
            cells.extend((0..parameters.len() + Loss::ALL.len()).map(|_| "missing".to_string()));
            cells.extend([run.trace.as_ref().map_or(NONE.into(), |trace| trace.steps().to_string()), NONE.into()]);
        }
    }
    cells.push(code(&run.folder.display().to_string()));
    row(&cells.iter().map(String::as_str).collect::<Vec<_>>())
}

fn times(page: &mut String, group: &Group) -> Result<()> {
    let Some(wall) = group.wall_seconds() else { return Ok(()) };
    writeln!(page, "### Time and machine\n")?;
    writeln!(page, "Wall time: {}.\n", wall.text(duration))?;
    let mut rows = Vec::new();
    for (run, summary) in group.finished() {
        let phases: Vec<_> = summary.phase_seconds.iter().map(|(name, s)| format!("{name} {}", duration(*s))).collect();
        let versions: Vec<_> = summary.versions.iter().map(|(name, version)| format!("{name} {version}")).collect();
        rows.push(row(&[
            &run.config.seed.to_string(),
            &duration(summary.wall_seconds),
            &phases.join(", "),
            &summary.device,
            &summary.threads.to_string(),
            &summary.test.clips.to_string(),
            &versions.join(", "),
        ]));
    }
    table(page, &["seed", "wall time", "phases", "device", "threads", "test clips", "versions"], &rows)
}

fn show(page: &mut String, picture: &Picture) -> Result<()> {
    Ok(writeln!(page, "![{0}]({1})\n\n*{0}*\n", picture.caption, picture.path)?)
}

fn successes(group: &Group) -> String {
    format!("{} / {}", group.count(Outcome::Succeeded), group.runs.len())
}

fn spread(spread: Option<super::statistics::Spread>) -> String {
    spread.map_or(NONE.into(), |spread| spread.text(significant))
}

/// The error of a value in per cent, with its sign; never broken across lines.
pub(super) fn percent(value: f64, truth: f64) -> String {
    format!("{:+.2}\u{a0}%", 100.0 * (value / truth - 1.0))
}

fn duration(seconds: f64) -> String {
    if seconds < 120.0 { format!("{seconds:.0} s") } else { format!("{:.1} min", seconds / 60.0) }
}

fn table(page: &mut String, head: &[&str], rows: &[String]) -> Result<()> {
    writeln!(page, "{}\n{}\n{}\n", row(head), row(&vec!["---"; head.len()]), rows.join("\n"))?;
    Ok(())
}

fn row(cells: &[&str]) -> String {
    let cells: Vec<_> = cells.iter().map(|cell| cell.replace('|', "\\|").replace('\n', " ")).collect();
    format!("| {} |", cells.join(" | "))
}

/// Text that is shown as it is.
fn code(text: &str) -> String {
    format!("`{}`", text.replace('`', "'").replace('\n', " "))
}

/// Text from outside in which nothing may be taken for markup.
fn text(text: &str) -> String {
    text.chars().flat_map(|c| c.is_ascii_punctuation().then_some('\\').into_iter().chain([c])).collect()
}
