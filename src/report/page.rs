//! report.md.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::Result;

use super::explanations::Explanations;
use super::groups::{Group, Purpose};
use super::markdown::{NONE, code, minutes, percent, row, signed, spread, table, text};
use super::pictures::Pictures;
use super::reproducible::is_protocol;
use super::runs::Loss;
use super::{ablations, criteria, published, reproducible, section, states};
use crate::tasks::{self, TASKS};
use crate::viz::seeds::Outcome;

/// By which a report is known.
pub(super) const TITLE: &str = "# Physics-as-Inverse-Graphics: report of runs";

/// The whole report.
pub(super) fn write(
    groups: &[Group],
    unreadable: &[(PathBuf, anyhow::Error)],
    pictures: &[Pictures],
    places: &[String],
) -> Result<String> {
    let mut page = format!("{TITLE}\n\n");
    let places: Vec<_> = places.iter().map(|place| code(place)).collect();
    writeln!(
        page,
        "Every run folder in {} is counted; nothing was selected. A run's seed fixes its initial values and the order \
         of its data. Ours is `median [min, max]` over all finished runs, whether they succeeded or not. Losses are on \
         the test file: squared error summed over a frame, averaged over frames and clips.\n",
        places.join(", ")
    )?;
    let explanations = Explanations::of(groups);
    in_short(&mut page, groups, &explanations, unreadable.len())?;
    overview(&mut page, groups)?;
    losses(&mut page, groups)?;
    parameters(&mut page, groups)?;
    writeln!(page, "{}\n", published::SOURCES)?;
    states::write(&mut page, groups)?;
    explanations.write(&mut page)?;
    ablations::write(&mut page, groups)?;
    reproducible::write(&mut page, groups, pictures)?;
    for (group, pictures) in groups.iter().zip(pictures) {
        section::write(&mut page, group, pictures)?;
    }
    if !unreadable.is_empty() {
        writeln!(page, "## Unreadable run folders\n")?;
        for (folder, error) in unreadable {
            writeln!(page, "- {}: {}", code(&folder.display().to_string()), code(&format!("{error:#}")))?;
        }
    }
    Ok(page)
}

/// A line for every task that was run with a recipe as it is, where the paper's errors come from, and the answer on its
/// own protocol.
fn in_short(page: &mut String, groups: &[Group], explanations: &Explanations, unreadable: usize) -> Result<()> {
    writeln!(page, "## In short\n")?;
    if unreadable > 0 {
        writeln!(page, "**Run folders that cannot be read, in no count and listed at the end: {unreadable}.**\n")?;
    }
    for group in groups.iter().filter(|group| group.purpose() == Purpose::Plain && !is_protocol(group)) {
        let parameter = |name: &&str| {
            let error = group.error_percent(name).map_or(String::new(), |error| format!(" ({})", signed(error.median)));
            Some(format!("{name} {}{error}", spread(Some(group.parameter(name)?))))
        };
        let mut said: Vec<_> = group.parameters().iter().filter_map(parameter).collect();
        said.extend(group.loss(Loss::Pred).map(|loss| format!("L_pred {}", spread(Some(loss)))));
        said.extend(group.wall_seconds().map(|wall| format!("{} a run", minutes(wall.median))));
        let (task, label) = (group.task.key, text(&group.label));
        let (succeeded, tried) = (group.count(Outcome::Succeeded), group.runs.len());
        writeln!(page, "- {task}, {label}: **{succeeded} of {tried}** seeds succeeded; {}.", said.join(", "))?;
    }
    if let Some(verdicts) = explanations.in_short() {
        writeln!(page, "- Where do the paper's errors come from? {verdicts}.")?;
    }
    writeln!(page, "- Is the paper reproducible as published? {}\n", reproducible::in_short(groups))?;
    Ok(())
}

fn overview(page: &mut String, groups: &[Group]) -> Result<()> {
    writeln!(page, "## Seeds tried and succeeded\n")?;
    let mut rows = Vec::new();
    let mut criteria = Vec::new();
    for task in TASKS {
        let mut of_task = groups.iter().filter(|group| group.task.key == task.key).peekable();
        if of_task.peek().is_none() {
            rows.push(row(&[task.key, "no run", "0", "0", "0"]));
        } else {
            criteria.push(format!("- {}: {}", task.key, criteria::text(task.key)));
        }
        for group in of_task {
            rows.push(row(&[
                task.key,
                &text(&group.label),
                &group.runs.len().to_string(),
                &group.finished().count().to_string(),
                &format!("**{}**", group.count(Outcome::Succeeded)),
            ]));
        }
    }
    table(page, &["task", "recipe", "tried", "finished", "succeeded"], &rows)?;
    writeln!(page, "A success is:\n\n{}\n", criteria.join("\n"))?;
    Ok(())
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
            let who = format!("**ours, {}**", text(&group.label));
            rows.push(row(&[task.key, &who, &spreads[0], &spreads[1], &spreads[2], &group.successes()]));
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
            let (paper, error) = published
                .map_or((NONE.into(), NONE.into()), |row| (row.learned.to_string(), signed(row.error_percent())));
            let truth = task.truth.iter().find(|truth| truth.name == parameter.name).map(|truth| truth.value);
            // Of runs on other data their own truth counts.
            let known = |truth: Option<f64>| {
                let truth = truth.map_or(NONE.into(), |truth| truth.to_string());
                [task.key.into(), parameter.name.into(), truth, paper.clone(), error.clone()]
            };
            let learn = |group: &&Group| group.task == task && group.parameters().contains(&parameter.name);
            let ours: Vec<&Group> = groups.iter().filter(learn).collect();
            if ours.is_empty() {
                let none = ["no run", NONE, NONE, NONE].map(String::from);
                rows.push(row(&[&known(truth)[..], &none].concat()));
            }
            for group in ours {
                let learned = group.parameter(parameter.name);
                let error = learned.zip(group.truth(parameter.name));
                let error = error.map_or(NONE.into(), |(spread, truth)| percent(spread.median, truth));
                let own = group.own_unit(parameter).zip(learned).map(|(unit, learned)| learned.times(1.0 / unit));
                let own = own.map_or(String::new(), |own| format!(" (own unit: {})", spread(Some(own))));
                let learned = learned.map_or(NONE.into(), |learned| format!("**{}**{own}", spread(Some(learned))));
                let truth = if group.finished().next().is_some() { group.truth(parameter.name) } else { truth };
                let ours = [text(&group.label), learned, error, group.successes()];
                rows.push(row(&[&known(truth)[..], &ours].concat()));
            }
        }
    }
    writeln!(
        page,
        "Ours is in true pixels. The paper's values are in the original decoder's unit of length, (S-1)/S of a pixel: \
         where runs have it, too (`model.exact_shift=false`), \"own unit\" stands beside ours, to be compared with \
         them.\n"
    )?;
    let head =
        ["task", "", "truth", "paper", "its error", "recipe", "ours", "error of the median", "succeeded / tried"];
    table(page, &head, &rows)
}
