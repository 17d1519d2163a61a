//! report.md.

use std::fmt::Write;
use std::path::PathBuf;

use anyhow::Result;

use super::groups::Group;
use super::markdown::{NONE, code, percent, row, signed, spread, table, text};
use super::pictures::Pictures;
use super::runs::Loss;
use super::{ablations, criteria, published, reproducible, section, states};
use crate::tasks::{self, TASKS};
use crate::viz::seeds::Outcome;

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
        "Every run folder in {} is counted; nothing was selected. A run's seed fixes its initial values and the order \
         of its data. Ours is `median [min, max]` over all finished runs, whether they succeeded or not. Losses are on \
         the test file: squared error summed over a frame, averaged over frames and clips.\n",
        places.join(", ")
    )?;
    overview(&mut page, groups)?;
    losses(&mut page, groups)?;
    parameters(&mut page, groups)?;
    writeln!(page, "{}\n", published::SOURCES)?;
    states::write(&mut page, groups)?;
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
                &text(&group.label),
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
            let truth = truth.map_or(NONE.into(), |truth| truth.to_string());
            let known = [task.key, parameter.name, &truth, &paper, &error];
            let learn = |group: &&Group| group.task == task && group.parameters().contains(&parameter.name);
            let ours: Vec<&Group> = groups.iter().filter(learn).collect();
            if ours.is_empty() {
                rows.push(row(&[&known[..], &["no run", NONE, NONE, NONE]].concat()));
            }
            for group in ours {
                let learned = group.parameter(parameter.name);
                let error = learned.zip(group.truth(parameter.name));
                let error = error.map_or(NONE.into(), |(spread, truth)| percent(spread.median, truth));
                let learned = learned.map_or(NONE.into(), |learned| format!("**{}**", spread(Some(learned))));
                rows.push(row(&[&known[..], &[&text(&group.label), &learned, &error, &group.successes()]].concat()));
            }
        }
    }
    let head =
        ["task", "", "truth", "paper", "its error", "recipe", "ours", "error of the median", "succeeded / tried"];
    table(page, &head, &rows)
}
