//! What changes in a recipe do: ablations beside the plain recipe, and starts from other parameters.

use std::collections::BTreeMap;
use std::fmt::Write;

use anyhow::Result;

use super::groups::{Group, Purpose};
use super::markdown::{NONE, row, signed, spread, table, text};
use super::runs::{Loss, Run, Summary};
use super::states::{ENCODED, INITIAL_VELOCITY, unit};
use super::statistics::significant;

/// Sections for the tasks and recipes of which there are changed ones.
pub(super) fn write(page: &mut String, groups: &[Group]) -> Result<()> {
    for groups in groups.chunk_by(|a, b| a.task == b.task && a.recipe == b.recipe) {
        let plain = groups.iter().find(|group| group.purpose() == Purpose::Plain);
        let beside = |purpose| groups.iter().filter(|group| group.purpose() == purpose).collect::<Vec<_>>();
        let name = format!("{}, {}", text(groups[0].task.key), text(&groups[0].recipe));
        let ablations = beside(Purpose::Ablation);
        if !ablations.is_empty() {
            writeln!(page, "## Ablations of {name}\n")?;
            results(page, "changed", plain.into_iter().chain(ablations.iter().copied()))?;
        }
        let starts = beside(Purpose::Start);
        if !starts.is_empty() {
            writeln!(page, "## Other parameters at the start: {name}\n")?;
            writeln!(page, "Parameters that are not named start at 1.\n")?;
            results(page, "start", plain.into_iter().chain(starts.iter().copied()))?;
            if let Some(plain) = plain {
                seed_by_seed(page, plain, &starts)?;
            }
        }
    }
    Ok(())
}

/// A row for each group. The first column says what it changes.
fn results<'a>(page: &mut String, first: &str, groups: impl Iterator<Item = &'a Group> + Clone) -> Result<()> {
    let Some(any) = groups.clone().next() else { return Ok(()) };
    let mut head = vec![first.to_string()];
    for name in any.parameters() {
        head.extend([name.to_string(), format!("error of {name}")]);
    }
    let unit = unit(any);
    head.extend([Loss::Recons, Loss::Pred].map(|loss| loss.symbol().to_string()));
    head.extend([format!("initial velocity error, {unit} per time unit"), format!("encoded position error, {unit}")]);
    head.push("succeeded / tried".into());
    let rows: Vec<_> = groups
        .map(|group| {
            let change =
                if group.changes.is_empty() { "the recipe as it is".into() } else { text(&group.changes.join(", ")) };
            let mut cells = vec![change];
            for name in any.parameters() {
                cells.push(spread(group.parameter(name)));
                cells.push(group.error_percent(name).map_or(NONE.into(), |error| error.text(signed)));
            }
            cells.extend([Loss::Recons, Loss::Pred].map(|loss| spread(group.loss(loss))));
            cells.extend([INITIAL_VELOCITY, ENCODED].map(|error| spread(group.state_error(error))));
            cells.push(group.successes());
            row(&cells)
        })
        .collect();
    table(page, &head.iter().map(String::as_str).collect::<Vec<_>>(), &rows)
}

/// How far the starts lead from the same seed of the recipe as it is: from different objects to the same numbers says
/// less than from the same objects.
fn seed_by_seed(page: &mut String, plain: &Group, starts: &[&Group]) -> Result<()> {
    let mut pairs = 0;
    let mut farthest: BTreeMap<&str, f64> = BTreeMap::new();
    for (run, summary) in starts.iter().flat_map(|group| group.finished()) {
        let same_seed = |(other, _): &(&Run, &Summary)| other.config.seed == run.config.seed;
        let Some((_, same)) = plain.finished().find(same_seed) else { continue };
        pairs += 1;
        for name in plain.parameters() {
            if let (Some(here), Some(there)) = (summary.parameters.get(name), same.parameters.get(name)) {
                let farthest = farthest.entry(name).or_default();
                *farthest = farthest.max((here.learned - there.learned).abs());
            }
        }
    }
    if pairs > 0 {
        let apart = |by: f64| if by == 0.0 { "0 (the same bits)".to_string() } else { significant(by) };
        let farthest: Vec<_> = farthest.iter().map(|(name, by)| format!("{name} by {}", apart(*by))).collect();
        writeln!(
            page,
            "A seed finds the same objects whatever the start, so each run is to be compared with the same seed of the \
             recipe as it is: in {pairs} such pairs the parameters differ at most: {}.\n",
            farthest.join(", ")
        )?;
    }
    Ok(())
}
