//! The commands that make the data and the runs again.

use anyhow::{Context, Result};

use super::groups::Group;
use super::runs::Run;
use crate::generators::{Counts, plain_test_settings};

/// Where data lie if the config says nothing else, in TOML's notation.
const DATA_FOLDER: &str = "\"data/datasets\"";

/// All commands of a group in a shell's notation, one a line: the data, all runs at once, and each run by itself.
pub(super) fn commands(group: &Group) -> Result<Vec<String>> {
    let mut lines = data(group)?;
    if let Some(sweep) = sweep(group)? {
        lines.extend(["# all runs:".into(), sweep, "# or one by one:".into()]);
    }
    for run in &group.runs {
        lines.push(one(run, group)?);
    }
    Ok(lines)
}

/// The data of all runs: mostly one command.
fn data(group: &Group) -> Result<Vec<String>> {
    let mut lines: Vec<String> = Vec::new();
    for run in &group.runs {
        for line in generate(run)? {
            if !lines.contains(&line) {
                lines.push(line);
            }
        }
    }
    Ok(lines)
}

fn generate(run: &Run) -> Result<Vec<String>> {
    let task = run.config.task;
    let mut words = vec!["generate".to_string(), "--task".into(), task.key.into()];
    let mut option = |name: &str, value: String| words.extend([format!("--{name}"), value]);
    if let Some(folder) = run.config.choices.get("data.folder").filter(|folder| *folder != DATA_FOLDER) {
        option("out", folder.trim_matches('"').into());
    }
    let made_with = run.data.as_ref().and_then(|data| data.made_with.as_deref());
    let seed = made_with.and_then(seed);
    if let Some(data) = &run.data {
        option("train", data.training_clips.to_string());
        option("valid", data.validation_clips.to_string());
        option("test", data.test_clips.to_string());
    }
    if let Some(seed) = seed {
        option("seed", seed.to_string());
    }
    let plain = match (&run.data, seed) {
        (Some(data), Some(seed)) => {
            let [train, valid, test] =
                [data.training_clips, data.validation_clips, data.test_clips].map(|clips| clips as usize);
            Some(plain_test_settings(task, Counts { train, valid, test }, seed)?)
        }
        _ => None,
    };
    let mut lines = Vec::new();
    match made_with {
        None => lines.push("# no run says how these data were made:".into()),
        Some(text) if plain.as_deref() != Some(text) => {
            lines.push(format!("# to be completed, the test file is made with: {}", text.replace('\n', " ")));
        }
        Some(_) => {}
    }
    lines.push(join(&words)?);
    Ok(lines)
}

/// The seed in a dataset's settings: `.., seed 0, ..`.
fn seed(made_with: &str) -> Option<u64> {
    made_with.split(", ").find_map(|part| part.strip_prefix("seed ")?.parse().ok())
}

/// The command for all runs of a group; none where `--set` cannot say what differs, or the runs' machines differ.
fn sweep(group: &Group) -> Result<Option<String>> {
    let first = &group.runs[0];
    let alike = |run: &Run| threads(run) == threads(first) && run.config.device == first.config.device;
    if !group.runs.iter().all(alike) || first.config.said(&group.changes).as_ref() != Some(&first.config.choices) {
        return Ok(None);
    }
    let seeds: Vec<_> = group.runs.iter().map(|run| run.config.seed.to_string()).collect();
    let mut words = vec!["sweep".to_string()];
    let mut option = |name: &str, value: String| words.extend([format!("--{name}"), value]);
    option("task", group.task.key.into());
    option("recipe", group.recipe.clone());
    option("seeds", seeds.join(","));
    group.changes.iter().for_each(|change| option("set", change.clone()));
    if !group.changes.is_empty() {
        option("name", name(group));
    }
    // 0 is what a run had that left the number to the machine and did not finish.
    if threads(first) > 0 {
        option("threads-per-run", threads(first).to_string());
    }
    option("device", first.config.device.clone());
    join(&words).map(Some)
}

/// The command for one run. With its own config file where `--set` cannot say what differs; what is changed goes to a
/// folder of its own, the one that `sweep` would give it.
fn one(run: &Run, group: &Group) -> Result<String> {
    let (config, changes) = (&run.config, &group.changes);
    let mut words = vec!["run_physics".to_string()];
    let mut option = |name: &str, value: String| words.extend([format!("--{name}"), value]);
    option("task", config.task.key.into());
    option("recipe", config.recipe.clone());
    if config.said(changes).as_ref() == Some(&config.choices) {
        changes.iter().for_each(|change| option("set", change.clone()));
    } else {
        option("config", run.folder.join("config.toml").display().to_string());
    }
    option("seed", config.seed.to_string());
    if !changes.is_empty() {
        option("out", format!("runs/{}/{}-{}/seed={}", config.task.key, config.recipe, name(group), config.seed));
    }
    option("threads", threads(run).to_string());
    option("device", config.device.clone());
    join(&words)
}

/// The name of a changed recipe.
fn name(group: &Group) -> String {
    group.folder_name().unwrap_or_else(|| "changed".into())
}

/// What the run had, where the config leaves it to the machine.
fn threads(run: &Run) -> usize {
    run.summary.as_ref().map_or(run.config.threads, |summary| summary.threads)
}

fn join(words: &[String]) -> Result<String> {
    shlex::try_join(words.iter().map(String::as_str)).context("a command line")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_seed_of_the_data_is_read_from_their_settings() {
        assert_eq!(seed("generator 1, task spring_color, seed 7, clips 10+10+500 of 30 frames, side 32"), Some(7));
        assert_eq!(seed("made by hand"), None);
    }
}
