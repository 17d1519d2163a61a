//! Runs that differ in nothing but their seed, and in what does not change what is learned.

use super::runs::{Loss, Run, Summary};
use super::statistics::Spread;
use crate::network::cells::PhysicalParameter;
use crate::runs::scores::StateErrors;
use crate::tasks::{TASKS, Task};
use crate::viz::seeds::Outcome;

/// Runs of one task with one recipe, in the order of their seeds.
#[derive(Debug)]
pub(super) struct Group {
    pub task: &'static Task,
    pub recipe: String,
    /// The recipe and what differs from it; no other group of the task has the same.
    pub label: String,
    /// What differs from the recipe, as `key=value`.
    pub changes: Vec<String>,
    pub runs: Vec<Run>,
}

/// What a group is there for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Purpose {
    /// The recipe as it is.
    Plain,
    /// Other parameters at the start.
    Start,
    /// Other parameters are learned, the usual ones held.
    Hold,
    /// Anything else.
    Ablation,
}

/// Changes that a label spells out.
const SPELT_OUT: usize = 3;

impl Group {
    pub(super) fn finished(&self) -> impl Iterator<Item = (&Run, &Summary)> {
        self.runs.iter().filter_map(|run| Some((run, run.summary.as_ref()?)))
    }

    pub(super) fn count(&self, outcome: Outcome) -> usize {
        self.runs.iter().filter(|run| run.outcome() == outcome).count()
    }

    pub(super) fn purpose(&self) -> Purpose {
        let all = |section: &str| self.changes.iter().all(|change| change.starts_with(section));
        if self.changes.is_empty() {
            Purpose::Plain
        } else if all("start.") {
            Purpose::Start
        } else if all("model.hold.") {
            Purpose::Hold
        } else {
            Purpose::Ablation
        }
    }

    /// `3 / 5`.
    pub(super) fn successes(&self) -> String {
        format!("{} / {}", self.count(Outcome::Succeeded), self.runs.len())
    }

    /// The learned parameters.
    pub(super) fn learned(&self) -> impl Iterator<Item = &'static PhysicalParameter> {
        self.task.cell.parameters.iter().filter(|parameter| self.runs[0].config.learns(parameter))
    }

    /// Names of the learned parameters.
    pub(super) fn parameters(&self) -> Vec<&'static str> {
        self.learned().map(|parameter| parameter.name).collect()
    }

    /// The truth that the runs' summaries state.
    pub(super) fn truth(&self, name: &str) -> Option<f64> {
        self.finished().find_map(|(_, summary)| summary.parameters.get(name)?.truth)
    }

    /// A number of all finished runs, successes or not.
    pub(super) fn spread(&self, number: impl Fn(&Summary) -> Option<f64>) -> Option<Spread> {
        Spread::of(self.finished().filter_map(|(_, summary)| number(summary)))
    }

    pub(super) fn parameter(&self, name: &str) -> Option<Spread> {
        self.spread(|summary| Some(summary.parameters.get(name)?.learned))
    }

    /// Errors of a parameter in per cent, with their signs.
    pub(super) fn error_percent(&self, name: &str) -> Option<Spread> {
        self.spread(|summary| summary.error_percent(name))
    }

    pub(super) fn loss(&self, loss: Loss) -> Option<Spread> {
        self.spread(|summary| summary.test.loss(loss))
    }

    /// An error of positions or velocities; none of runs whose summaries do not have it.
    pub(super) fn state_error(&self, error: impl Fn(&StateErrors) -> Option<f64>) -> Option<Spread> {
        self.spread(|summary| error(summary.test.states.as_ref()?))
    }

    /// What a parameter of 1 in the model's own unit is in true pixels; none where that is the same.
    pub(super) fn own_unit(&self, parameter: &PhysicalParameter) -> Option<f64> {
        let side = self.task.side as f64;
        let scaled = self.runs[0].config.choices.get("model.exact_shift").is_some_and(|exact| exact == "false");
        (scaled && parameter.length_power != 0).then(|| ((side - 1.0) / side).powi(parameter.length_power))
    }

    pub(super) fn wall_seconds(&self) -> Option<Spread> {
        self.spread(|summary| Some(summary.wall_seconds))
    }

    /// `NAME` of run folders `RECIPE-NAME/seed=n`.
    pub(super) fn folder_name(&self) -> Option<String> {
        let above = self.runs[0].folder.parent()?.file_name()?.to_str()?;
        Some(above.strip_prefix(&self.recipe)?.strip_prefix('-')?.into())
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
        let recipe = run.config.recipe.clone();
        let mut group = Group { task: run.config.task, label: recipe.clone(), recipe, changes, runs: vec![run] };
        let label = label(&group);
        // Two versions of a recipe may differ in as many values.
        let known = |label: &str| groups.iter().any(|other| other.task == group.task && other.label == label);
        let numbered = || (2..).map(|number| format!("{label} ({number})")).find(|label| !known(label));
        group.label = if known(&label) { numbered().expect("there is always one more") } else { label };
        groups.push(group);
    }
    // The recipe as it is before what differs from it.
    let place = |group: &Group| TASKS.iter().position(|row| row.key == group.task.key);
    groups.sort_by(|a, b| (place(a), &a.recipe, &a.label).cmp(&(place(b), &b.recipe, &b.label)));
    for group in &mut groups {
        group.runs.sort_by(|a, b| (a.config.seed, &a.folder).cmp(&(b.config.seed, &b.folder)));
    }
    groups
}

fn label(group: &Group) -> String {
    let Group { recipe, changes, .. } = group;
    match (changes.len(), group.folder_name()) {
        (0, _) => recipe.clone(),
        (1..=SPELT_OUT, _) => format!("{recipe}, {}", changes.join(", ")),
        (_, Some(name)) => format!("{recipe}, changed: {name}"),
        (count, None) => format!("{recipe}, {count} changes"),
    }
}
