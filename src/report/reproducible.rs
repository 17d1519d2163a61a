//! Is the paper reproducible as published? What the runs of its own protocol say, and no more.

use std::collections::BTreeMap;
use std::fmt::Write;

use anyhow::Result;

use super::criteria;
use super::groups::{Group, Purpose};
use super::markdown::{NONE, row, show, table};
use super::pictures::Pictures;
use super::published::{self, EPOCHS};
use super::runs::Run;
use super::statistics::significant;

/// The recipe that is the paper's protocol.
const RECIPE: &str = "paper";
/// Whether a group is the paper's protocol, unchanged.
pub(super) fn is_protocol(group: &Group) -> bool {
    group.recipe == RECIPE && group.purpose() == Purpose::Plain
}

/// The answer in one paragraph.
pub(super) fn in_short(groups: &[Group]) -> String {
    answer(&groups.iter().filter(|group| is_protocol(group)).flat_map(|group| &group.runs).collect::<Vec<_>>())
}

pub(super) fn write(page: &mut String, groups: &[Group], pictures: &[Pictures]) -> Result<()> {
    writeln!(page, "## Is the paper reproducible as published?\n")?;
    let protocol: Vec<_> = groups.iter().zip(pictures).filter(|(group, _)| is_protocol(group)).collect();
    let runs: Vec<&Run> = protocol.iter().flat_map(|(group, _)| &group.runs).collect();
    writeln!(page, "{}\n", answer(&runs))?;
    if !runs.is_empty() {
        let rows: Vec<_> =
            protocol.iter().flat_map(|(group, _)| group.runs.iter().map(|run| course(group, run))).collect();
        writeln!(
            page,
            "Losses are those of the last validation. Parameters: at the start, half-way, at the last record, in true \
             pixels (1 in the model's own unit is less). Objects count as found if L_rec is below 1.5 (of digits it is \
             not said).\n"
        )?;
        let head = ["task", "seed", "steps", "epochs", "finished", "L_rec", "objects found", "L_pred", "parameters"];
        table(page, &head, &rows)?;
    }
    for picture in protocol.iter().flat_map(|(_, pictures)| &pictures.seeds) {
        show(page, picture)?;
    }
    reruns(page)?;
    missing(page, &runs)
}

/// The answer that the runs give, by how many finished and how many of these reached the paper's results.
fn answer(runs: &[&Run]) -> String {
    let finished: Vec<_> = runs.iter().filter(|run| run.summary.is_some()).collect();
    let reached = |run: &Run| run.summary.as_ref().is_some_and(|s| criteria::reaches_paper(&run.config, s));
    let reached = finished.iter().filter(|run| reached(run)).count();
    let found = runs.iter().filter(|run| found(run) == Some(true)).count();
    let so_far = format!("Objects were found in {found} of {} runs.{}", runs.len(), directions(runs));
    let longest = runs
        .iter()
        .filter_map(|run| run.epochs())
        .fold(None, |most: Option<f64>, e| Some(most.map_or(e, |m| m.max(e))));
    let longest = longest.map_or("an unknown number".into(), |epochs| format!("{:.1}", epochs));
    let reaching = "no parameter further from its truth than in the paper, and losses within the original's yardsticks";
    match (runs.len(), finished.len(), reached) {
        (0, ..) => format!("No run of the `{RECIPE}` recipe is among the runs given, so they say nothing to this."),
        (tried, 0, _) => format!(
            "**Not answered by these runs: none of {tried} went to the end.** The longest got to {longest} of {EPOCHS} \
             epochs. {so_far} What the parameters did until then is below; what they would have done after it is not \
             known."
        ),
        (tried, finished, 0) => format!(
            "**Not in these runs: of {tried} tried, {finished} finished their {EPOCHS} epochs, and none of these \
             reached the paper's results** ({reaching}). {so_far}"
        ),
        (tried, finished, _) => format!(
            "**In {reached} of the {finished} runs that finished their {EPOCHS} epochs ({tried} tried)**: {reaching}. \
             {so_far}"
        ),
    }
}

/// In how many runs each parameter ended nearer to its truth than it started, as sentences.
fn directions(runs: &[&Run]) -> String {
    let mut counts: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
    for run in runs {
        for truth in run.config.task.truth {
            let course = run.trace.as_ref().ok().and_then(|trace| trace.course(truth.name));
            let Some([start, _, last]) = course else { continue };
            let (nearer, all) = counts.entry(truth.name).or_default();
            *nearer += usize::from((last - truth.value).abs() < (start - truth.value).abs());
            *all += 1;
        }
    }
    let sentence = |(name, (nearer, all)): (&&str, &(usize, usize))| {
        format!(" At the last record {name} was nearer to its truth than at the start in {nearer} of {all}.")
    };
    counts.iter().map(sentence).collect()
}

/// None where no validation is on record, or nothing says when the objects count as found.
fn found(run: &Run) -> Option<bool> {
    criteria::objects_found(run.config.task, run.trace.as_ref().ok()?.last_validation("recons_loss")?)
}

/// How far one run went, and where it stood.
fn course(group: &Group, run: &Run) -> String {
    let trace = run.trace.as_ref().ok();
    let loss = |name: &str| trace.and_then(|trace| trace.last_validation(name)).map_or(NONE.into(), significant);
    let found = found(run).map_or(NONE, |found| if found { "yes" } else { "no" });
    let parameters: Vec<_> = group
        .parameters()
        .into_iter()
        .filter_map(|name| {
            let truth = group.task.truth.iter().find(|truth| truth.name == name).map(|truth| truth.value);
            Some(movement(name, trace?.course(name)?, truth))
        })
        .collect();
    let parameters = if parameters.is_empty() { NONE.into() } else { parameters.join("; ") };
    let finished = if run.summary.is_some() { "yes" } else { "no, cut off" };
    let epochs = run.epochs().map_or(NONE.into(), |epochs| format!("{epochs:.1} of {EPOCHS}"));
    let steps = run.steps().map_or(NONE.into(), |steps| steps.to_string());
    let (recons, pred) = (loss("recons_loss"), loss("pred_loss"));
    row(&[group.task.key, &run.config.seed.to_string(), &steps, &epochs, finished, &recons, found, &pred, &parameters])
}

/// `k 1.000 → 0.6120 → 0.3100, away from its truth 4`.
fn movement(name: &str, course: [f64; 3], truth: Option<f64>) -> String {
    let values = course.map(significant).join(" → ");
    let [start, _, last] = course;
    let Some(truth) = truth else { return format!("{name} {values}") };
    let direction = match (last - truth).abs().total_cmp(&(start - truth).abs()) {
        std::cmp::Ordering::Less => "nearer to",
        std::cmp::Ordering::Equal => "as far as at the start from",
        std::cmp::Ordering::Greater => "further from",
    };
    format!("{name} {values}, {direction} its truth {truth}")
}

/// What others got.
fn reruns(page: &mut String) -> Result<()> {
    let parameters = published::RERUN_PARAMETERS.map(|(name, value)| format!("{name} = {value}")).join(", ");
    writeln!(
        page,
        "Published reruns, {}, test losses; the TF original's learned {parameters}:\n",
        published::RERUN_TASK
    )?;
    let rows: Vec<_> = published::RERUNS
        .iter()
        .map(|rerun| {
            row(&[rerun.who.to_string(), rerun.recons.to_string(), rerun.pred.to_string(), rerun.extrap.to_string()])
        })
        .collect();
    table(page, &["who", "L_rec", "L_pred", "L_extrap"], &rows)
}

/// What was not run.
fn missing(page: &mut String, runs: &[&Run]) -> Result<()> {
    let mut tasks = Vec::new();
    for task in published::tasks() {
        let finished = runs.iter().any(|run| run.config.task == task && run.summary.is_some());
        let tried = runs.iter().any(|run| run.config.task == task);
        if !finished {
            tasks.push(format!("{} ({})", task.key, if tried { "not to its end" } else { "not at all" }));
        }
    }
    if !tasks.is_empty() {
        writeln!(page, "Not run with this recipe: {}.\n", tasks.join(", "))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_direction_is_that_of_the_distance_to_the_truth() {
        assert_eq!(movement("k", [1.0, 0.6, 0.3], Some(4.0)), "k 1.000 → 0.6000 → 0.3000, further from its truth 4");
        assert_eq!(movement("k", [1.0, 2.0, 5.0], Some(4.0)), "k 1.000 → 2.000 → 5.000, nearer to its truth 4");
        assert!(movement("l", [1.0, 1.0, 1.0], Some(6.0)).contains("as far as at the start"));
        assert_eq!(answer(&[]), "No run of the `paper` recipe is among the runs given, so they say nothing to this.");
    }
}
