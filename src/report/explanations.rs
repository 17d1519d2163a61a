//! Where the paper's errors come from: two explanations, each tried by switching its cause on and off.

use std::fmt::Write;

use anyhow::Result;

use super::criteria;
use super::groups::{Group, Purpose};
use super::markdown::{NONE, row, signed, spread, table, text};
use super::published;
use super::runs::{Loss, Summary};
use super::states::{INITIAL_VELOCITY, VELOCITY_SLOPE};
use super::statistics::Spread;
use super::verdicts::{self, Effect, REFINEMENT_RULE, SHIFT_RULE, Verdict};
use crate::network::cells::PhysicalParameter;
use crate::tasks::Task;

const ORIGINAL_SHIFT: &str = "model.exact_shift=false";
const NO_REFINEMENT: &str = "model.refinement_steps=0";

/// What the groups say to either explanation.
#[derive(Debug)]
pub(super) struct Explanations<'a> {
    shifts: Vec<Shift<'a>>,
    velocities: Vec<Velocity<'a>>,
}

/// The decoder's scale: a length of the model's own unit is (S-1)/S pixels.
#[derive(Debug)]
struct Shift<'a> {
    exact: &'a Group,
    original: &'a Group,
    parameter: &'static PhysicalParameter,
    /// The model's own value over the truth: with the original's shift, what the scale alone would make of it, and with
    /// the exact shift.
    own: Spread,
    expected: f64,
    with_exact: Spread,
    verdict: Verdict,
}

/// The velocity estimator, without the refinement under the physics and with it.
#[derive(Debug)]
struct Velocity<'a> {
    with: &'a Group,
    without: &'a Group,
    /// The parameter that a force depends on first; none of a system that has none.
    parameter: Option<&'static PhysicalParameter>,
    lost: usize,
    /// None where the paper reports no such parameter.
    verdict: Option<Verdict>,
}

impl<'a> Explanations<'a> {
    pub(super) fn of(groups: &'a [Group]) -> Self {
        let mut found = Explanations { shifts: Vec::new(), velocities: Vec::new() };
        for groups in groups.chunk_by(|a, b| a.task == b.task && a.recipe == b.recipe) {
            let Some(plain) = groups.iter().find(|group| group.purpose() == Purpose::Plain) else { continue };
            for changed in groups.iter().filter(|group| group.finished().next().is_some()) {
                if changed.changes == [ORIGINAL_SHIFT] {
                    found.shifts.extend(plain.learned().filter_map(|parameter| Shift::of(plain, changed, parameter)));
                }
                found.velocities.extend(Velocity::of(plain, groups, changed));
            }
        }
        found
    }

    /// Explanation, parameter and verdict of everything that could be judged, a clause for each explanation and verdict.
    pub(super) fn in_short(&self) -> Option<String> {
        let shifts = self.shifts.iter().map(|shift| (shift.verdict, name(shift.exact.task, shift.parameter)));
        let judged = |velocity: &Velocity| Some((velocity.verdict?, name(velocity.with.task, velocity.parameter?)));
        let velocities = self.velocities.iter().filter_map(judged);
        let said: Vec<_> = [
            ("the decoder's unit of length", verdicts_in_short(shifts)),
            ("the estimated velocity", verdicts_in_short(velocities)),
        ]
        .into_iter()
        .filter_map(|(explanation, verdicts)| Some(format!("From {explanation}: {}", verdicts?)))
        .collect();
        (!said.is_empty()).then(|| said.join(". "))
    }

    /// The section, if there is anything to say.
    pub(super) fn write(&self, page: &mut String) -> Result<()> {
        if self.shifts.is_empty() && self.velocities.is_empty() {
            return Ok(());
        }
        writeln!(page, "## Where the paper's errors come from\n")?;
        self.shifts(page)?;
        self.velocities(page)
    }

    fn shifts(&self, page: &mut String) -> Result<()> {
        if self.shifts.is_empty() {
            return Ok(());
        }
        writeln!(page, "### The decoder's unit of length\n")?;
        writeln!(
            page,
            "The original's decoder moves a sprite by (S-1)/S pixels for one unit of position, S being the frame's side \
             (`{ORIGINAL_SHIFT}`). What the model then takes for a length is too large by S/(S-1), and what goes with a \
             power of a length by that power. All columns are the model's own value over the truth.\n"
        )?;
        let rows: Vec<_> = self.shifts.iter().map(Shift::row).collect();
        let head = [
            "task",
            "",
            "paper",
            "original's shift",
            "what the scale alone makes",
            "exact shift",
            "seeds: original's, exact",
            "verdict",
        ];
        table(page, &head, &rows)?;
        Ok(writeln!(page, "Rule: {SHIFT_RULE}.\n")?)
    }

    fn velocities(&self, page: &mut String) -> Result<()> {
        if self.velocities.is_empty() {
            return Ok(());
        }
        writeln!(page, "### The estimated velocity\n")?;
        writeln!(
            page,
            "The original's estimator sees one object at a time, and the roll-out starts from what it says; ours is \
             refined under the physics unless `{NO_REFINEMENT}`. Below each training without the refinement stands the \
             same training with it, where there are such runs, otherwise the recipe as it is. The slope is how many times \
             the true velocity is estimated at the last input frame (least squares), the velocity's error in pixels \
             (radians) per time unit.\n"
        )?;
        let rows: Vec<_> = self.velocities.iter().flat_map(Velocity::rows).collect();
        let head =
            ["task", "training", "slope", "velocity's error", "L_pred", "", "its error", "paper", "seeds", "verdict"];
        table(page, &head, &rows)?;
        Ok(writeln!(page, "Rule: {REFINEMENT_RULE}.\n")?)
    }
}

impl<'a> Shift<'a> {
    fn of(exact: &'a Group, original: &'a Group, parameter: &'static PhysicalParameter) -> Option<Self> {
        let truth = original.truth(parameter.name)?;
        let expected = 1.0 / original.own_unit(parameter)?;
        let own = original.parameter(parameter.name)?.times(expected / truth);
        let with_exact = exact.parameter(parameter.name)?.times(1.0 / truth);
        let verdict = verdicts::shift(own.median, expected, with_exact.median);
        Some(Shift { exact, original, parameter, own, expected, with_exact, verdict })
    }

    fn row(&self) -> String {
        let digits = |value: f64| format!("{value:.4}");
        let task = self.exact.task;
        let paper = published::parameter(task.key, self.parameter.name);
        row(&[
            task.key.into(),
            self.parameter.name.into(),
            paper.map_or(NONE.into(), |paper| digits(paper.learned / paper.truth)),
            self.own.text(digits),
            digits(self.expected),
            self.with_exact.text(digits),
            counts(self.original, self.exact),
            self.verdict.word().into(),
        ])
    }
}

impl<'a> Velocity<'a> {
    /// None of a group that is not trained without the refinement, or changes more than its training.
    fn of(plain: &'a Group, groups: &'a [Group], without: &'a Group) -> Option<Self> {
        without.changes.iter().find(|change| *change == NO_REFINEMENT)?;
        let rest: Vec<_> = without.changes.iter().filter(|change| *change != NO_REFINEMENT).cloned().collect();
        let of_training = |change: &String| ["join.", "identify."].iter().any(|section| change.starts_with(section));
        if !rest.iter().all(of_training) {
            return None;
        }
        // An estimator that has to do all by itself learns longer: the same training is what to compare with.
        let control = groups.iter().find(|group| group.changes == rest && group.finished().next().is_some());
        let with = control.unwrap_or(plain);
        let parameter = plain.learned().next();
        let lost = without.finished().filter(|(_, summary)| lost(plain.task, summary)).count();
        let verdict = parameter.and_then(|parameter| {
            let paper = published::parameter(plain.task.key, parameter.name)?;
            let with = effect(with, parameter.name)?;
            Some(verdicts::refinement(&with, &effect(without, parameter.name)?, lost, paper.error_percent()))
        });
        Some(Velocity { with, without, parameter, lost, verdict })
    }

    /// Without the refinement, and with it.
    fn rows(&self) -> [String; 2] {
        let task = self.with.task;
        let paper = self.parameter.and_then(|parameter| published::parameter(task.key, parameter.name));
        let verdict = match (self.verdict, self.lost) {
            (Some(verdict), 0) => verdict.word().into(),
            (Some(verdict), lost) => format!("{} ({lost} lost the objects)", verdict.word()),
            (None, _) => NONE.into(),
        };
        let row_of = |head: [String; 2], group: &Group, tail: [String; 2]| {
            let [paper, verdict] = tail;
            let error = self.parameter.and_then(|parameter| group.error_percent(parameter.name));
            let numbers = [
                spread(group.state_error(VELOCITY_SLOPE)),
                spread(group.state_error(INITIAL_VELOCITY)),
                spread(group.loss(Loss::Pred)),
                self.parameter.map_or(NONE, |parameter| parameter.name).into(),
                error.map_or(NONE.into(), |error| error.text(signed)),
                paper,
                group.finished().count().to_string(),
                verdict,
            ];
            row(&[&head[..], &numbers].concat())
        };
        let paper = paper.map_or(NONE.into(), |paper| signed(paper.error_percent()));
        let with = if self.with.changes.is_empty() {
            "with: the recipe as it is"
        } else {
            "with: otherwise the same training"
        };
        [
            row_of([task.key.into(), text(&self.without.label)], self.without, [paper, verdict]),
            row_of(["".into(), with.into()], self.with, ["".into(), "".into()]),
        ]
    }
}

/// What a group says of the velocity and of a parameter.
fn effect(group: &Group, name: &str) -> Option<Effect> {
    Some(Effect {
        velocity: group.state_error(INITIAL_VELOCITY)?,
        error: group.error_percent(name)?,
        error_size: group.spread(|summary| Some(summary.error_percent(name)?.abs()))?,
    })
}

/// Whether a run does not show its objects; one without L_rec does not.
fn lost(task: &Task, summary: &Summary) -> bool {
    let loss = summary.test.loss(Loss::Recons).unwrap_or(f64::NAN);
    criteria::objects_found(task, loss) == Some(false)
}

fn name(task: &Task, parameter: &PhysicalParameter) -> String {
    format!("{} of {}", parameter.name, task.key)
}

/// Finished runs of two groups.
fn counts(first: &Group, second: &Group) -> String {
    format!("{}, {}", first.finished().count(), second.finished().count())
}

/// `**confirmed** for k of spring_color, ..; **refuted** for ..`, with how many of its trainings say so where not all do;
/// none of nothing.
fn verdicts_in_short(judged: impl Iterator<Item = (Verdict, String)>) -> Option<String> {
    let judged: Vec<_> = judged.collect();
    let count = |verdict: Option<Verdict>, name: &str| {
        judged.iter().filter(|(other, of)| of == name && verdict.is_none_or(|verdict| verdict == *other)).count()
    };
    let clauses: Vec<_> = [Verdict::Confirmed, Verdict::Refuted, Verdict::Undecided]
        .into_iter()
        .filter_map(|verdict| {
            let mut names: Vec<_> =
                judged.iter().filter(|(other, _)| *other == verdict).map(|(_, name)| name).collect();
            names.dedup();
            let said = names.into_iter().map(|name| match (count(Some(verdict), name), count(None, name)) {
                (of, all) if of == all => name.clone(),
                (of, all) => format!("{name} ({of} of {all} trainings)"),
            });
            let said: Vec<_> = said.collect();
            (!said.is_empty()).then(|| format!("**{}** for {}", verdict.word(), said.join(", ")))
        })
        .collect();
    (!clauses.is_empty()).then(|| clauses.join("; "))
}
