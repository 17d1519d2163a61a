//! Runs that differ in nothing but their seeds, those of the data and of the training, and in what does not change what is
//! learned.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use serde::Serialize;
use toml::Table;

use super::criteria::{self, Status};
use super::protocol::protocol;
use paig::network::cells::PhysicalParameter;
use paig::network::physics_models::losses::Loss;
use paig::runs::run::{RunData, StoredRun};
use paig::runs::run_config::{RunConfig, choices};
use paig::runs::scores::{FrameSpread, StateErrors};
use paig::runs::summary::Summary;
use paig::support::statistics::Spread;
use paig::tasks::{self, Task};
use paig::training::config::Config;
use paig::training::layers::Overrides;

/// Runs of one task with one recipe, in the order of their seeds.
#[derive(Debug)]
pub(super) struct RunGroup {
    pub task: Task,
    pub recipe: String,
    /// The recipe and what differs from it, with `clips`; no other group of the task has the same.
    pub label: String,
    /// Training clips of each run, where another group differs in them alone.
    pub clips: Option<usize>,
    /// What differs from the recipe, as `key=value`.
    pub changes: Vec<String>,
    pub runs: Vec<StoredRun>,
}

/// What a group is there for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum GroupRole {
    /// The recipe as it is.
    Plain,
    /// Other parameters at the start.
    Start,
    /// Other parameters are learned, the usual ones held.
    Hold,
    /// Anything else.
    Ablation,
}

type StateError = fn(&StateErrors) -> Option<f64>;
/// The errors of positions and velocities, by name.
const STATES: [(&str, StateError); 4] = [
    ("encoded_position", |states| Some(states.encoded)),
    ("extrapolated_position", |states| states.extrapolated),
    ("initial_velocity", |states| Some(states.initial_velocity)),
    ("predicted_position", |states| Some(states.predicted)),
];

/// Values of what is switched off, as TOML writes them.
const OFF: [&str; 3] = ["false", "0", "0.0"];
/// Changes that a label spells out.
const SPELT_OUT: usize = 3;

impl RunGroup {
    pub(super) fn finished(&self) -> impl Iterator<Item = (&StoredRun, &Summary)> {
        self.runs.iter().filter_map(|run| Some((run, run.summary.as_ref()?)))
    }

    /// Successes; none of a task without a criterion, or where none of its runs can be held against it.
    pub(super) fn succeeded(&self) -> Option<usize> {
        let all: Vec<Status> = self.runs.iter().map(criteria::status).collect();
        let judged = all.iter().any(|status| matches!(status, Status::Succeeded | Status::Missed));
        let judged = criteria::criterion(&self.task).is_some() && (judged || self.finished().next().is_none());
        judged.then(|| all.iter().filter(|status| **status == Status::Succeeded).count())
    }

    /// Runs that say of themselves that they found what they looked for, and how many say anything.
    pub(super) fn found(&self) -> (usize, usize) {
        let verdicts: Vec<_> = self.finished().filter_map(|(_, summary)| summary.verdict.as_ref()).collect();
        (verdicts.iter().filter(|verdict| verdict.found).count(), verdicts.len())
    }

    /// How many data sets the runs learned from, as far as they say.
    pub(super) fn datasets(&self) -> usize {
        let made: BTreeSet<_> = self.runs.iter().filter_map(|run| run.data.as_ref()?.made_with.as_ref()).collect();
        made.len().max(1)
    }

    /// Training clips of each run, as far as the runs say.
    fn training_clips(&self) -> Option<usize> {
        clips_to_learn_from(&self.runs[0]).map(|[train, _]| train)
    }

    /// Whether the state at the start of a roll-out is refined on the input frames.
    pub(super) fn refined(&self) -> bool {
        self.runs.iter().any(|run| run.config.number("model.refinement_steps").is_some_and(|steps| steps > 0.0))
    }

    pub(super) fn role(&self) -> GroupRole {
        let all = |section: &str| self.changes.iter().all(|change| change.starts_with(section));
        if self.changes.is_empty() {
            GroupRole::Plain
        } else if all("start.") {
            GroupRole::Start
        } else if all("model.fixed.") {
            GroupRole::Hold
        } else {
            GroupRole::Ablation
        }
    }

    /// The learned parameters.
    pub(super) fn learned(&self) -> impl Iterator<Item = &PhysicalParameter> {
        self.task.system.cell.parameters.iter().filter(|parameter| self.runs[0].config.learns(parameter))
    }

    /// The truth that the runs' summaries state; none where they state several, since they number the objects otherwise.
    pub(super) fn truth(&self, parameter: &PhysicalParameter) -> Option<f64> {
        let mut stated = self.finished().filter_map(|(_, summary)| summary.parameters.get(&*parameter.name)?.truth);
        let first = stated.next()?;
        stated.all(|other| other == first).then_some(first)
    }

    /// Whether the group is the paper's protocol, unchanged.
    pub(super) fn is_protocol(&self) -> bool {
        self.recipe == protocol().recipe && self.role() == GroupRole::Plain
    }

    /// A number of all finished runs, successes or not.
    pub(super) fn spread(&self, number: impl Fn(&Summary) -> Option<f64>) -> Option<Spread> {
        Spread::of(self.finished().filter_map(|(_, summary)| number(summary)))
    }

    pub(super) fn value(&self, parameter: &PhysicalParameter) -> Option<Spread> {
        self.spread(|summary| Some(summary.parameters.get(&*parameter.name)?.learned))
    }

    pub(super) fn losses(&self) -> [(Loss, Option<Spread>); 3] {
        Loss::ALL.map(|loss| (loss, self.spread(|summary| summary.test.scores.losses.of(loss))))
    }

    /// Errors of positions and velocities.
    pub(super) fn states(&self) -> [(&'static str, Option<Spread>); 4] {
        STATES.map(|(name, of)| (name, self.spread(|summary| of(summary.test.scores.states.as_ref()?))))
    }

    /// What a parameter of 1 in the model's own unit is in true pixels; none where that is the same.
    pub(super) fn own_unit(&self, parameter: &PhysicalParameter) -> Option<f64> {
        let scaled = self.runs[0].config.choices.get("model.exact_shift").is_some_and(|exact| exact == "false");
        (scaled && parameter.length_power != 0).then(|| original_unit(&self.task, parameter))
    }

    /// The scores of the predicted frames; empty if no run's summary holds them.
    pub(super) fn frames(&self) -> Vec<FrameSpread> {
        FrameSpread::of(self.finished().map(|(_, summary)| &summary.test.scores.predicted_frames[..]))
    }

    /// `NAME` of run folders `RECIPE-NAME/seed=n`.
    pub(super) fn folder_name(&self) -> Option<String> {
        let above = self.runs[0].folder.parent()?.file_name()?.to_str()?;
        Some(above.strip_prefix(&self.recipe)?.strip_prefix('-')?.into())
    }
}

/// What a parameter of 1 in the unit of the original's decoder is in true pixels.
pub(super) fn original_unit(task: &Task, parameter: &PhysicalParameter) -> f64 {
    let side = task.system.side as f64;
    ((side - 1.0) / side).powi(parameter.length_power)
}

/// Sorts runs into groups, by task (in the order of the built-in ones) and recipe.
pub(super) fn group(runs: Vec<StoredRun>) -> Vec<RunGroup> {
    let mut groups: Vec<RunGroup> = Vec::new();
    // Last those that left nothing to tell what they learned from: all groups that they may belong to are there then.
    let (known, unknown): (Vec<_>, Vec<_>) = runs.into_iter().partition(|run| !of_unknown_data(run));
    for run in known.into_iter().chain(unknown) {
        if let Some(place) = place_of(&run, &groups) {
            groups[place].runs.push(run);
            continue;
        }
        let (task, recipe, changes) = (run.config.task.clone(), run.config.recipe.clone(), changes(&run.config));
        groups.push(RunGroup { task, recipe, label: String::new(), clips: None, changes, runs: vec![run] });
    }
    let clips: Vec<_> = groups.iter().map(|group| own_clips(group, &groups)).collect();
    groups.iter_mut().zip(clips).for_each(|(group, clips)| group.clips = clips);
    let labels = labels(&groups);
    groups.iter_mut().zip(labels).for_each(|(group, label)| group.label = label);
    // The recipe as it is before what differs from it.
    let known: Vec<_> = tasks::all().map(|task| task.name).collect();
    let place = |group: &RunGroup| known.iter().position(|name| *name == group.task.name).unwrap_or(known.len());
    groups
        .sort_by_cached_key(|group| (place(group), group.task.name.clone(), group.recipe.clone(), group.label.clone()));
    groups.iter_mut().for_each(|group| {
        group.runs.sort_by_cached_key(|run| {
            let seed = run.data.as_ref().and_then(RunData::seed);
            (seed.is_none(), seed, run.config.seed, run.folder.clone())
        })
    });
    groups
}

/// The group that a run belongs to, if it is there. One that has not finished, on files of which no other run tells, counts
/// in the only group whose runs were to learn the same in the same way: a failure is no group of its own.
fn place_of(run: &StoredRun, groups: &[RunGroup]) -> Option<usize> {
    let same = groups.iter().position(|group| alike(&group.runs[0], run));
    let only = || {
        let could = |group: &RunGroup| kind(&group.runs[0]).is_some() && same_choices(&group.runs[0], run);
        let mut places = (0..groups.len()).filter(|place| could(&groups[*place]));
        places.next().filter(|_| places.next().is_none())
    };
    same.or_else(|| of_unknown_data(run).then(only).flatten())
}

/// Whether nothing is known of what a run learned from.
fn of_unknown_data(run: &StoredRun) -> bool {
    run.summary.is_none() && run.data.is_none()
}

/// How the files that a run learned from were made, but for their seed.
fn kind(run: &StoredRun) -> Option<String> {
    run.data.as_ref().and_then(RunData::kind)
}

/// Training and validation clips of a run's files. How they were made does not say it: that is told of the test file, which
/// has few of both.
fn clips_to_learn_from(run: &StoredRun) -> Option<[usize; 2]> {
    run.data.as_ref().map(|data| [data.clips[0], data.clips[1]])
}

/// Whether two runs differ in nothing that decides what is learned. Where the data lie is not that, nor the seed that they
/// were made with: what they show is, and how many there are.
fn alike(a: &StoredRun, b: &StoredRun) -> bool {
    let place = |run: &StoredRun| run.config.choices.get(DATA_FOLDER).cloned();
    let same_data = kind(a) == kind(b) && clips_to_learn_from(a) == clips_to_learn_from(b);
    same_choices(a, b) && same_data && (kind(a).is_some() || place(a) == place(b))
}

/// Whether two runs have the same task, recipe and choices, wherever their data lie.
fn same_choices(a: &StoredRun, b: &StoredRun) -> bool {
    let what = |run: &StoredRun| {
        let mut choices = without_place(&run.config.choices);
        // Earlier versions did not write down all that is switched off.
        choices.retain(|_, value| !OFF.contains(&value.as_str()));
        (run.config.task.name.clone(), run.config.recipe.clone(), choices)
    };
    what(a) == what(b)
}

/// The key that says where the data lie.
pub(super) const DATA_FOLDER: &str = "data.folder";

/// Choices without where the data lie.
pub(super) fn without_place(choices: &BTreeMap<String, String>) -> BTreeMap<String, String> {
    choices.iter().filter(|(key, _)| *key != DATA_FOLDER).map(|(key, value)| (key.clone(), value.clone())).collect()
}

/// The name, or its first numbered version that is still free.
pub(super) fn numbered(name: String, mark: fn(usize) -> String, mut free: impl FnMut(&str) -> bool) -> String {
    let marks = std::iter::once(String::new()).chain((2..).map(mark));
    marks.map(|mark| name.clone() + &mark).find(|name| free(name)).expect("there is always one more")
}

/// The training clips of a group, where another one differs from it in them alone.
fn own_clips(group: &RunGroup, groups: &[RunGroup]) -> Option<usize> {
    let same = groups.iter().filter(|other| other.task == group.task && label(other) == label(group));
    let mut clips = same.filter_map(RunGroup::training_clips);
    group.training_clips().filter(|own| clips.any(|other| other != *own))
}

/// Labels that tell the groups of each task apart: by what differs from the recipe; where that is the same, by the training
/// clips; and where these are, too, by a number: two versions of a recipe may differ in as many values.
fn labels(groups: &[RunGroup]) -> Vec<String> {
    let mut labels: Vec<String> = Vec::new();
    for group in groups {
        let name = label(group);
        let name = group.clips.map_or_else(|| name.clone(), |clips| format!("{name}, {clips} training clips"));
        let known =
            |name: &str| groups.iter().zip(&labels).any(|(other, label)| other.task == group.task && label == name);
        let label = numbered(name, |number| format!(" ({number})"), |name| !known(name));
        labels.push(label);
    }
    labels
}

fn label(group: &RunGroup) -> String {
    let RunGroup { recipe, changes, .. } = group;
    match (changes.len(), group.folder_name()) {
        (0, _) => recipe.clone(),
        (1..=SPELT_OUT, _) => format!("{recipe}, {}", changes.join(", ")),
        (_, Some(name)) => format!("{recipe}, changed: {name}"),
        (count, None) => format!("{recipe}, {count} changes"),
    }
}

/// What differs from the recipe as this version has it, as `section.key=value`.
fn changes(config: &RunConfig) -> Vec<String> {
    // A recipe of another version may be unknown here: then everything is stated.
    let recipe = choices_of(config, &[]).unwrap_or_default();
    let choices = without_place(&config.choices);
    let changed = choices.iter().filter(|(key, value)| recipe.get(*key) != Some(value));
    changed.map(|(key, value)| format!("{key}={value}")).collect()
}

/// What task, recipe and changes choose in this version.
pub(super) fn choices_of(config: &RunConfig, changes: &[String]) -> Option<BTreeMap<String, String>> {
    let task = tasks::builtin(&config.task.name).unwrap_or_else(|| config.task.clone());
    let overrides = Overrides { recipe: Some(config.recipe.clone()), set: changes.to_vec(), ..Overrides::default() };
    let config = Config::load_task(task, None, &overrides).ok()?;
    Some(choices(&Table::try_from(&config).expect("a config is plain data")))
}

/// The built-in tasks, then those of runs of other tasks; each with the places of its groups.
pub(super) fn by_task(groups: &[RunGroup]) -> Vec<(Task, Range<usize>)> {
    let mut tasks: Vec<Task> = tasks::all().collect();
    for group in groups {
        if !tasks.iter().any(|task| task.name == group.task.name) {
            tasks.push(group.task.clone());
        }
    }
    let place = |name: &str| {
        let first = groups.iter().position(|group| group.task.name == name).unwrap_or(0);
        first..first + groups.iter().filter(|group| group.task.name == name).count()
    };
    tasks.into_iter().map(|task| (task.clone(), place(&task.name))).collect()
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::super::commands::commands;
    use super::*;

    /// A run on files of a folder; their maker's line where it is known.
    fn run(place: &Path, data: u64, made_with: Option<&str>) -> StoredRun {
        let folder = place.join(format!("data={data}"));
        fs::create_dir_all(&folder).unwrap();
        let overrides = Overrides {
            task: Some("pendulum".into()),
            recipe: Some("fast".into()),
            seed: Some(31),
            data: Some(format!("data/datasets/data={data}").into()),
            ..Overrides::default()
        };
        fs::write(folder.join("config.toml"), Config::load(None, &overrides).unwrap().to_toml()).unwrap();
        let made_with = made_with.map(|text| format!("generator 1, task pendulum, seed {data}, {text}"));
        let data = made_with.map(|text| RunData { clips: [10, 10, 10], made_with: Some(text) });
        StoredRun { data, ..StoredRun::read(&folder).unwrap() }
    }

    #[test]
    fn a_run_that_failed_alone_on_its_data_counts_among_those_it_was_to_be_like() {
        let folder = tempfile::tempdir().unwrap();
        let run = |data: u64, made_with: Option<&str>| run(folder.path(), data, made_with);
        let sizes = |groups: &[RunGroup]| -> Vec<usize> { groups.iter().map(|group| group.runs.len()).collect() };
        // It is found first, and comes last in its group.
        let (short, long) = (Some("10 clips"), Some("1000 clips"));
        let groups = group(vec![run(20, None), run(21, short), run(23, short), run(24, None)]);
        assert_eq!(sizes(&groups), [4]);
        assert!(groups[0].label == "fast" && groups[0].runs[0].data.is_some());
        // Nothing says to which of two kinds of data.
        let groups = group(vec![run(21, short), run(22, None), run(23, long)]);
        assert_eq!(sizes(&groups), [1, 1, 1]);
    }

    #[test]
    fn runs_that_learned_from_more_clips_are_a_group_of_their_own_with_a_name_and_a_folder_that_say_so() {
        let folder = tempfile::tempdir().unwrap();
        // The line of their test files is the same.
        let on = |data: u64, train: usize| {
            let run = run(folder.path(), data, Some("10 clips"));
            let data = run.data.clone().map(|data| RunData { clips: [train, 10, 10], ..data });
            StoredRun { data, ..run }
        };
        let groups = group(vec![on(20, 5000), on(21, 200), on(22, 5000)]);
        let found: Vec<_> = groups.iter().map(|group| (group.label.as_str(), group.runs.len())).collect();
        assert_eq!(found, [("fast, 200 training clips", 1), ("fast, 5000 training clips", 2)]);
        let out = |place: usize| {
            let records = vec![folder.path().join("record"); groups[place].runs.len()];
            commands(&groups[place], &records).unwrap().pop().unwrap()
        };
        assert!(out(0).contains("runs/clips=200/pendulum/fast/seed=31"), "{}", out(0));
        assert!(out(1).contains("runs/clips=5000/data=22/pendulum/fast/seed=31"), "{}", out(1));
    }
}
