//! Runs that differ in nothing but their seed, and in what does not change what is learned.

use super::runs::{Loss, Run, Summary};
use super::statistics::Spread;
use crate::tasks::{TASKS, Task};
use crate::viz::seeds::Outcome;

/// Runs of one task with one recipe, in the order of their seeds.
#[derive(Debug)]
pub(super) struct Group {
    pub task: &'static Task,
    /// The recipe, or what its run folders call a changed one.
    pub label: String,
    /// What differs from the recipe, as `key=value`.
    pub changes: Vec<String>,
    pub runs: Vec<Run>,
}

impl Group {
    pub(super) fn finished(&self) -> impl Iterator<Item = (&Run, &Summary)> {
        self.runs.iter().filter_map(|run| Some((run, run.summary.as_ref()?)))
    }

    pub(super) fn count(&self, outcome: Outcome) -> usize {
        self.runs.iter().filter(|run| run.outcome() == outcome).count()
    }

    /// Names of the learned parameters.
    pub(super) fn parameters(&self) -> Vec<&'static str> {
        self.task.cell.parameters.iter().map(|parameter| parameter.name).collect()
    }

    /// The truth that the runs' summaries state.
    pub(super) fn truth(&self, name: &str) -> Option<f64> {
        self.finished().find_map(|(_, summary)| summary.parameters.get(name)?.truth)
    }

    /// Of all finished runs, successes or not.
    pub(super) fn parameter(&self, name: &str) -> Option<Spread> {
        Spread::of(self.finished().filter_map(|(_, summary)| Some(summary.parameters.get(name)?.learned)))
    }

    /// Of all finished runs, successes or not.
    pub(super) fn loss(&self, loss: Loss) -> Option<Spread> {
        Spread::of(self.finished().filter_map(|(_, summary)| summary.test.loss(loss)))
    }

    pub(super) fn wall_seconds(&self) -> Option<Spread> {
        Spread::of(self.finished().map(|(_, summary)| summary.wall_seconds))
    }
}

/// Sorts runs into groups, by task (in the task table's order) and recipe.
pub(super) fn group(runs: Vec<Run>) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for run in runs {
        let same = |group: &&mut Group| {
            let other = &group.runs[0].config;
            let config = &run.config;
            (other.task.key, &other.recipe, &other.choices) == (config.task.key, &config.recipe, &config.choices)
        };
        if let Some(group) = groups.iter_mut().find(same) {
            group.runs.push(run);
            continue;
        }
        let changes = run.config.changes();
        let mut label = label(&run, &changes);
        let known = |label: &str| groups.iter().any(|group| group.task == run.config.task && group.label == label);
        if let Some(number) = known(&label).then(|| (2..).find(|n| !known(&format!("{label} {n}")))).flatten() {
            label = format!("{label} {number}");
        }
        groups.push(Group { task: run.config.task, label, changes, runs: vec![run] });
    }
    let place = |group: &Group| TASKS.iter().position(|row| row.key == group.task.key);
    groups.sort_by(|a, b| (place(a), &a.label).cmp(&(place(b), &b.label)));
    for group in &mut groups {
        group.runs.sort_by(|a, b| (a.config.seed, &a.folder).cmp(&(b.config.seed, &b.folder)));
    }
    groups
}

fn label(run: &Run, changes: &[String]) -> String {
    let recipe = &run.config.recipe;
    if changes.is_empty() {
        return recipe.clone();
    }
    let above = run.folder.parent().and_then(|folder| folder.file_name()).unwrap_or_default().to_string_lossy();
    if above.starts_with(&format!("{recipe}-")) { above.into() } else { format!("{recipe}, changed") }
}
