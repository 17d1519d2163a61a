//! Is the paper reproducible as published? What the runs of its own protocol say, and no more.

use std::collections::BTreeMap;

use minijinja::{Value, context};

use super::criteria;
use super::groups::Group;
use super::protocol::protocol;
use crate::runs::run::Run;
use crate::tasks;
use crate::tasks::published::published;

/// How far the runs of the protocol got.
pub(super) fn view(groups: &[Group]) -> Value {
    let runs: Vec<&Run> = groups.iter().filter(|group| group.is_protocol()).flat_map(|group| &group.runs).collect();
    let count = |which: fn(&Run) -> bool| runs.iter().filter(|run| which(run)).count();
    let missing = tasks::all().filter(|task| published().knows(&task.name)).filter_map(|task| {
        let mut tried = runs.iter().filter(|run| run.config.task.name == task.name).peekable();
        let any = tried.peek().is_some();
        (!tried.any(|run| run.summary.is_some())).then(|| context! { task => task.name, tried => any })
    });
    context! {
        recipe => protocol().recipe.clone(),
        tried => runs.len(),
        finished => count(|run| run.summary.is_some()),
        // Finished with the paper's results.
        reached => count(criteria::reaches_paper),
        // Showed the objects at the last validation.
        found => count(|run| criteria::objects_found_last(run) == Some(true)),
        // Epochs of the run that got furthest.
        longest => runs.iter().filter_map(|run| run.epochs()).reduce(f64::max),
        directions => directions(&runs),
        // Tasks of the paper without a run that finished, and whether any was tried.
        missing => missing.collect::<Vec<_>>(),
    }
}

/// In how many runs each parameter ended nearer to its truth than it started.
fn directions(runs: &[&Run]) -> Vec<Value> {
    let mut counts: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
    for run in runs {
        for truth in &run.config.task.truth {
            let course = run.known_course().and_then(|course| course.start_middle_end(&truth.name));
            let Some([start, _, last]) = course else { continue };
            let (nearer, all) = counts.entry(&truth.name).or_default();
            *nearer += usize::from((last - truth.value).abs() < (start - truth.value).abs());
            *all += 1;
        }
    }
    let direction = |(symbol, (nearer, all))| context! { symbol => symbol, nearer => nearer, all => all };
    counts.into_iter().map(direction).collect()
}
