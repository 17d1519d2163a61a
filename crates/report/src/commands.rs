//! The commands that make the data and the runs again.

use std::path::{Path, PathBuf};

use anyhow::Result;

use super::groups::{RunGroup, choices_of, without_place};
use paig::generators::{Counts, plain_test_settings};
use paig::runs::run::{RunData, StoredRun};
use paig::support::command_line::CommandOptions;
use paig::tasks::{self, Task};
use paig::training::layers::USUAL_DATA;

/// The program of all commands.
const PROGRAM: &str = "paig";

/// All commands of a group in a shell's notation, one a line: the data, all runs at once, and each run by itself. The records of
/// its runs lie in these folders.
pub(super) fn commands(group: &RunGroup, records: &[PathBuf]) -> Result<Vec<String>> {
    let mut lines: Vec<String> = Vec::new();
    if !is_built_in(&group.task) {
        let (name, config) = (&group.task.name, records[0].join("config.toml"));
        lines.push(format!("# {name}.toml is what stands under [task] in {}, as a file of its own", config.display()));
    }
    for run in &group.runs {
        let data = generate(run)?;
        lines.extend(data.into_iter().filter(|line| !lines.contains(line)).collect::<Vec<_>>());
    }
    // One for each folder of data.
    let of_data = group.runs.chunk_by(|a, b| data_folder(a) == data_folder(b));
    if let Some(sweeps) = of_data.map(|runs| sweep(runs, group)).collect::<Option<Vec<_>>>() {
        lines.push("# all runs:".into());
        for sweep in sweeps {
            lines.push(sweep.shell(PROGRAM, "sweep")?);
        }
        lines.push("# or one by one:".into());
    }
    for (run, record) in group.runs.iter().zip(records) {
        lines.push(one(run, group, record).shell(PROGRAM, "train")?);
    }
    Ok(lines)
}

/// The data of a run, and where that is not all, what is known besides.
fn generate(run: &StoredRun) -> Result<Vec<String>> {
    let task = &run.config.task;
    if task.scene.is_none() {
        return Ok(vec!["# its clips were not generated".into()]);
    }
    let options = CommandOptions::default().with("task", named(task));
    let options = options.with_each("out", data_folder(run));
    let unknown = "# no run says how these data were made:";
    let Some(data) = &run.data else { return Ok(vec![unknown.into(), options.shell(PROGRAM, "generate")?]) };
    let RunData { clips: [train, valid, test], made_with } = data;
    let options = options.with("train", train.to_string()).with("valid", valid.to_string());
    let seed = data.seed();
    let options = options.with("test", test.to_string()).with_each("seed", seed.map(|seed| seed.to_string()));
    let counts = Counts { train: *train, valid: *valid, test: *test };
    // The scene's picture may be gone: then nobody can say whether these options are all.
    let plain = seed.and_then(|seed| plain_test_settings(task, counts, seed).ok().flatten());
    let remark = match made_with {
        None => Some(unknown.into()),
        Some(_) if *made_with == plain => None,
        Some(text) => Some(format!("# to be completed, the test file is made with: {}", text.replace('\n', " "))),
    };
    Ok(remark.into_iter().chain([options.shell(PROGRAM, "generate")?]).collect())
}

/// The command for runs of a group on the same data; none where `--set` cannot say what differs, or the runs' machines
/// differ.
fn sweep(runs: &[StoredRun], group: &RunGroup) -> Option<CommandOptions> {
    let first = &runs[0];
    let machine = |run: &StoredRun| (threads(run), run.config.device.clone());
    if !runs.iter().all(|run| machine(run) == machine(first)) || !said_by_changes(first, group) {
        return None;
    }
    let seeds: Vec<_> = runs.iter().map(|run| run.config.seed.to_string()).collect();
    // 0 is what a run had that left the number to the machine and did not finish.
    let threads = Some(threads(first)).filter(|threads| *threads > 0);
    let options = CommandOptions::default().with("task", named(&group.task)).with("recipe", &group.recipe);
    let options = options.with("seeds", seeds.join(",")).with_each("set", &group.changes);
    let options = options.with_each("name", (!group.changes.is_empty()).then(|| name(group)));
    let options = options.with_each("threads-per-run", threads.map(|threads| threads.to_string()));
    let options = options.with("device", &first.config.device).with_each("data", data_folder(first));
    Some(options.with_each("out", runs_of_data(first, group)))
}

/// Where the runs on the data of a run go, if the usual place is that of several data sets or groups.
fn runs_of_data(run: &StoredRun, group: &RunGroup) -> Option<String> {
    let seed = run.data.as_ref().and_then(RunData::seed).filter(|_| group.datasets() > 1);
    let clips = group.clips.map(|clips| format!("/clips={clips}"));
    let folders: String = clips.into_iter().chain(seed.map(|seed| format!("/data={seed}"))).collect();
    (!folders.is_empty()).then(|| format!("runs{folders}"))
}

/// The command for one run. With the config of its record where `--set` cannot say what differs, or which alone holds its
/// task; what is changed goes to a folder of its own, the one that `sweep` would give it.
fn one(run: &StoredRun, group: &RunGroup, record: &Path) -> CommandOptions {
    let options = CommandOptions::default();
    let options = if is_built_in(&group.task) { options.with("task", &group.task.name) } else { options };
    let options = options.with("recipe", &group.recipe);
    let options = if is_built_in(&group.task) && said_by_changes(run, group) {
        options.with_each("set", &group.changes).with_each("data", data_folder(run))
    } else {
        options.with("config", record.join("config.toml"))
    };
    let (task, recipe, seed) = (&group.task.name, &group.recipe, run.config.seed);
    let runs = runs_of_data(run, group);
    let label = if group.changes.is_empty() { recipe.clone() } else { format!("{recipe}-{}", name(group)) };
    let usual = runs.is_none() && group.changes.is_empty();
    let out = (!usual).then(|| format!("{}/{task}/{label}/seed={seed}", runs.unwrap_or_else(|| "runs".into())));
    let options = options.with("seed", seed.to_string()).with_each("out", out);
    options.with("threads", threads(run).to_string()).with("device", &run.config.device)
}

/// Whether task, recipe and changes say all that the run's config does.
fn said_by_changes(run: &StoredRun, group: &RunGroup) -> bool {
    let said = choices_of(&run.config, &group.changes);
    said.is_some_and(|said| without_place(&said) == without_place(&run.config.choices))
}

/// Where the data of a run lie, if not in the usual place.
fn data_folder(run: &StoredRun) -> Option<String> {
    run.config.data_folder().filter(|folder| folder != USUAL_DATA)
}

/// Whether the programs know a task by its name.
fn is_built_in(task: &Task) -> bool {
    tasks::builtin(&task.name).is_some()
}

/// As which the programs are given a task.
fn named(task: &Task) -> String {
    if is_built_in(task) { task.name.clone() } else { format!("{}.toml", task.name) }
}

/// The name of a changed recipe.
fn name(group: &RunGroup) -> String {
    group.folder_name().unwrap_or_else(|| "changed".into())
}

/// What the run had, where the config leaves it to the machine.
fn threads(run: &StoredRun) -> usize {
    run.summary.as_ref().map_or(run.config.threads, |summary| summary.threads)
}
