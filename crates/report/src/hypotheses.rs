//! Where the paper's errors come from: hypotheses, and what the groups of runs say to them.
//!
//! The hypotheses and the rules of their verdicts are `reports/hypotheses.toml`, which explains itself.

use std::sync::LazyLock;

use anyhow::Result;
use minijinja::{Value, context};
use serde::{Deserialize, Serialize};

use super::groups::{GroupRole, RunGroup, original_unit};
use super::template::{evaluate, fill};
use super::view::{self, value};
use paig::network::cells::PhysicalParameter;

/// All of the file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Hypotheses {
    hypotheses: Vec<Hypothesis>,
}

/// A cause of errors that a change of the config switches on.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Hypothesis {
    title: String,
    cause: String,
    text: String,
    /// The change, as `section.key=value`.
    switch: String,
    /// Beginnings of the keys that may be changed besides.
    besides: Vec<String>,
    parameters: Which,
    /// The rule in words.
    rule: String,
    /// Numbers without which there is no verdict.
    needs: Vec<String>,
    verdicts: Vec<VerdictRule>,
    /// For each column of the table its head and its cell in each line of a comparison.
    columns: Vec<Vec<String>>,
}

/// The parameters that a hypothesis is held against.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Which {
    /// All whose unit holds a power of a length.
    OfLength,
    /// The first one that is learned, or none.
    First,
}

/// A verdict and its condition.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct VerdictRule {
    verdict: HypothesisVerdict,
    /// Stands in brackets after the verdict.
    note: Option<String>,
    #[serde(rename = "if")]
    condition: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum HypothesisVerdict {
    Confirmed,
    Refuted,
    Undecided,
}

static HYPOTHESES: LazyLock<Hypotheses> =
    LazyLock::new(|| toml::from_str(include_str!("../../../reports/hypotheses.toml")).expect("a test reads this file"));

/// Places of a group with the cause and of its control, and the parameter they are compared by, if there is one.
type ComparedGroups<'a> = (usize, usize, Option<&'a PhysicalParameter>);

/// What the groups say to each hypothesis to which they say anything: its table, and of each comparison what it is on and
/// the verdict. `views`: of the groups.
pub(super) fn findings(groups: &[RunGroup], views: &[Value]) -> Result<Vec<Value>> {
    let mut findings = Vec::new();
    for hypothesis in &HYPOTHESES.hypotheses {
        let (mut rows, mut verdicts) = (Vec::new(), Vec::new());
        for (changed, control, parameter) in hypothesis.comparisons(groups) {
            let task = &groups[changed].task;
            let of = |place: usize| context! { parameter => view::parameter(&groups[place], parameter), ..views[place].clone() };
            let numbers = context! {
                symbol => parameter.map(|parameter| &*parameter.name),
                expected => parameter.map(|parameter| 1.0 / original_unit(task, parameter)),
                paper => view::paper(task, parameter),
                changed => of(changed),
                control => of(control),
            };
            let (verdict, note) = hypothesis.verdict(&numbers)?.unzip();
            let numbers = context! { verdict => value(verdict), note => note, ..numbers };
            for line in 1..hypothesis.columns[0].len() {
                let cells = hypothesis.columns.iter().map(|column| fill(&column[line], &numbers));
                rows.push(cells.collect::<Result<Vec<_>>>()?);
            }
            if let (Some(verdict), Some(parameter)) = (verdict, parameter) {
                let on = format!("{} of {}", parameter.name, task.name);
                verdicts.push(context! { verdict => value(verdict), on => on });
            }
        }
        if !rows.is_empty() {
            findings.push(context! { hypothesis => value(hypothesis), rows => rows, verdicts => verdicts });
        }
    }
    Ok(findings)
}

impl Hypothesis {
    /// All groups that have the cause, each with its control: the one of the same recipe with the same other changes, or
    /// else the recipe as it is.
    fn comparisons<'a>(&self, groups: &'a [RunGroup]) -> Vec<ComparedGroups<'a>> {
        let ran = |group: &RunGroup| group.finished().next().is_some();
        let mut comparisons = Vec::new();
        for (place, changed) in groups.iter().enumerate().filter(|(_, group)| ran(group)) {
            let (switch, others): (Vec<_>, Vec<_>) =
                changed.changes.iter().cloned().partition(|change| *change == self.switch);
            let beside = |change: &String| self.besides.iter().any(|section| change.starts_with(section));
            let among = |which: &dyn Fn(&RunGroup) -> bool| {
                let alike = |group: &RunGroup| group.task == changed.task && group.recipe == changed.recipe;
                groups.iter().position(|group| alike(group) && which(group))
            };
            let same = among(&|group| ran(group) && group.changes == others);
            let Some(control) = same.or_else(|| among(&|group| group.role() == GroupRole::Plain)) else { continue };
            if switch.is_empty() || !others.iter().all(beside) {
                continue;
            }
            let parameters: Vec<_> = match self.parameters {
                Which::First => vec![changed.learned().next()],
                Which::OfLength => changed.learned().filter(|p| p.length_power != 0).map(Some).collect(),
            };
            comparisons.extend(parameters.into_iter().map(|parameter| (place, control, parameter)));
        }
        comparisons
    }

    /// The verdict of the first rule that holds, with its note; none where a number is missing.
    fn verdict(&self, numbers: &Value) -> Result<Option<(HypothesisVerdict, String)>> {
        for need in &self.needs {
            if evaluate(need, numbers)?.is_none() {
                return Ok(None);
            }
        }
        for VerdictRule { verdict, note, condition } in &self.verdicts {
            if evaluate(condition, numbers)?.is_true() {
                let note = note.as_ref().map_or(Ok(String::new()), |note| fill(note, numbers))?;
                return Ok(Some((*verdict, note)));
            }
        }
        Ok(Some((HypothesisVerdict::Undecided, String::new())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use paig::support::statistics::Spread;

    fn verdict(cause: &str, numbers: &Value) -> HypothesisVerdict {
        let hypothesis = HYPOTHESES.hypotheses.iter().find(|hypothesis| hypothesis.cause.contains(cause)).unwrap();
        hypothesis.verdict(numbers).unwrap().unwrap().0
    }

    #[test]
    fn the_tables_have_a_cell_for_each_head_and_line() {
        for Hypothesis { columns, .. } in &HYPOTHESES.hypotheses {
            assert!(columns.iter().all(|column| column.len() == columns[0].len() && column.len() > 1));
        }
        let misspelt = include_str!("../../../reports/hypotheses.toml").replace("besides =", "beside =");
        assert!(toml::from_str::<Hypotheses>(&misspelt).is_err());
    }

    #[test]
    fn the_scale_explains_an_excess_or_not() {
        let of = |ratio: f64| context! { parameter => context! { ratio => value(Spread::of([ratio])) } };
        let scale = |raw: f64, exact: f64| {
            let numbers = context! { expected => 32.0 / 31.0, changed => of(raw), control => of(exact) };
            verdict("unit of length", &numbers)
        };
        assert_eq!(scale(1.032, 1.0003), HypothesisVerdict::Confirmed);
        assert_eq!(scale(1.026, 0.995), HypothesisVerdict::Confirmed);
        // The excess is there, but with the exact shift as well.
        assert_eq!(scale(1.032, 1.03), HypothesisVerdict::Undecided);
        assert_eq!(scale(1.001, 1.0), HypothesisVerdict::Refuted);
        assert_eq!(scale(1.016, 1.0), HypothesisVerdict::Undecided);
        assert_eq!(scale(1.5, 1.0), HypothesisVerdict::Undecided);
    }

    #[test]
    fn the_velocity_explains_an_error_or_not() {
        let of = |velocity: [f64; 3], error: [f64; 3], lost: usize| {
            let (errors, sizes) = (value(Spread::of(error)), value(Spread::of(error.map(f64::abs))));
            let states = context! { initial_velocity => value(Spread::of(velocity)) };
            context! { lost => lost, states => states, parameter => context! { error => errors, error_size => sizes } }
        };
        let velocity = |velocity: [f64; 3], error: [f64; 3], lost: usize| {
            let with = of([0.20, 0.21, 0.24], [-0.2, -0.1, -0.3], 0);
            let paper = context! { error => 6.5 };
            verdict("velocity", &context! { paper => paper, changed => of(velocity, error, lost), control => with })
        };
        let slow = [0.9, 1.0, 1.1];
        assert_eq!(velocity(slow, [4.0, 6.0, 5.0], 0), HypothesisVerdict::Confirmed);
        assert_eq!(velocity(slow, [-4.0, -6.0, -5.0], 0), HypothesisVerdict::Refuted);
        assert_eq!(velocity(slow, [0.1, 0.1, 0.0], 0), HypothesisVerdict::Refuted);
        // No objects, no parameter.
        assert_eq!(velocity(slow, [4.0, 6.0, 5.0], 1), HypothesisVerdict::Undecided);
        // Larger, but far too small.
        assert_eq!(velocity(slow, [1.4, 1.2, 1.7], 0), HypothesisVerdict::Refuted);
        // One seed is as good as with the refinement.
        assert_eq!(velocity(slow, [4.0, 6.0, 0.1], 0), HypothesisVerdict::Undecided);
        // A larger error, but not from the velocity.
        assert_eq!(velocity([0.2, 0.2, 0.2], [4.0, 6.0, 5.0], 0), HypothesisVerdict::Undecided);
    }
}
