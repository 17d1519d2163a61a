//! What changes in a recipe do: ablations beside the plain recipe, and starts from other parameters.

use std::collections::BTreeMap;
use std::fmt::Write;

use anyhow::Result;

use super::criteria;
use super::groups::{Group, Purpose};
use super::markdown::{NONE, code, row, signed, spread, table, text};
use super::published;
use super::runs::{Loss, Run, Summary};
use super::states::{ENCODED, INITIAL_VELOCITY, VELOCITY_SLOPE, unit};
use super::statistics::significant;
use super::verdicts::{self, Effect, REFINEMENT_RULE, SHIFT_RULE};
use crate::cells::PhysicalParameter;
use crate::tasks::Task;

const ORIGINAL_SHIFT: &str = "model.exact_shift=false";
const NO_REFINEMENT: &str = "model.refinement_steps=0";

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
            if let Some(plain) = plain {
                explanations(page, plain, &ablations)?;
            }
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

/// Says whether the paper's errors come from where the recipe takes them to come from.
fn explanations(page: &mut String, plain: &Group, ablations: &[&Group]) -> Result<()> {
    let alone = |change: &str| ablations.iter().find(|group| group.changes == [change]);
    if let Some(changed) = alone(ORIGINAL_SHIFT) {
        for parameter in plain.learned() {
            shift(page, plain, changed, parameter)?;
        }
    }
    for changed in ablations.iter().filter(|group| group.changes.iter().any(|change| change == NO_REFINEMENT)) {
        // A velocity estimator that has to do all by itself learns longer: the same training with the refinement, if
        // there is one, is what to compare with.
        let rest: Vec<_> = changed.changes.iter().filter(|change| *change != NO_REFINEMENT).cloned().collect();
        let of_training = rest.iter().all(|change| change.starts_with("join."));
        let control = ablations.iter().find(|group| group.changes == rest).copied().unwrap_or(plain);
        if let Some(parameter) = plain.learned().next().filter(|_| of_training) {
            refinement(page, control, changed, parameter.name)?;
        }
    }
    Ok(())
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

/// The decoder's scale: a length of the model's own unit is (S-1)/S pixels.
fn shift(page: &mut String, plain: &Group, changed: &Group, parameter: &PhysicalParameter) -> Result<()> {
    let name = parameter.name;
    let (exact, reported) = (plain.parameter(name), changed.parameter(name));
    let (Some(exact), Some(reported), Some(truth)) = (exact, reported, changed.truth(name)) else { return Ok(()) };
    let Some(unit) = changed.own_unit(parameter) else { return Ok(()) };
    let (side, expected) = (plain.task.side, 1.0 / unit);
    let raw = reported.times(expected);
    let verdict = verdicts::shift(raw.median / truth, expected, exact.median / truth);
    let digits = |value: f64| format!("{value:.4}");
    writeln!(
        page,
        "**The decoder's coordinate scale as the source of the error of {name}: {}.** With `{ORIGINAL_SHIFT}` a \
         position is counted in units of (S-1)/S = {}/{} pixels. Converted to true pixels {name} is {}; the model's \
         own value is {}, that is {} of the truth, where the scale alone makes {expected:.4}. With the exact shift it \
         is {} of the truth. {}Seeds: {} and {}. Rule: {SHIFT_RULE}.\n",
        verdict.word(),
        side - 1,
        side,
        reported.text(significant),
        raw.text(significant),
        raw.times(1.0 / truth).text(digits),
        exact.times(1.0 / truth).text(digits),
        paper(plain, name),
        changed.finished().count(),
        plain.finished().count(),
    )?;
    Ok(())
}

/// The velocity estimator: its error without the refinement under the physics.
fn refinement(page: &mut String, plain: &Group, changed: &Group, name: &str) -> Result<()> {
    let Some(published) = published::parameter(plain.task.key, name) else { return Ok(()) };
    let effect = |group: &Group| {
        Some(Effect {
            velocity: group.state_error(INITIAL_VELOCITY)?,
            error: group.error_percent(name)?,
            error_size: group.spread(|summary| Some(summary.error_percent(name)?.abs()))?,
            lost: group.finished().filter(|(_, summary)| lost(group.task, summary)).count(),
        })
    };
    let (Some(with), Some(without)) = (effect(plain), effect(changed)) else { return Ok(()) };
    let unit = unit(plain);
    writeln!(
        page,
        "**The estimated velocity as the source of the error of {name}: {}.** With {} the initial velocity is off by {} \
         {unit} per time unit{} and {name} by {}; with the refinement ({}) by {}{} and {}. {}{}Seeds: {} and {}. Rule: \
         {REFINEMENT_RULE}.\n",
        verdicts::refinement(&with, &without, published.error_percent()).word(),
        code(&changed.changes.join(", ")),
        without.velocity.text(significant),
        slope(changed),
        without.error.text(signed),
        if plain.changes.is_empty() { "the recipe as it is".into() } else { code(&plain.changes.join(", ")) },
        with.velocity.text(significant),
        slope(plain),
        with.error.text(signed),
        if without.lost > 0 {
            format!("Without it {} of the runs lost their objects. ", without.lost)
        } else {
            String::new()
        },
        paper(plain, name),
        changed.finished().count(),
        plain.finished().count(),
    )?;
    Ok(())
}

/// Whether a run does not show its objects; one without L_rec does not.
fn lost(task: &Task, summary: &Summary) -> bool {
    let loss = summary.test.loss(Loss::Recons).unwrap_or(f64::NAN);
    criteria::objects_found(task, loss) == Some(false)
}

/// How many times the true velocity is estimated, as a remark; empty of runs that do not say it.
fn slope(group: &Group) -> String {
    let slope = group.state_error(VELOCITY_SLOPE);
    slope.map_or(String::new(), |slope| format!(" (the true one times {})", slope.text(significant)))
}

/// What the paper reports, as a sentence; empty if it does not.
fn paper(group: &Group, name: &str) -> String {
    published::parameter(group.task.key, name)
        .map_or(String::new(), |row| format!("The paper's {name} is off by {}. ", signed(row.error_percent())))
}
