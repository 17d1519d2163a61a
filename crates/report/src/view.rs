//! What the report's template sees: the numbers of all tasks, groups, parameters and runs.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::Result;
use minijinja::{Value, context};
use serde::Serialize;

use super::commands::commands;
use super::criteria;
use super::groups::{GroupRole, RunGroup};
use super::pictures::GroupPictures;
use super::times::TimeToAnswer;
use paig::network::cells::PhysicalParameter;
use paig::network::physics_models::losses::Loss;
use paig::runs::run::{RunData, StoredRun};
use paig::runs::summary::{LearnedParameter, Summary};
use paig::support::statistics::Spread;
use paig::tasks::Task;
use paig::tasks::published::published;

/// Any data as the template sees them.
pub(super) fn value(data: impl Serialize) -> Value {
    Value::from(minijinja::value::Serde(data))
}

/// A task with the views of its groups.
pub(super) fn of_task(task: &Task, groups: &[RunGroup], views: &[Value]) -> Value {
    let parameter = |parameter: &PhysicalParameter| {
        context! {
            symbol => &*parameter.name,
            truth => task.truth_of(&parameter.name),
            paper => paper(task, Some(parameter)),
        }
    };
    let pairs = groups.chunk_by(|a, b| a.recipe == b.recipe).map(|groups| (groups[0].recipe.clone(), pairs(groups)));
    context! {
        name => &task.name,
        criterion => value(criteria::criterion(task)),
        in_paper => published().knows(&task.name),
        parameters => task.system.cell.parameters.iter().map(parameter).collect::<Vec<_>>(),
        groups => views.to_vec(),
        // By recipe.
        pairs => pairs.collect::<BTreeMap<_, _>>(),
    }
}

/// A group of runs, whose records lie in these folders. Spreads are over the finished runs.
pub(super) fn of_group(group: &RunGroup, pictures: &GroupPictures, records: &[PathBuf]) -> Result<Value> {
    Ok(context! {
        task => &group.task.name,
        recipe => group.recipe.clone(),
        label => group.label.clone(),
        changes => group.changes.clone(),
        role => value(group.role()),
        is_protocol => group.is_protocol(),
        tried => group.runs.len(),
        datasets => group.datasets(),
        finished => group.finished().count(),
        // None of a task without a criterion, or where nothing can be held against it.
        succeeded => group.succeeded(),
        // By the runs' own verdict, and those that have one.
        found => group.found(),
        // Finished runs that do not show their objects.
        lost => group.finished().filter(|(_, summary)| criteria::lost_objects(&group.task, summary)).count(),
        refined => group.refined(),
        unit => group.task.system.cell.coordinates.unit(),
        // Those that are learned.
        parameters => group.learned().map(|p| parameter(group, Some(p))).collect::<Vec<_>>(),
        losses => value(BTreeMap::from(group.losses())),
        states => value(BTreeMap::from(group.states())),
        // How many times the true velocity at the last input frame is estimated.
        velocity_slope => value(group.spread(|summary| summary.test.scores.states.as_ref()?.initial_velocity_slope)),
        answer => answer(group),
        wall_seconds => value(group.spread(|summary| Some(summary.wall_seconds))),
        frames => value(group.frames()),
        runs => group.runs.iter().map(|run| of_run(group, run)).collect::<Vec<_>>(),
        pictures => value(pictures),
        commands => commands(group, records)?,
    })
}

/// When the runs of a group had their answer, and how many of them ever had; seconds.
fn answer(group: &RunGroup) -> Value {
    let times = TimeToAnswer::of(group);
    let spread = |of: fn(&TimeToAnswer) -> Option<f64>| {
        let known: Vec<f64> = times.iter().filter_map(of).collect();
        context! { count => known.len(), seconds => value(Spread::of(known)) }
    };
    context! {
        objects => spread(|times| times.seconds_to_objects),
        two_percent => spread(|times| times.seconds_to_2_percent),
        half_percent => spread(|times| times.seconds_to_half_percent),
        end => spread(|times| Some(times.seconds)),
    }
}

/// A parameter that a group learned; all none without one, and shares of a truth that is 0.
pub(super) fn parameter(group: &RunGroup, parameter: Option<&PhysicalParameter>) -> Value {
    let error = |summary: &Summary| summary.error_percent(&parameter?.name);
    let ratio = group.spread(|summary| summary.parameters.get(&*parameter?.name)?.ratio());
    let learned = parameter.and_then(|parameter| group.value(parameter));
    let truth = parameter.and_then(|parameter| group.truth(parameter));
    let unit = parameter.and_then(|parameter| group.own_unit(parameter));
    context! {
        symbol => parameter.map(|parameter| &*parameter.name),
        truth => truth,
        learned => value(learned),
        // In per cent of the truth: with the sign, without, and of the median.
        error => value(group.spread(error)),
        error_size => value(group.spread(|summary| error(summary).map(f64::abs))),
        median_error => learned.and_then(|learned| LearnedParameter { learned: learned.median, truth }.error_percent()),
        // In the model's own unit, where that is not true pixels.
        own => value(learned.zip(unit).map(|(learned, unit)| learned.times(1.0 / unit))),
        // The value in the model's own unit over the truth.
        ratio => value(ratio.map(|ratio| ratio.times(1.0 / unit.unwrap_or(1.0)))),
    }
}

/// By symbol, in per cent with the sign.
fn errors(summary: &Summary) -> BTreeMap<&str, f64> {
    let errors = summary.parameters.iter().map(|(symbol, parameter)| (symbol.as_str(), parameter.error_percent()));
    errors.filter_map(|(symbol, error)| Some((symbol, error?))).collect()
}

/// What the paper learned; all none where it reports nothing.
pub(super) fn paper(task: &Task, parameter: Option<&PhysicalParameter>) -> Value {
    let paper = parameter.and_then(|parameter| published().parameter(&task.name, &parameter.name));
    context! {
        learned => paper.map(|paper| paper.learned),
        ratio => paper.map(|paper| paper.learned / paper.truth),
        error => paper.map(|paper| paper.error_percent()),
    }
}

fn of_run(group: &RunGroup, run: &StoredRun) -> Value {
    let course = run.known_course();
    let last = |loss: Loss| (loss, course.and_then(|course| course.last_validation(loss.key())));
    context! {
        task => &group.task.name,
        seed => run.config.seed,
        status => value(criteria::status(run)),
        length => run.length(),
        folder => run.folder.display().to_string(),
        device => run.config.device.clone(),
        steps => run.steps(),
        epochs => run.epochs(),
        // Of the training so far.
        seconds => course.and_then(|course| course.seconds()),
        // Training, validation, test.
        clips => value(run.data.as_ref().map(|data| data.clips)),
        // summary.json.
        summary => value(&run.summary),
        // In per cent, of the parameters whose truth is known.
        errors => run.summary.as_ref().map(|summary| value(errors(summary))),
        // Why the course cannot be read.
        unread_course => run.course.as_ref().err().map(|error| format!("{error:#}")),
        // Losses of the last validation.
        last => value(BTreeMap::from(Loss::ALL.map(last))),
        // At the last validation; none where none is on record, or no yardstick says so.
        objects_found => last(Loss::Recons).1.and_then(|loss| criteria::objects_found(&group.task, loss)),
        reaches_paper => criteria::reaches_paper(run),
        movements => group.learned().filter_map(|parameter| movement(run, parameter)).collect::<Vec<_>>(),
    }
}

/// How a parameter moved: its value at the start, half-way and at the last record; and whether it ended nearer to its truth
/// than it started (below 0), as far from it (0) or further.
fn movement(run: &StoredRun, parameter: &PhysicalParameter) -> Option<Value> {
    let course = run.known_course()?.start_middle_end(&parameter.name)?;
    let stated = run.summary.as_ref().and_then(|summary| summary.parameters.get(&*parameter.name));
    let truth = stated.map_or(run.config.task.truth_of(&parameter.name), |stated| stated.truth);
    let away = |truth: f64| (course[2] - truth).abs().total_cmp(&(course[0] - truth).abs()) as i8;
    Some(context! { symbol => &*parameter.name, course => value(course), truth => truth, away => truth.map(away) })
}

/// How far starts from other parameters lead from the same seeds of the recipe as it is: from different objects to the
/// same numbers says less than from the same objects.
fn pairs(groups: &[RunGroup]) -> Value {
    let of =
        |role: GroupRole| groups.iter().filter(move |group| group.role() == role).flat_map(|group| group.finished());
    let seeds = |run: &StoredRun| (run.config.seed, run.data.as_ref().and_then(RunData::seed));
    let same_seed = |run: &StoredRun| of(GroupRole::Plain).find(|(other, _)| seeds(other) == seeds(run));
    let pairs: Vec<_> = of(GroupRole::Start).filter_map(|(run, start)| Some((start, same_seed(run)?.1))).collect();
    let farthest = groups[0].learned().filter_map(|parameter| {
        let learned = |summary: &Summary| Some(summary.parameters.get(&*parameter.name)?.learned);
        let apart = pairs.iter().filter_map(|(start, same)| Some((learned(start)? - learned(same)?).abs()));
        apart.reduce(f64::max).map(|by| context! { symbol => &*parameter.name, by => by })
    });
    context! { count => pairs.len(), farthest => farthest.collect::<Vec<_>>() }
}
