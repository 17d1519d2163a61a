//! The plans of a sweep: one for each combination of values, or one for each change.

use anyhow::{Context, Result, ensure};

use super::plan::{SweepJob, SweepPlan, each_once};
use super::seeds::MOST_RUNS;
use paig::support::device;

/// A sweep as a user asks for it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SweepRequest {
    /// What all runs share.
    pub plan: SweepPlan,
    /// `key=value,value`: each combination of the values of all keys. Not with `variants`.
    pub grid: Vec<String>,
    /// `key=value ..`: the plan as it is, and with each of these changes alone.
    pub variants: Vec<String>,
}

impl SweepRequest {
    /// The plans, those with changes named after them. A task that is given twice is trained once.
    ///
    /// # Errors
    /// More than [`MOST_RUNS`], threads that the machine has not, a grid or variant that cannot be read.
    pub fn plans(mut self) -> Result<Vec<SweepPlan>> {
        let plan = &mut self.plan;
        plan.tasks = unique(std::mem::take(&mut plan.tasks));
        ensure!(plan.threads > 0, "--threads-per-run must be at least 1");
        ensure!(
            plan.tasks.len().saturating_mul(plan.seeds.len()) <= MOST_RUNS,
            "more than {MOST_RUNS} runs; give a part of them"
        );
        device::threads(plan.threads).context("--threads-per-run")?;
        let plans = match &self.variants[..] {
            [] => grid(self.plan, &self.grid)?,
            variants => one_change_each(self.plan, variants)?,
        };
        ensure!(
            plans.iter().map(|plan| plan.tasks.len() * plan.seeds.len()).sum::<usize>() <= MOST_RUNS,
            "more than {MOST_RUNS} runs"
        );
        Ok(plans)
    }
}

/// The runs of these plans, each once.
///
/// # Errors
/// As for [`SweepPlan::jobs`], a name without a change, two different runs that would share a folder.
pub fn jobs(plans: &[SweepPlan]) -> Result<Vec<SweepJob>> {
    let mut jobs = Vec::new();
    for plan in plans {
        jobs.extend(plan.jobs()?);
        ensure!(
            plan.name.is_none() || plan.config.is_some() || !plan.set.is_empty(),
            "--name is for a changed recipe; say what is changed with --set or --config, or leave it out"
        );
    }
    each_once(jobs)
}

/// A plan for each combination of the values, named after them.
fn grid(plan: SweepPlan, axes: &[String]) -> Result<Vec<SweepPlan>> {
    let mut plans = vec![plan];
    for axis in axes {
        let wrong = || format!("--grid {axis:?}: expected key=value,value, for example model.exact_shift=true,false");
        let (key, values) = axis.split_once('=').with_context(wrong)?;
        let values: Vec<_> = values.split(',').map(str::trim).collect();
        ensure!(!key.is_empty() && values.iter().all(|value| !value.is_empty()), wrong());
        ensure!(plans.len().saturating_mul(values.len()) <= MOST_RUNS, "--grid: more than {MOST_RUNS} combinations");
        let with = |plan: &SweepPlan, value: &&str| changed(plan, vec![format!("{key}={value}")]);
        plans = plans.iter().flat_map(|plan| values.iter().map(move |value| with(plan, value))).collect();
    }
    Ok(plans)
}

/// The plan as it is, and one for each variant.
fn one_change_each(plan: SweepPlan, variants: &[String]) -> Result<Vec<SweepPlan>> {
    let with = |variant: &String| {
        let sets: Vec<_> = variant.split_whitespace().map(String::from).collect();
        ensure!(!sets.is_empty(), "--variant {variant:?}: expected key=value, for example discover.guide.tie=0");
        Ok(changed(&plan, sets))
    };
    let variants = variants.iter().map(with).collect::<Result<Vec<_>>>()?;
    Ok([vec![plan], variants].concat())
}

/// The plan with more changes, named after them.
fn changed(plan: &SweepPlan, sets: Vec<String>) -> SweepPlan {
    let name = plan.name.iter().chain(&sets).cloned().collect::<Vec<_>>().join("-");
    SweepPlan { name: Some(name), set: [plan.set.clone(), sets].concat(), ..plan.clone() }
}

/// Without the repetitions, in the order given.
fn unique<T: PartialEq>(values: Vec<T>) -> Vec<T> {
    let mut kept = Vec::new();
    for value in values {
        if !kept.contains(&value) {
            kept.push(value);
        }
    }
    kept
}
